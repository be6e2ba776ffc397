//! Weights of views, confidences, threads and units.

use super::*;

fn bits(pose: &[Vector3<f64>]) -> Vec<u64> {
    flat(pose).iter().map(|v| v.to_bits()).collect()
}

#[test]
fn a_view_without_weight_is_absent() {
    let cameras = room(4);
    let detections = noisy_detections(&standing(), &cameras, 4.0, &mut Noise::new(1));
    let start = Some(perturbed(&standing(), 30.0, &mut Noise::new(2)));
    for init in [start, None] {
        let weights = Some(vec![1.0, 1.0, 0.0, 1.0]);
        let config = RefineConfig::from(AnnealedSettings {
            view_weights: weights,
            ..AnnealedSettings::default()
        });
        let a = refine(&cameras, &from(detections.clone(), init.clone()), config);
        let absent = without(&detections, |i, _| i == 2);
        let b = refine(&cameras, &from(absent, init), RefineConfig::default());
        assert_eq!(bits(&a.pose), bits(&b.pose));
        assert_eq!(a.noise.to_bits(), b.noise.to_bits());
        assert!(a.view_weights[2 * 17..3 * 17].iter().all(|k| k.is_nan()));
    }
}

#[test]
fn confidence_multiplies_the_weight_of_its_view() {
    let cameras = room(4);
    let detections = noisy_detections(&standing(), &cameras, 4.0, &mut Noise::new(3));
    let weights = [1.0, 0.5, 0.25, 1.0];
    let confident = changed(&detections, |i, _, p| Some((p, weights[i])));
    let config = RefineConfig::from(AnnealedSettings {
        view_weights: Some(weights.to_vec()),
        ..AnnealedSettings::default()
    });
    let by_view = refine(&cameras, &from(detections.clone(), None), config.clone());
    let by_confidence = refine(&cameras, &from(confident.clone(), None), RefineConfig::default());
    assert_eq!(bits(&by_view.pose), bits(&by_confidence.pose));
    let both = refine(&cameras, &from(confident, None), config);
    let squared = weights.map(|w: f64| w * w).to_vec();
    let config = RefineConfig::from(AnnealedSettings {
        view_weights: Some(squared),
        ..AnnealedSettings::default()
    });
    let expected = refine(&cameras, &from(detections.clone(), None), config);
    assert_eq!(bits(&both.pose), bits(&expected.pose));
    let plain = refine(&cameras, &from(detections, None), RefineConfig::default());
    assert!(rms(&plain.pose, &by_view.pose) > 1.0);
}

/// A common factor on all confidences does not change how much each detection is trusted.
#[test]
fn a_common_confidence_changes_little() {
    let cameras = room(4);
    let (mut plain, mut faint) = (0.0, 0.0);
    for seed in 0..40 {
        let detections = noisy_detections(&standing(), &cameras, 5.0, &mut Noise::new(seed));
        let error = |c: f64| {
            let detections = changed(&detections, |_, _, p| Some((p, c)));
            rms(&refine(&cameras, &from(detections, None), free()).pose, &standing()).powi(2)
        };
        plain += error(1.0);
        faint += error(0.2);
    }
    assert!((faint / plain).sqrt() < 1.05, "{} times the error", (faint / plain).sqrt());
}

#[test]
fn a_batch_has_the_same_bits_on_any_number_of_threads() {
    let cameras = room(4);
    let frames: Vec<Frame> = (0..12)
        .map(|seed| {
            let mut noise = Noise::new(seed);
            let detections = noisy_detections(&standing(), &cameras, 8.0, &mut noise);
            from(detections, (seed % 2 == 0).then(|| perturbed(&standing(), 90.0, &mut noise)))
        })
        .collect();
    let layout = Layout::by_name("h36m17").unwrap();
    let run = |threads| {
        let config = RefineConfig { n_threads: Some(threads), ..RefineConfig::default() };
        let refiner = Refiner::new(&cameras, Unit::Millimetre, Some(&layout), config).unwrap();
        let found = refine_batch(&refiner, &frames, &Progress::default()).unwrap();
        found
            .iter()
            .flat_map(|r| [bits(&r.pose), vec![r.noise.to_bits()]].concat())
            .collect::<Vec<_>>()
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(4));
}

#[test]
fn the_unit_changes_nothing() {
    let cameras = room(4);
    let metres: Vec<Camera> = cameras.iter().map(|c| c.clone().with_length_scale(1e-3)).collect();
    let layout = Layout::by_name("h36m17").unwrap();
    let mut noise = Noise::new(8);
    let detections = noisy_detections(&standing(), &cameras, 5.0, &mut noise);
    let in_mm = with_prior(detections.clone(), perturbed(&standing(), 30.0, &mut noise), 30.0);
    let in_m = Frame {
        detections,
        init_pose: in_mm.init_pose.as_ref().map(|p| p.iter().map(|x| x * 1e-3).collect()),
        init_covariance: in_mm
            .init_covariance
            .as_ref()
            .map(|p| p.iter().map(|c| c * 1e-6).collect()),
        past: false,
    };
    let a = refine(&cameras, &in_mm, RefineConfig::default());
    let refiner =
        Refiner::new(&metres, Unit::Metre, Some(&layout), RefineConfig::default()).unwrap();
    let b = refiner.refine(&in_m).unwrap();
    let b_mm: Vec<Vector3<f64>> = b.pose.iter().map(|x| x * 1e3).collect();
    assert!(largest(&a.pose, &b_mm) < 1e-6);
    assert_eq!(a.n_iter, b.n_iter);
    assert!((a.noise - b.noise * 1e3).abs() < 1e-9 * a.noise);
    for (a, b) in a.uncertainty.iter().zip(&b.uncertainty) {
        assert!((a - b * 1e6).amax() < 1e-6 * a.amax());
    }
    assert!((a.loss.total / b.loss.total - 1.0).abs() < 1e-9);
}

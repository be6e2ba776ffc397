//! Weights of views, confidences, threads and units.

use super::*;

fn bits(pose: &[Vector3<f64>]) -> Vec<u64> {
    flat(pose).iter().map(|v| v.to_bits()).collect()
}

fn weighted(weights: Vec<f64>) -> RefineConfig {
    AnnealedSettings { view_weights: Some(weights), ..AnnealedSettings::default() }.into()
}

#[test]
fn a_view_without_weight_is_absent() {
    let cameras = room(4);
    let detections = noisy_detections(&standing(), &cameras, 4.0, &mut Noise::new(1));
    let start = Some(perturbed(&standing(), 30.0, &mut Noise::new(2)));
    for init in [start, None] {
        let config = weighted(vec![1.0, 1.0, 0.0, 1.0]);
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
    let config = weighted(weights.to_vec());
    let by_view = refine(&cameras, &from(detections.clone(), None), config.clone());
    let by_confidence = refine(&cameras, &from(confident.clone(), None), RefineConfig::default());
    assert_eq!(bits(&by_view.pose), bits(&by_confidence.pose));
    let both = refine(&cameras, &from(confident, None), config);
    let squared = weights.map(|w: f64| w * w).to_vec();
    let expected = refine(&cameras, &from(detections.clone(), None), weighted(squared));
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

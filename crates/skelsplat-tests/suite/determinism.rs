//! Bit-identical results for any number of threads, and cancellation of a batch.

use std::sync::atomic::AtomicBool;

use nalgebra::{Matrix2, Vector2, Vector3};
use skelsplat_core::study::gaussian::Gaussian;
use skelsplat_core::study::paper::Encoding;
use skelsplat_core::study::paper::render::{pseudo_ground_truth, render};
use skelsplat_core::study::paper::splat::Splat;
use skelsplat_core::{
    Camera, Detections, Error, Frame, Method, PaperSettings, Progress, RefineConfig, Refinements,
    Refiner, Unit, refine_batch, refine_sequence,
};
use skelsplat_tests::refused;
use skelsplat_tests::scenes::{Noise, noisy_detections, perturbed, refiner, room, standing};

fn frames(n: u64) -> Vec<Frame> {
    let cameras = room(4);
    (0..n)
        .map(|seed| {
            let mut noise = Noise::new(seed + 1);
            Frame {
                init_pose: Some(perturbed(&standing(), 15.0, &mut noise)),
                ..noisy_detections(&standing(), &cameras, 3.0, &mut noise).into()
            }
        })
        .collect()
}

fn with_threads(n_threads: Option<usize>, config: &RefineConfig) -> Refiner {
    let mut config = RefineConfig { n_threads, ..config.clone() };
    if let Method::Paper(settings) = &mut config.method {
        settings.max_steps = 25;
    }
    refiner(&room(4), config)
}

fn bits(results: &Refinements) -> Vec<u64> {
    results.pose.iter().map(|v| v.to_bits()).collect()
}

#[test]
fn a_batch_has_the_same_bits_on_any_number_of_threads() {
    let frames = frames(6);
    for config in [RefineConfig::paper(), RefineConfig::default()] {
        let run = |threads| {
            let refiner = with_threads(threads, &config);
            bits(&refine_batch(&refiner, &frames, &Progress::default()).unwrap())
        };
        let serial = run(Some(1));
        // None: the pool of the process.
        assert!([Some(2), Some(5), None].into_iter().all(|threads| run(threads) == serial));
    }
}

/// Wide splats make one pose large enough to distribute its windows over threads.
#[test]
fn one_pose_has_the_same_bits_on_any_number_of_threads() {
    let wide = RefineConfig::from(PaperSettings { sigma_mm: 60.0, ..PaperSettings::default() });
    let frames = frames(1);
    let run = |threads| {
        let refiner = with_threads(Some(threads), &wide);
        bits(&refine_batch(&refiner, &frames, &Progress::default()).unwrap())
    };
    assert_eq!(run(1), run(4));
    let cancel = AtomicBool::new(false);
    let one = with_threads(Some(1), &wide).refine_under(&frames[0], true, &cancel).unwrap();
    assert_eq!(run(1), bits(&one.into()), "the pool of the process");
}

#[test]
fn a_frame_in_a_batch_is_what_it_is_alone() {
    let frames = frames(3);
    for config in [RefineConfig::paper(), RefineConfig::default()] {
        let refiner = with_threads(Some(2), &config);
        let progress = Progress::default();
        let batch = refine_batch(&refiner, &frames, &progress).unwrap();
        assert_eq!([batch.len(), progress.done()], [3, 3]);
        for (frame, in_batch) in frames.iter().zip(batch.iter()) {
            assert_eq!(in_batch, refiner.refine(frame).unwrap());
        }
    }
}

#[test]
fn frames_of_different_numbers_of_joints_are_refused() {
    let few = Detections::new(4, 5, &[100.0; 2 * 4 * 5], None).unwrap();
    let frames = [frames(1).remove(0), few.into()];
    let refiner = Refiner::new(&room(4), Unit::Millimetre, None, RefineConfig::default()).unwrap();
    let batch = refine_batch(&refiner, &frames, &Progress::default());
    let sequence = refine_sequence(&refiner, &frames, 30.0, &Progress::default());
    assert_eq!([refused(batch), refused(sequence)], ["detections"; 2]);
}
/// No frame is started once the batch is cancelled.
#[test]
fn cancel_begins_no_further_frame() {
    let progress = Progress::default();
    let refiner = with_threads(Some(2), &RefineConfig::paper());
    progress.cancel();
    assert_eq!(refine_batch(&refiner, &frames(3), &progress), Err(Error::Cancelled));
    assert_eq!(progress.done(), 0);
}

/// `paper` also stops within a frame, before its first step, and an image within its rows.
#[test]
fn cancel_ends_a_frame_and_an_image() {
    let cancel = AtomicBool::new(true);
    let splat = Splat::new(Vector2::new(5.0, 5.0), &Matrix2::identity(), [9, 9]).unwrap();
    let frame = &frames(1)[0];
    for encoding in [Encoding::OneHot, Encoding::Single] {
        let refiner = with_threads(
            Some(1),
            &RefineConfig::from(PaperSettings { encoding, ..PaperSettings::default() }),
        );
        assert_eq!(refiner.refine_under(frame, false, &cancel), Err(Error::Cancelled));
        let gaussians = vec![Gaussian::isotropic(Vector3::zeros(), 20.0); 17];
        let found = refiner.loss_and_gradient(&gaussians, &frame.detections, None, &cancel);
        assert_eq!(found, Err(Error::Cancelled));
        let image = render(&[Some((splat, 1.0))], encoding, [9, 9], &cancel);
        let heats = pseudo_ground_truth(&[Some(splat)], encoding, [9, 9], &cancel);
        assert_eq!([image, heats], [const { Err(Error::Cancelled) }; 2]);
    }
}

/// 65 535² pixels of 4 bytes for each of 17 joints in 4 views, a splat covering them all.
#[test]
fn windows_are_refused_before_they_are_allocated() {
    let side = 65_535;
    let cameras: Vec<Camera> = room(4)
        .iter()
        .map(|c| Camera::new(&c.k(), c.rotation(), c.translation(), [side, side]).unwrap())
        .collect();
    let config = RefineConfig::from(PaperSettings { sigma_mm: 1e6, ..PaperSettings::default() });
    let refiner = Refiner::new(&cameras, Unit::Millimetre, None, config).unwrap();
    let refused = refiner.refine(&frames(1)[0]);
    let text = refused.unwrap_err().to_string();
    assert!(text.starts_with("heat maps: the windows of 68 detections need 1168."), "{text}");
}

//! The same bits on any number of threads, and a batch that can be stopped.

use skelsplat_core::Error;
use skelsplat_core::batch::{Progress, refine_batch};
use skelsplat_core::layout::Layout;
use skelsplat_core::refine::refiner::Frame;
use skelsplat_core::refine::{RefineConfig, Refinement, Refiner};
use skelsplat_core::testing::scenes::{Noise, noisy_detections, perturbed, room, standing};
use skelsplat_core::unit::Unit;

fn frames(n: u64) -> Vec<Frame> {
    let cameras = room(4);
    (0..n)
        .map(|seed| {
            let mut noise = Noise::new(seed + 1);
            Frame {
                detections: noisy_detections(&standing(), &cameras, 3.0, &mut noise),
                init_pose: Some(perturbed(&standing(), 15.0, &mut noise)),
                init_covariance: None,
                past: false,
            }
        })
        .collect()
}

fn refiner(threads: usize, config: &RefineConfig) -> Refiner {
    let config = RefineConfig { n_threads: Some(threads), max_steps: 25, ..config.clone() };
    let layout = Layout::by_name("h36m17").unwrap();
    Refiner::new(&room(4), Unit::Millimetre, Some(&layout), config).unwrap()
}

fn bits(results: &[Refinement]) -> Vec<u64> {
    results.iter().flat_map(|r| r.pose.iter().flat_map(|p| p.iter().map(|v| v.to_bits()))).collect()
}

#[test]
fn a_batch_has_the_same_bits_on_any_number_of_threads() {
    let frames = frames(6);
    let run = |threads| {
        let refiner = refiner(threads, &RefineConfig::paper());
        bits(&refine_batch(&refiner, &frames, &Progress::default()).unwrap())
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(5));
}

/// Wide splats make one pose large enough for its windows to be shared among threads.
#[test]
fn one_pose_has_the_same_bits_on_any_number_of_threads() {
    let wide = RefineConfig { sigma: 60.0, ..RefineConfig::paper() };
    let frames = frames(1);
    let run = |threads| {
        let refiner = refiner(threads, &wide);
        bits(&refine_batch(&refiner, &frames, &Progress::default()).unwrap())
    };
    assert_eq!(run(1), run(4));
}

#[test]
fn a_frame_in_a_batch_is_what_it_is_alone() {
    let frames = frames(3);
    let refiner = refiner(2, &RefineConfig::paper());
    let batch = refine_batch(&refiner, &frames, &Progress::default()).unwrap();
    for (frame, expected) in frames.iter().zip(&batch) {
        let alone =
            refine_batch(&refiner, std::slice::from_ref(frame), &Progress::default()).unwrap();
        assert_eq!(bits(&alone), bits(std::slice::from_ref(expected)));
    }
}

#[test]
fn progress_counts_frames() {
    let progress = Progress::default();
    let refiner = refiner(2, &RefineConfig::paper());
    refine_batch(&refiner, &frames(3), &progress).unwrap();
    assert_eq!(progress.done(), 3);
}

/// No frame is begun once the batch is cancelled, however many are left.
#[test]
fn cancel_begins_no_further_frame() {
    let progress = Progress::default();
    let refiner = refiner(2, &RefineConfig::paper());
    progress.cancel();
    assert_eq!(refine_batch(&refiner, &frames(3), &progress), Err(Error::Cancelled));
    assert_eq!(progress.done(), 0);
}

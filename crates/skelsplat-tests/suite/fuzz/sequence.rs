//! Recordings of any detections, whole and live.

use proptest::prelude::*;
use skelsplat_core::study::sequence::refine_in_windows;
use skelsplat_core::{Frame, Live, Progress, Sequence, follow, refine_sequence};

use super::any::{Recording, any_recording, cameras, config, sound, spoiled, threaded, wrong};

fn check(found: &Sequence) -> Result<(), TestCaseError> {
    for frame in found.frames.iter() {
        sound(&frame)?;
    }
    prop_assert!(found.velocity.iter().all(|v| !v.is_infinite()));
    prop_assert!(found.lengths.iter().all(|l| l.mean.is_nan() || l.mean.is_finite()));
    Ok(())
}

/// One to six frames, of a person with wrong detections or of anything.
fn recording() -> impl Strategy<Value = Recording> {
    let person = (cameras(1..=5), any::<u32>(), 0.0..60.0_f64, wrong(60), 1..=6_u64).prop_map(
        |(c, seed, sigma, wrong, n)| {
            let frames = (0..n).map(|k| spoiled(&c, u64::from(seed) + k, sigma, &wrong)).collect();
            (c, frames)
        },
    );
    prop_oneof![1 => any_recording(1..=4, 1..=6), 2 => person]
}

proptest! {
    #![proptest_config(config(12))]

    #[test]
    fn any_recording_has_a_sound_path(
        (cameras, seen) in recording(),
        fps in prop::sample::select(vec![1e-3, 1.0, 25.0, 1e4]),
    ) {
        let frames: Vec<Frame> = seen.into_iter().map(Frame::from).collect();
        let refiner = threaded(&cameras, 1);
        check(&refine_sequence(&refiner, &frames, fps, &Progress::default()).unwrap())?;
    }

    #[test]
    fn windows_of_any_length_have_a_sound_path(
        (cameras, seen) in recording(), length in 1..4_usize, overlap in 0..3_usize,
    ) {
        let frames: Vec<Frame> = seen.into_iter().map(Frame::from).collect();
        let (refiner, size) = (threaded(&cameras, 1), [length, overlap]);
        check(&refine_in_windows(&refiner, &frames, 30.0, size, &Progress::default()).unwrap())?;
    }

    #[test]
    fn any_loop_has_sound_poses(
        (cameras, seen) in recording(),
        fps in prop::sample::select(vec![1e-3, 25.0, 1e4]),
        lag in 0..3_usize,
    ) {
        let refiner = threaded(&cameras, 1);
        let mut live = Live::new(&refiner, fps, lag).unwrap();
        let mut past = None;
        for detections in seen {
            sound(&live.step(&refiner, detections.clone(), &Progress::default()).unwrap())?;
            let (found, next) = follow(&refiner, past, detections, &Progress::default()).unwrap();
            sound(&found)?;
            past = Some(next);
        }
    }
}

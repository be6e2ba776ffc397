//! Whole recordings: accuracy, gaps, cuts, lengths, and windows.

use nalgebra::Vector3;
use skelsplat_core::study::sequence::{Window, refine_in_windows};
use skelsplat_core::{
    AnnealedSettings, Detections, Frame, JointStatus, Live, Progress, RefineConfig, Refiner,
    Sequence, Unit, learn_sequence, refine_sequence, refine_windows,
};
use skelsplat_tests::refused;
use skelsplat_tests::scenes::{
    Noise, h36m, mean_error, noisy_detections, not_human, refiner, room, standing, without,
};

/// A person who sways and turns, seen by four cameras with noise.
fn recording(frames: usize, sigma: f64, seed: u64) -> (Vec<Vec<Vector3<f64>>>, Vec<Detections>) {
    let (cameras, mut noise) = (room(4), Noise::new(seed));
    let pose = |t: usize| -> Vec<Vector3<f64>> {
        let (sin, cos) = (0.02 * t as f64).sin_cos();
        let shift = Vector3::new(400.0 * sin, 300.0 * cos, 0.0);
        let turn =
            |p: &Vector3<f64>| Vector3::new(cos * p.x - sin * p.y, sin * p.x + cos * p.y, p.z);
        standing().iter().map(|p| turn(p) + shift).collect()
    };
    let poses: Vec<_> = (0..frames).map(pose).collect();
    let seen = poses.iter().map(|p| noisy_detections(p, &cameras, sigma, &mut noise)).collect();
    (poses, seen)
}

fn solved(detections: &[Detections], config: RefineConfig) -> Sequence {
    let frames: Vec<Frame> = detections.iter().cloned().map(Frame::from).collect();
    refine_sequence(&refiner(&room(4), config), &frames, 30.0, &Progress::default()).unwrap()
}

/// The points of arrays `(…, 3)`.
fn points(numbers: &[f64]) -> impl Iterator<Item = Vector3<f64>> {
    numbers.chunks_exact(3).map(Vector3::from_column_slice)
}

/// Mean error of poses `(T, N, 3)`.
fn mean_error_of(poses: &[f64], truth: &[Vec<Vector3<f64>>]) -> f64 {
    mean_error(&points(poses).collect::<Vec<_>>(), &truth.concat())
}

#[test]
fn a_sequence_is_more_accurate_than_its_frames_alone() {
    let (truth, detections) = recording(120, 4.0, 5);
    let found = solved(&detections, RefineConfig::default());
    let alone = mean_error_of(&found.frames.init_pose, &truth);
    assert!(mean_error_of(&found.frames.pose, &truth) < 0.6 * alone);
    for ([a, b], length) in found.bones.iter().zip(&found.lengths) {
        let true_length = (truth[0][*a] - truth[0][*b]).norm();
        assert!((length.mean - true_length).abs() < 5.0 * length.sigma + 2.0);
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let (_, detections) = recording(1900, 4.0, 6);
    let with = |n: usize| {
        solved(&detections, RefineConfig { n_threads: Some(n), ..RefineConfig::default() })
    };
    let (one, two) = (with(1), with(2));
    let bits = |s: &Sequence| -> Vec<u64> {
        s.frames.pose.iter().chain(&s.frames.uncertainty).map(|v| v.to_bits()).collect()
    };
    assert_eq!(bits(&one), bits(&two));
}

#[test]
fn a_gap_is_bridged_and_a_long_one_is_not() {
    let (truth, mut detections) = recording(200, 2.0, 7);
    let missing = Detections::new(4, 17, &[f64::NAN; 2 * 4 * 17], None).unwrap();
    (50..62).chain(100..160).for_each(|t| detections[t] = missing.clone());
    let found = solved(&detections, RefineConfig::default());
    for (t, truth) in truth.iter().enumerate().take(62).skip(50) {
        assert_eq!(found.frames.frame(t).joint_status, [JointStatus::Inferred; 17]);
        for (x, y) in found.frames.frame(t).pose.iter().zip(truth) {
            assert!((x - y).norm() < 60.0);
        }
        let bar = |t: usize| found.frames.frame(t).uncertainty[16].trace();
        assert!(bar(56) > 2.0 * bar(45));
    }
    for t in 100..160 {
        assert_eq!(found.frames.frame(t).joint_status, [JointStatus::Unobserved; 17]);
        assert!(found.frames.frame(t).pose.iter().all(|x| x.x.is_nan()));
    }
    let seen = found.frames.iter().enumerate().filter(|(t, _)| !(50..62).contains(t));
    assert!(seen.filter(|(t, _)| !(100..160).contains(t)).all(|(_, f)| f.pose[0].x.is_finite()));
}

#[test]
fn given_lengths_hold_where_no_frame_shows_the_bone_and_yield_where_frames_contradict_them() {
    let (truth, mut detections) = recording(90, 2.0, 14);
    // The last joint, an end of the last limb, is seen by one view only.
    let end = 16;
    for frame in &mut detections {
        *frame = without(frame, |i, j| j == end && i > 0);
    }
    let own = not_human(&h36m());
    let length = |[a, b]: &[usize; 2]| (truth[0][*a] - truth[0][*b]).norm();
    let mut lengths: Vec<f64> = own.limbs.iter().map(length).collect();
    lengths[1] += 150.0;
    let settings = AnnealedSettings {
        bone_lengths_mm: Some(lengths.clone()),
        bone_sigmas_mm: Some(vec![10.0; lengths.len()]),
        ..AnnealedSettings::default()
    };
    let refiner = Refiner::new(&room(4), Unit::Millimetre, Some(&own), settings.into()).unwrap();
    let frames: Vec<Frame> = detections.into_iter().map(Frame::from).collect();
    let found = refine_sequence(&refiner, &frames, 30.0, &Progress::default()).unwrap();
    let last = own.limbs.iter().position(|limb| limb.contains(&end)).unwrap();
    let [a, b] = own.limbs[last];
    for frame in found.frames.iter() {
        let long = (frame.pose[a] - frame.pose[b]).norm();
        assert!((long - lengths[last]).abs() < 20.0, "{long} mm for {}", lengths[last]);
        assert_ne!(frame.joint_status[end], JointStatus::Ok);
    }
    // The given length of this limb is wrong, and all views see it.
    assert!((found.lengths[1].mean - (lengths[1] - 150.0)).abs() < 10.0);
    let [a, b] = own.limbs[1];
    for (frame, truth) in found.frames.iter().zip(&truth) {
        assert!((frame.pose[a] - truth[a]).norm().max((frame.pose[b] - truth[b]).norm()) < 25.0);
    }
}

#[test]
fn nothing_and_one_frame_are_answered_and_a_wrong_rate_is_named() {
    assert!(solved(&[], RefineConfig::default()).frames.is_empty());
    let (truth, detections) = recording(1, 2.0, 8);
    let one = solved(&detections, RefineConfig::default());
    assert!(mean_error_of(&one.frames.pose, &truth) < 20.0);
    assert!(one.velocity.iter().all(|v| v.is_nan()));
    let refiner = Refiner::new(&room(4), Unit::Millimetre, None, RefineConfig::default()).unwrap();
    for fps in [0.0, -5.0, f64::NAN, f64::INFINITY, 1e-4, 1e300] {
        assert_eq!(refused(refine_sequence(&refiner, &[], fps, &Progress::default())), "fps");
    }
    let paper = Refiner::new(&room(4), Unit::Millimetre, None, RefineConfig::paper()).unwrap();
    let sequence = refine_sequence(&paper, &[], 30.0, &Progress::default());
    assert_eq!(refused(sequence), "config.method");
    for (refiner, fps, argument) in [(&refiner, 0.0, "fps"), (&paper, 30.0, "config.method")] {
        assert_eq!(refused(Live::new(refiner, fps, 0)), argument);
    }
}

#[test]
fn windows_that_overlap_give_what_one_window_gives() {
    let (_, detections) = recording(400, 4.0, 10);
    let refiner = refiner(&room(4), RefineConfig::default());
    let frames: Vec<Frame> = detections.iter().cloned().map(Frame::from).collect();
    let solved = |windows| {
        refine_in_windows(&refiner, &frames, 30.0, windows, &Progress::default()).unwrap()
    };
    // Three windows of 133 frames and one of 400: what is learnt is the same.
    let (whole, parts) = (solved([400, 60]), solved([134, 60]));
    let pairs = points(&whole.frames.pose).zip(points(&parts.frames.pose));
    let mut off: Vec<f64> = pairs.map(|(a, b)| (a - b).norm()).collect();
    off.sort_by(f64::total_cmp);
    let (median, largest) = (off[off.len() / 2], off[off.len() - 1]);
    assert!(median < 0.1, "median {median} mm, largest {largest} mm");
    assert!(largest < 0.15, "largest {largest} mm");
}

#[test]
fn windows_and_knowledge_that_do_not_fit_are_refused() {
    let refiner = Refiner::new(&room(4), Unit::Millimetre, None, RefineConfig::default()).unwrap();
    let (_, detections) = recording(30, 4.0, 12);
    let frames: Vec<Frame> = detections.iter().cloned().map(Frame::from).collect();
    let progress = Progress::default();
    let known = learn_sequence(&refiner, &[&frames], 15.0, &progress).unwrap();
    let refused_windows = |windows: &[Window], frames: &[Frame]| {
        refused(refine_windows(&refiner, frames, windows, &known, &progress))
    };
    for (own, all) in [(0..31, 0..31), (5..5, 0..30), (2..10, 3..10), (2..10, 0..9)] {
        assert_eq!(refused_windows(&[Window { own, all }], &frames), "windows");
    }
    let gap = [Window { own: 0..10, all: 0..30 }, Window { own: 11..20, all: 0..30 }];
    assert_eq!(refused_windows(&gap, &frames), "windows");
    let one = Detections::new(4, 1, &[1.0; 8], None).unwrap();
    assert_eq!(refused_windows(&[Window { own: 0..1, all: 0..1 }], &[one.into()]), "known");
    for parts in [&[][..], &[&frames[..0]][..]] {
        assert_eq!(refused(learn_sequence(&refiner, parts, 15.0, &progress)), "detections");
    }
}

#[test]
fn one_second_of_a_motion_is_not_smoothed_away() {
    let (cameras, mut noise) = (room(4), Noise::new(21));
    let pose = |t: usize| -> Vec<Vector3<f64>> {
        let (sin, cos) = (0.6 * t as f64).sin_cos();
        standing().iter().map(|p| p + Vector3::new(150.0 * sin, 150.0 * cos, 0.0)).collect()
    };
    let truth: Vec<_> = (0..15).map(pose).collect();
    let refiner = refiner(&cameras, RefineConfig::default());
    let frames: Vec<Frame> =
        truth.iter().map(|p| noisy_detections(p, &cameras, 4.0, &mut noise).into()).collect();
    let found = refine_sequence(&refiner, &frames, 15.0, &Progress::default()).unwrap();
    let (in_time, alone) =
        (mean_error_of(&found.frames.pose, &truth), mean_error_of(&found.frames.init_pose, &truth));
    assert!(in_time < alone, "{in_time} solved over time, {alone} alone");
}

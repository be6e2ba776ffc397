//! The complete method on scenes with known ground truth.

use nalgebra::{Vector2, Vector3};
use skelsplat_core::study::paper::PositionLearningRate;
use skelsplat_core::{
    Camera, Frame, JointStatus, PaperSettings, RefineConfig, Refinement, StopReason,
};
use skelsplat_tests::scenes::{
    Noise, exact_detections, mean_error, noisy_detections, perturbed, refiner, room, standing,
    without,
};

fn refine(cameras: &[Camera], frame: &Frame, config: impl Into<RefineConfig>) -> Refinement {
    refiner(cameras, config).refine(frame).unwrap()
}

fn by_paper(cameras: &[Camera], frame: &Frame) -> Refinement {
    refine(cameras, frame, RefineConfig::paper())
}

fn start(noise_mm: f64, seed: u64) -> Vec<Vector3<f64>> {
    perturbed(&standing(), noise_mm, &mut Noise::new(seed))
}

#[test]
fn a_joint_that_one_view_sees_is_weak_but_agrees_with_that_view() {
    let cameras = room(4);
    let detections = without(&exact_detections(&standing(), &cameras), |i, j| j == 13 && i > 0);
    let frame = Frame { init_pose: Some(start(10.0, 5)), ..detections.into() };
    let config =
        RefineConfig::from(PaperSettings { stop_tolerance: 0.0, ..PaperSettings::default() });
    let out = refine(&cameras, &frame, config);
    assert_eq!(out.joint_status[13], JointStatus::Weak);
    // An initial error of 10 mm is about 2 px here; one view suffices to remove the visible part.
    assert!(out.reprojection_error[13] < 0.5, "{}", out.reprojection_error[13]);
}

#[test]
fn joints_behind_every_camera_or_outside_every_image_are_outcomes() {
    let cameras = room(2);
    let detections = exact_detections(&standing(), &cameras);
    // Below the floor by 100 m: no image shows it. Far behind camera 0, which looks at the room
    // from one side.
    let outside = Vector3::new(0.0, 0.0, -1e5);
    let behind = cameras[0].centre() * 3.0;
    for (j, place) in [(4, outside), (9, behind)] {
        let mut init = standing();
        init[j] = place;
        let frame = Frame { init_pose: Some(init), ..detections.clone().into() };
        let out = by_paper(&cameras, &frame);
        assert_ne!(out.joint_status[j], JointStatus::Ok);
        assert!(out.pose.iter().flat_map(|p| p.iter()).all(|v| v.is_finite()));
    }
}

#[test]
fn nan_joints_of_the_start_are_triangulated() {
    let cameras = room(4);
    let detections = exact_detections(&standing(), &cameras);
    let mut init = standing();
    init[2] = Vector3::repeat(f64::NAN);
    let frame = Frame { init_pose: Some(init), ..detections.into() };
    let out = by_paper(&cameras, &frame);
    assert!((out.init_pose[2] - standing()[2]).norm() < 1e-6);
}

#[test]
fn a_lower_resolution_still_recovers_the_pose() {
    let cameras = room(4);
    let detections = exact_detections(&standing(), &cameras);
    let frame = Frame { init_pose: Some(start(10.0, 8)), ..detections.into() };
    let config = RefineConfig::from(PaperSettings { resolution: 0.5, ..PaperSettings::default() });
    let out = refine(&cameras, &frame, config);
    // A shift of half a pixel at 4.6 mm per pixel would show as more than 2 mm.
    assert!(mean_error(&out.pose, &standing()) < 1.0);
}

/// A joint that another wrong detection pulls aside comes back past the place nearest to the camera
/// on such a ray.
#[test]
fn a_detection_far_outside_its_image_is_no_barrier() {
    let cameras = room(6);
    let seen = noisy_detections(&standing(), &cameras, 3.0, &mut Noise::new(1));
    // One view is 300 px off, another has a joint at `far`, or not at all.
    let refined = |j: usize, off: usize, other: usize, far: f64| {
        let detections = seen.map(|view, p| match Some(p) == seen.get(view, j).map(|(q, _)| q) {
            true if view == off => Some(p + Vector2::new(300.0, 0.0)),
            true if view == other => Some(Vector2::new(far, p.y)),
            _ => Some(p),
        });
        refine(&cameras, &Frame::from(detections), RefineConfig::default())
    };
    for j in 0..17 {
        for (off, other) in [(0, 1), (0, 2), (1, 4), (2, 3)] {
            let without = refined(j, off, other, f64::NAN);
            for far in [-1e5, 1e5, 1e6, 1e30] {
                let out = refined(j, off, other, far);
                let moved = (out.pose[j] - without.pose[j]).norm();
                assert!(moved < 5.0, "joint {j} at {far} px of view {other}: {moved} mm");
                let least = out.uncertainty[j].symmetric_eigenvalues().min().sqrt();
                assert!(least > 1.0, "joint {j} at {far} px of view {other}: ±{least} mm");
            }
        }
    }
}

/// A learning rate that makes the parameters overflow ends with the last finite state.
#[test]
fn divergence_is_an_outcome_with_finite_numbers() {
    let cameras = room(4);
    let detections = exact_detections(&standing(), &cameras);
    let frame = Frame { init_pose: Some(start(10.0, 9)), ..detections.into() };
    for config in [
        RefineConfig::from(PaperSettings { log_scale_lr: 400.0, ..PaperSettings::default() }),
        RefineConfig::from(PaperSettings {
            position_lr_mm: PositionLearningRate::Millimetres(1e308),
            position_lr_factor: 100.0,
            ..PaperSettings::default()
        }),
    ] {
        let out = refine(&cameras, &frame, config);
        assert_eq!(out.stop_reason, StopReason::Diverged);
        assert!(out.pose.iter().flat_map(|p| p.iter()).all(|v| v.is_finite()));
        assert!(out.loss.total.is_finite());
    }
}

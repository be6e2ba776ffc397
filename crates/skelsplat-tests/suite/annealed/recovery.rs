//! Scenes with known ground truth, and joints that only one view sees.

use super::*;

#[test]
fn exact_detections_recover_the_pose_from_any_start() {
    let cameras = room(4);
    let detections = exact_detections(&standing(), &cameras);
    for (seed, start) in [0.0, 20.0, 100.0, 400.0].into_iter().cycle().take(20).enumerate() {
        let init = perturbed(&standing(), start, &mut Noise::new(seed as u64));
        let out = refine(&cameras, &from(detections.clone(), Some(init)), free());
        assert_eq!(out.stop_reason, StopReason::Converged);
        assert!(largest(&out.pose, &standing()) < 1e-3, "{start} mm, seed {seed}");
        assert!(out.joint_status.iter().all(|s| *s == JointStatus::Ok));
        assert!(out.view_weights.iter().all(|k| *k > 1.0 - 1e-6));
        assert!(out.reprojection_error.iter().all(|e| *e < 1e-3));
    }
    let out = refine(&cameras, &from(detections, None), free());
    assert!(largest(&out.pose, &standing()) < 1e-3);
}

/// The second start is 400 mm per axis off: the first step leaves nothing of it but the damping's
/// share, ŝ²/(320 mm)² ≈ 1e-3 of it, and every further step that share of the rest.
#[test]
fn noisy_detections_give_the_same_pose_from_any_start() {
    let cameras = room(4);
    for seed in 0..10 {
        let mut noise = Noise::new(seed);
        let detections = noisy_detections(&standing(), &cameras, 3.0, &mut noise);
        let near =
            refine(&cameras, &from(detections.clone(), Some(standing())), RefineConfig::default());
        let far = perturbed(&standing(), 400.0, &mut noise);
        let far = refine(&cameras, &from(detections, Some(far)), RefineConfig::default());
        assert!(
            largest(&near.pose, &far.pose) < 0.1,
            "seed {seed}: {}",
            largest(&near.pose, &far.pose)
        );
    }
}

#[test]
fn a_joint_with_one_view_moves_across_its_ray_and_not_along() {
    let cameras = room(4);
    for seed in 0..10 {
        let mut noise = Noise::new(seed);
        let detections = noisy_detections(&standing(), &cameras, 2.0, &mut noise);
        let detections = without(&detections, |i, j| j == WRIST && i != 2);
        let mut start = perturbed(&standing(), 80.0, &mut noise);
        start[WRIST] = standing()[WRIST] + Vector3::new(60.0, 10.0, -50.0);
        let ray = Rays::new(&detections, &cameras, &[]).of_joint(WRIST)[2];
        let out = refine(&cameras, &from(detections, Some(start.clone())), free());
        assert_eq!(out.joint_status[WRIST], JointStatus::Weak);
        let before = ray.offset(&start[WRIST]);
        let after = ray.offset(&out.pose[WRIST]);
        assert!(after.across.norm() < 1e-3 && before.across.norm() > 20.0);
        assert!((after.range - before.range).abs() < 1e-6);
    }
}

/// Limbs of equal length may move a joint along its only ray, but never away: an arm exceeds its
/// twin by no more than the span of the limbs' kernel, and a joint that starts farther off stays
/// there.
#[test]
fn symmetry_does_not_throw_a_joint_along_its_only_ray() {
    let cameras = room(4);
    for seed in 0..200 {
        let mut noise = Noise::new(seed);
        let detections = noisy_detections(&standing(), &cameras, 3.0, &mut noise);
        let view = (seed % 4) as usize;
        let detections = without(&detections, |i, j| j == WRIST && i != view);
        let start = perturbed(&standing(), 100.0, &mut noise);
        let ray = Rays::new(&detections, &cameras, &[]).of_joint(WRIST)[view];
        let before = ray.offset(&start[WRIST]).range;
        let out = refine(&cameras, &from(detections, Some(start)), RefineConfig::default());
        let after = ray.offset(&out.pose[WRIST]);
        assert!(after.across.norm() < 30.0, "seed {seed}: {} mm across", after.across.norm());
        assert!(
            (after.range - before).abs() < 500.0,
            "seed {seed}: {} mm along",
            after.range - before
        );
        let others: Vec<usize> = (0..17).filter(|j| *j != WRIST).collect();
        let worst =
            others.iter().map(|j| (out.pose[*j] - standing()[*j]).norm()).fold(0.0, f64::max);
        assert!(worst < 80.0, "seed {seed}: another joint is {worst} mm off");
    }
}

//! Missing data, statuses and reasons to stop; of `paper` too where it is the same.

use super::*;

#[test]
fn a_joint_that_no_view_sees_keeps_its_start() {
    let cameras = room(4);
    let detections = without(&exact_detections(&standing(), &cameras), |_, j| j == WRIST);
    let start = perturbed(&standing(), 100.0, &mut Noise::new(1));
    for config in [RefineConfig::default(), free(), RefineConfig::paper()] {
        let out = refine(&cameras, &from(detections.clone(), Some(start.clone())), config.clone());
        assert_eq!(out.joint_status[WRIST], JointStatus::Unobserved);
        assert!((out.pose[WRIST] - start[WRIST]).norm() < 1e-9);
        assert!(out.uncertainty[WRIST].iter().all(|v| v.is_nan()));
        assert!(out.view_weights.iter().skip(WRIST).step_by(17).all(|k| k.is_nan()));
        assert!(out.reprojection_error.iter().skip(WRIST).step_by(17).all(|e| e.is_nan()));
        let out = refine(&cameras, &from(detections.clone(), None), config);
        assert_eq!(out.joint_status[WRIST], JointStatus::Unobserved);
        assert!(out.pose[WRIST].iter().all(|v| v.is_nan()));
        assert!(out.covariance[WRIST].iter().all(|v| !v.is_finite() || *v == 0.0));
        let rest = |p: &[Vector3<f64>]| [&p[..WRIST], &p[WRIST + 1..]].concat();
        assert!(largest(&rest(&out.pose), &rest(&standing())) < 5.0);
    }
    // With a prior its error bar is the prior.
    let out = refine(&cameras, &with_prior(detections, start.clone(), 30.0), free());
    assert_eq!(out.joint_status[WRIST], JointStatus::Unobserved);
    assert!((out.pose[WRIST] - start[WRIST]).norm() < 1e-9);
    assert!((out.uncertainty[WRIST] - Matrix3::from_diagonal_element(900.0)).amax() < 1e-6);
}

#[test]
fn without_bones_a_joint_with_one_view_and_no_start_stays_nan_and_weak() {
    let cameras = room(4);
    let detections = without(&exact_detections(&standing(), &cameras), |i, j| j == WRIST && i > 0);
    let out = refine(&cameras, &from(detections, None), free());
    assert_eq!(out.joint_status[WRIST], JointStatus::Weak);
    assert!(out.pose[WRIST].iter().all(|v| v.is_nan()));
    assert!(out.uncertainty[WRIST].iter().all(|v| v.is_nan()));
    assert!(out.noise.is_finite() && out.loss.total.is_finite() && out.loss.symmetry.is_finite());
}

#[test]
fn a_frame_without_detections_has_no_observations() {
    let cameras = room(4);
    let nothing = Detections::new(4, 17, &[f64::NAN; 4 * 17 * 2], None).unwrap();
    let start = perturbed(&standing(), 10.0, &mut Noise::new(6));
    for config in [RefineConfig::default(), RefineConfig::paper()] {
        let frame = from(nothing.clone(), Some(start.clone()));
        let out = refine(&cameras, &frame, config.clone());
        assert_eq!(out.stop_reason, StopReason::NoObservations);
        assert_eq!(out.pose, out.init_pose);
        assert!(largest(&out.pose, &start) < 1e-9);
        assert!(out.joint_status.iter().all(|s| *s == JointStatus::Unobserved));
        let out = refine(&cameras, &from(nothing.clone(), None), config);
        assert_eq!(out.stop_reason, StopReason::NoObservations);
        assert!(out.pose.iter().all(|x| x.x.is_nan()));
    }
}

#[test]
fn the_step_limit_is_an_outcome_with_finite_numbers() {
    let cameras = room(4);
    let detections = noisy_detections(&standing(), &cameras, 3.0, &mut Noise::new(1));
    let start = perturbed(&standing(), 100.0, &mut Noise::new(2));
    for max_steps in [0, 1, 2, 3] {
        for init in [Some(start.clone()), None] {
            let settings = AnnealedSettings { max_steps, ..AnnealedSettings::default() };
            let config = freely(AnnealedSettings { find_swaps: false, ..settings });
            let out = refine(&cameras, &from(detections.clone(), init), config);
            // The preceding triangulation, with as many steps, may have found the pose already.
            assert!(out.stop_reason == StopReason::MaxSteps || max_steps > 0);
            assert!(out.n_iter <= max_steps, "{} of {max_steps}", out.n_iter);
            assert!(out.loss.total.is_finite(), "{max_steps} steps: {:?}", out.loss);
            assert!(out.covariance.iter().all(|c| c.iter().all(|v| v.is_finite())));
            assert!(out.uncertainty.iter().all(|c| c.iter().all(|v| v.is_finite())));
        }
    }
}

/// A detection 300 mm off is rejected; with only one other left the joint is weak.
#[test]
fn a_status_counts_the_views_that_are_believed() {
    let cameras = room(4);
    let exact = exact_detections(&standing(), &cameras);
    let far = changed(&exact, |i, j, p| {
        Some((if (i, j) == (1, WRIST) { p + Vector2::new(70.0, -40.0) } else { p }, 1.0))
    });
    let out = refine(&cameras, &from(far, None), free());
    assert_eq!(out.joint_status[WRIST], JointStatus::Ok);
    assert!(out.view_weights[17 + WRIST] < 1e-3);
    assert!((out.pose[WRIST] - standing()[WRIST]).norm() < 0.1);
    assert!(out.reprojection_error[17 + WRIST] > 75.0);

    let apart = changed(&exact, |i, j, p| match (i, j) {
        (0, WRIST) => Some((p, 1.0)),
        (1, WRIST) => Some((p + Vector2::new(0.0, 300.0), 1.0)),
        (_, WRIST) => None,
        _ => Some((p, 1.0)),
    });
    let out = refine(&cameras, &from(apart, Some(standing())), free());
    assert_eq!(out.joint_status[WRIST], JointStatus::Weak);
}

//! Knowledge in addition to the detections: equal limbs and independent priors.

use super::*;

/// The default without symmetry and bones, until steps are 0.1 % of the noise.
fn exactly() -> RefineConfig {
    freely(AnnealedSettings { step_tolerance: 1e-3, ..AnnealedSettings::default() })
}

/// `standing` with arms and legs of exactly the same length left and right.
fn symmetric_person() -> Vec<Vector3<f64>> {
    let mut pose = standing();
    for ([a, b], [c, d]) in LIMBS {
        let length = (pose[c] - pose[d]).norm();
        pose[b] = pose[a] + (pose[b] - pose[a]).normalize() * length;
    }
    pose
}

fn difference(pose: &[Vector3<f64>], ([a, b], [c, d]): LimbPair) -> f64 {
    (pose[a] - pose[b]).norm() - (pose[c] - pose[d]).norm()
}

#[test]
fn equal_limbs_leave_an_exact_pose_where_it_is() {
    let cameras = room(4);
    let detections = exact_detections(&symmetric_person(), &cameras);
    let start = perturbed(&symmetric_person(), 400.0, &mut Noise::new(2));
    let out = refine(&cameras, &from(detections, Some(start)), RefineConfig::default());
    assert!(largest(&out.pose, &symmetric_person()) < 1e-3);
    assert!(out.loss.symmetry < 1e-6);
}

#[test]
fn symmetry_makes_limbs_alike_and_the_pose_better() {
    let cameras = room(3);
    let (mut free_error, mut error) = (0.0, 0.0);
    let (mut free_difference, mut found_difference) = (0.0, 0.0);
    let limbs = [12, 13, 15, 16, 5, 6, 2, 3];
    for seed in 0..40 {
        let detections =
            noisy_detections(&symmetric_person(), &cameras, 6.0, &mut Noise::new(seed));
        let without = refine(&cameras, &from(detections.clone(), None), free());
        let with = refine(&cameras, &from(detections, None), RefineConfig::default());
        let square = |pose: &[Vector3<f64>]| -> f64 {
            limbs.iter().map(|j| (pose[*j] - symmetric_person()[*j]).norm_squared()).sum()
        };
        free_error += square(&without.pose);
        error += square(&with.pose);
        for pair in LIMBS {
            free_difference += difference(&without.pose, pair).powi(2);
            found_difference += difference(&with.pose, pair).powi(2);
        }
    }
    assert!(found_difference < 0.5 * free_difference, "{found_difference} {free_difference}");
    assert!(error < free_error, "{error} {free_error}");
}

#[test]
fn a_prior_without_doubt_keeps_the_start() {
    let cameras = room(4);
    let detections = noisy_detections(&standing(), &cameras, 3.0, &mut Noise::new(1));
    let start = perturbed(&standing(), 30.0, &mut Noise::new(2));
    for sigma in [1e-3, 1e-6] {
        let out = refine(&cameras, &with_prior(detections.clone(), start.clone(), sigma), free());
        // A detection pulls with c k |e| / ŝ² ≤ 0.86 √2 σ / ŝ² each, some 4 · 40 / 100 per mm:
        // times σ_init².
        assert!(largest(&out.pose, &start) < 2.0 * sigma * sigma + 1e-9);
        let variance = out.uncertainty[3].trace() / (3.0 * sigma * sigma);
        assert!((variance - 1.0).abs() < 1e-3, "{variance}");
    }
}

#[test]
fn a_prior_that_knows_nothing_is_ignored() {
    let cameras = room(4);
    for seed in 0..5 {
        let mut noise = Noise::new(seed);
        let detections = noisy_detections(&standing(), &cameras, 3.0, &mut noise);
        let start = perturbed(&standing(), 30.0, &mut noise);
        let vague = refine(&cameras, &with_prior(detections.clone(), start, 1e6), exactly());
        let none = refine(&cameras, &from(detections, None), exactly());
        assert!(largest(&vague.pose, &none.pose) < 0.2, "{}", largest(&vague.pose, &none.pose));
    }
}

/// Linear least squares gives the joint's position between prior and detections.
#[test]
fn a_prior_and_the_detections_meet_according_to_their_variances() {
    let cameras = room(4);
    let truth = standing();
    let detections = exact_detections(&truth, &cameras);
    let rays = Rays::new(&detections, &cameras, &[]);
    let start: Vec<Vector3<f64>> = truth.iter().map(|x| x + Vector3::new(6.0, -4.0, 5.0)).collect();
    let settings =
        AnnealedSettings { sigma_per_noise: None, sigma_mm: 300.0, ..AnnealedSettings::default() };
    let config = RefineConfig { detection_sigma_px: Some(2.0), ..freely(settings) };
    let out = refine(&cameras, &with_prior(detections, start.clone(), 8.0), config);
    for j in 0..truth.len() {
        let sum: Matrix3<f64> = rays.of_joint(j).iter().map(Ray::information).sum();
        let (data, prior) = (sum / out.noise.powi(2), Matrix3::identity() / 64.0);
        let expected =
            truth[j] + (data + prior).try_inverse().unwrap() * prior * (start[j] - truth[j]);
        // k ≥ 1 − (9/600)², and the last step was below 1 % of the noise.
        assert!((out.pose[j] - expected).norm() < 5e-3, "{}", (out.pose[j] - expected).norm());
    }
}

#[test]
fn a_prior_keeps_a_joint_that_one_view_sees_near_its_start() {
    let cameras = room(4);
    let mut noise = Noise::new(3);
    let detections = noisy_detections(&standing(), &cameras, 3.0, &mut noise);
    let detections = without(&detections, |i, j| j == WRIST && i != 0);
    let start = perturbed(&standing(), 25.0, &mut noise);
    let ray = Rays::new(&detections, &cameras, &[]).of_joint(WRIST)[0];
    let out = refine(&cameras, &with_prior(detections, start.clone(), 25.0), free());
    let along = |x: &Vector3<f64>| ray.offset(x).range;
    assert!((along(&out.pose[WRIST]) - along(&start[WRIST])).abs() < 1e-6);
    let d = ray.direction;
    // Along the ray the prior dominates; the body's extent, some 600 mm, has hardly any weight.
    let variance = d.dot(&(out.uncertainty[WRIST] * d));
    assert!((variance.sqrt() - 25.0).abs() < 0.1, "{}", variance.sqrt());
}

#[test]
fn a_joint_whose_prior_is_nan_has_none() {
    let cameras = room(4);
    let mut noise = Noise::new(4);
    // Small enough that the kernels end below their largest width, despite the wrong priors of the
    // other joints.
    let detections = noisy_detections(&standing(), &cameras, 2.0, &mut noise);
    let mut frame = with_prior(detections.clone(), perturbed(&standing(), 25.0, &mut noise), 1e-3);
    frame.init_pose.as_mut().unwrap()[4] = Vector3::repeat(f64::NAN);
    frame.init_covariance.as_mut().unwrap()[5] = Matrix3::repeat(f64::NAN);
    let out = refine(&cameras, &frame, exactly());
    let none = refine(&cameras, &from(detections, None), exactly());
    for j in [4, 5] {
        assert!((out.pose[j] - none.pose[j]).norm() < 0.2, "joint {j}");
    }
}

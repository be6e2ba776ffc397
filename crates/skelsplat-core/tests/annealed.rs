//! The annealed solver: its loss, its weights, and the default method on scenes whose answer is known.

use std::sync::atomic::AtomicBool;

use nalgebra::{DMatrix, DVector, Matrix3, Vector2, Vector3};
use skelsplat_core::annealed::{Annealing, NoiseModel, Prior, Problem, Ray, Rays, Solution, solve};
use skelsplat_core::batch::{Progress, refine_batch};
use skelsplat_core::camera::Camera;
use skelsplat_core::detections::Detections;
use skelsplat_core::layout::Layout;
use skelsplat_core::overlap::PlaneGaussian;
use skelsplat_core::projection::View;
use skelsplat_core::refine::refiner::Frame;
use skelsplat_core::refine::{JointStatus, RefineConfig, Refinement, Refiner, StopReason};
use skelsplat_core::symmetry::LimbPair;
use skelsplat_core::testing::differences::{central_differences, relative_error};
use skelsplat_core::testing::scenes::{
    Noise, exact_detections, look_at, noisy_detections, perturbed, room, standing,
};
use skelsplat_core::triangulate::robust;
use skelsplat_core::unit::Unit;

const WRIST: usize = 13;

fn points(x: &[f64]) -> Vec<Vector3<f64>> {
    x.chunks_exact(3).map(Vector3::from_column_slice).collect()
}

fn flat(points: &[Vector3<f64>]) -> Vec<f64> {
    points.iter().flat_map(|p| [p.x, p.y, p.z]).collect()
}

fn rms(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    (a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum::<f64>() / a.len() as f64).sqrt()
}

fn largest(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// The default without symmetry, whose limbs of slightly unequal length would move exact data.
fn free() -> RefineConfig {
    RefineConfig { symmetry_tier: 0, ..RefineConfig::default() }
}

fn refine(cameras: &[Camera], frame: &Frame, config: RefineConfig) -> Refinement {
    let layout = Layout::by_name("h36m17").unwrap();
    let refiner = Refiner::new(cameras, Unit::Millimetre, Some(&layout), config).unwrap();
    refiner.refine(frame, false, &AtomicBool::new(false)).unwrap()
}

fn from(detections: Detections, init_pose: Option<Vec<Vector3<f64>>>) -> Frame {
    Frame { detections, init_pose, init_covariance: None }
}

fn with_prior(detections: Detections, pose: Vec<Vector3<f64>>, sigma: f64) -> Frame {
    let covariance = Matrix3::from_diagonal_element(sigma * sigma);
    let n = pose.len();
    Frame { detections, init_pose: Some(pose), init_covariance: Some(vec![covariance; n]) }
}

/// `detections` moved, dropped (`None`) or with another confidence by `f(view, joint, pixel)`.
fn changed(
    detections: &Detections,
    f: impl Fn(usize, usize, Vector2<f64>) -> Option<(Vector2<f64>, f64)>,
) -> Detections {
    let (m, n) = (detections.n_views(), detections.n_joints());
    let (mut pixels, mut confidence) = (Vec::new(), Vec::new());
    for (i, j) in (0..m).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let found = detections.get(i, j).and_then(|(p, _)| f(i, j, p));
        let (p, c) = found.unwrap_or((Vector2::repeat(f64::NAN), 1.0));
        pixels.extend([p.x, p.y]);
        confidence.push(c);
    }
    Detections::new(m, n, &pixels, Some(&confidence)).unwrap()
}

fn without(detections: &Detections, missing: impl Fn(usize, usize) -> bool) -> Detections {
    changed(detections, |i, j, p| (!missing(i, j)).then_some((p, 1.0)))
}

// ---- the loss -------------------------------------------------------------------------------------------------------

/// With the ray's nearest point y, r = (z_x / z_y) J W (x − y) holds exactly, and (J W)⁺ forgets what lies along x − c, so
/// that rᵀΣ⁻¹r = (z_x / z_y)² |e|² cos²θ / σ² with tan θ = |e| / range. Both factors differ from 1 by |e| / z or less.
#[test]
fn the_weight_is_that_of_the_closed_form_to_first_order() {
    let sigma = 40.0;
    let mut noise = Noise::new(5);
    for camera in room(3) {
        let view = View::new(&camera);
        for _ in 0..200 {
            let x = noise.vector(400.0) + Vector3::new(0.0, 0.0, 900.0);
            let seen = x + noise.vector(60.0);
            let pixel = camera.project(&seen).unwrap();
            let splat =
                view.project(&x, &Matrix3::from_diagonal_element(sigma * sigma), 0.0).unwrap();
            let target = PlaneGaussian { mean: pixel, covariance: splat.covariance };
            let render = PlaneGaussian { mean: splat.mean, covariance: splat.covariance };
            let closed = render.overlap(&target).unwrap().weight;

            let detections = Detections::new(1, 1, &[pixel.x, pixel.y], None).unwrap();
            let rays = Rays::new(&detections, std::slice::from_ref(&camera), &[]);
            let offset = rays.of_joint(0)[0].offset(&x);
            let weight = offset.weight(sigma);

            let (e, z) = (offset.across.norm(), camera.to_camera(&x).z);
            let nearest = camera.to_camera(&(x - offset.across)).z;
            let factor = (z / nearest).powi(2) / (1.0 + (e / offset.range).powi(2));
            assert!((closed.ln() / weight.ln() - factor).abs() < 1e-9);
            assert!(
                (closed.ln() / weight.ln() - 1.0).abs()
                    < 2.0 * e / nearest + 2.0 * (e / nearest).powi(2)
            );
            // k ln k is −1/e at most.
            assert!((closed - weight).abs() < 0.37 * 2.1 * e / nearest);
        }
    }
}

const LIMBS: [LimbPair; 2] = [([12, 13], [15, 16]), ([5, 6], [2, 3])];

/// Residuals linearised at a start by asking for no step.
fn linearised(
    rays: &Rays,
    priors: &[Prior],
    at: &[Vector3<f64>],
    sigma: f64,
    noise: f64,
) -> (Solution, Annealing) {
    let n = at.len();
    let annealing = Annealing {
        max_steps: 0,
        noise: NoiseModel::Millimetres(noise),
        ..Annealing::of_joints(n)
    };
    let problem = Problem { rays, pairs: &LIMBS, priors: Some(priors), annealing: &annealing };
    (solve(&problem, at.to_vec(), vec![sigma; n]), annealing)
}

/// F with Welsch losses for the detections and for the limbs: what the weights k and κ come from.
fn objective(
    rays: &Rays,
    priors: &[Prior],
    x: &[Vector3<f64>],
    sigma: f64,
    noise: f64,
    symmetry_sigma: f64,
) -> f64 {
    let mut f = 0.0;
    for (j, x) in x.iter().enumerate() {
        for ray in rays.of_joint(j).iter().filter(|ray| ray.is_there()) {
            f += ray.weight * 2.0 * (sigma / noise).powi(2) * (1.0 - ray.offset(x).weight(sigma));
        }
        let from = x - priors[j].mean;
        f += 0.5 * from.dot(&(priors[j].precision * from));
    }
    for ([a, b], [c, d]) in LIMBS {
        let difference = (x[a] - x[b]).norm() - (x[c] - x[d]).norm();
        let reach = 3.0 * symmetry_sigma;
        f += (reach / symmetry_sigma).powi(2) * (1.0 - (-0.5 * (difference / reach).powi(2)).exp());
    }
    f
}

#[test]
fn what_the_step_follows_is_the_gradient_of_f() {
    let (cameras, mut noise) = (room(4), Noise::new(6));
    let detections = noisy_detections(&standing(), &cameras, 6.0, &mut noise);
    let rays = Rays::new(&detections, &cameras, &[1.0, 0.7, 1.0, 0.3]);
    let at = perturbed(&standing(), 25.0, &mut noise);
    let precision = Matrix3::new(2e-3, 4e-4, 0.0, 4e-4, 1e-3, -3e-4, 0.0, -3e-4, 3e-3);
    let priors: Vec<Prior> =
        at.iter().map(|x| Prior { mean: x + noise.vector(20.0), precision }).collect();
    for (sigma, s) in [(320.0, 12.0), (40.0, 12.0), (25.0, 5.0)] {
        let (mut solution, annealing) = linearised(&rays, &priors, &at, sigma, s);
        let h = solution.equations.dense();
        let n = h.len().isqrt();
        let step = DVector::from_vec(flat(solution.equations.solve(|_| 0.0)));
        let gradient = -(DMatrix::from_row_slice(n, n, &h) * step);
        let symmetry_sigma = annealing.symmetry_sigma;
        let numeric = central_differences(&flat(&at), 1e-3, |x| {
            objective(
                &rays,
                &priors,
                &points(x),
                sigma,
                s * rays.mean_weight().sqrt(),
                symmetry_sigma,
            )
        });
        // F is some 1e3 and its gradient 1 per mm: rounding leaves 1e-10, truncation (h/σ)² = 2e-9.
        assert!(relative_error(gradient.as_slice(), &numeric) < 1e-7, "σ = {sigma}");
    }
}

// ---- recovery -------------------------------------------------------------------------------------------------------

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

/// The second start is 400 mm per axis off: the first step leaves nothing of it but the damping's share,
/// ŝ²/(320 mm)² ≈ 1e-3 of it, and every further step that share of the rest.
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
fn two_nearly_parallel_rays_leave_finite_numbers_across_them() {
    let target = Vector3::new(0.0, 0.0, 900.0);
    for baseline in [1e-3, 0.1, 2.0, 50.0] {
        let at = |x: f64| {
            look_at(
                Vector3::new(x, -5300.0, 1500.0),
                target + Vector3::x() * x,
                1145.0,
                [1000, 1000],
            )
        };
        let cameras = [at(0.0), at(baseline)];
        for seed in 0..20 {
            let mut noise = Noise::new(seed);
            let detections = noisy_detections(&standing(), &cameras, 1.0, &mut noise);
            let start = perturbed(&standing(), 30.0, &mut noise);
            let out = refine(&cameras, &from(detections.clone(), Some(start)), free());
            let ray = |j: usize| Rays::new(&detections, &cameras, &[]).of_joint(j)[0];
            for (j, x) in out.pose.iter().enumerate() {
                assert!(x.iter().all(|v| v.is_finite()));
                let offset = ray(j).offset(x);
                assert!(offset.range > 0.0, "baseline {baseline}, seed {seed}: behind the cameras");
                assert!(
                    offset.across.norm() < 60.0,
                    "baseline {baseline}: {}",
                    offset.across.norm()
                );
            }
            assert!(out.uncertainty.iter().all(|c| c.iter().all(|v| v.is_finite())));
            let triangulated = robust(&detections, &cameras);
            assert!(triangulated.points.iter().all(|x| x.x.is_nan() || x.norm() < 1e9));
        }
    }
}

// ---- one view -------------------------------------------------------------------------------------------------------

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

/// Limbs of equal length may move a joint along its only ray, but never away: an arm is no longer than its twin by more
/// than what the limbs' kernel spans, and where it began farther off it stays there.
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

// ---- limbs ----------------------------------------------------------------------------------------------------------

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

// ---- priors ---------------------------------------------------------------------------------------------------------

#[test]
fn a_prior_without_doubt_keeps_the_start() {
    let cameras = room(4);
    let detections = noisy_detections(&standing(), &cameras, 3.0, &mut Noise::new(1));
    let start = perturbed(&standing(), 30.0, &mut Noise::new(2));
    for sigma in [1e-3, 1e-6] {
        let out = refine(&cameras, &with_prior(detections.clone(), start.clone(), sigma), free());
        // A detection pulls with c k |e| / ŝ² ≤ 0.86 √2 σ / ŝ² each, some 4 · 40 / 100 per mm: times σ_init².
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
        let vague = refine(&cameras, &with_prior(detections.clone(), start, 1e6), free());
        let none = refine(&cameras, &from(detections, None), free());
        // Both stop when a step is below 1 % of the noise, some 0.1 mm.
        assert!(largest(&vague.pose, &none.pose) < 0.2, "{}", largest(&vague.pose, &none.pose));
    }
}

/// Linear least squares says where the joint lies between start and detections.
#[test]
fn a_prior_and_the_detections_meet_where_their_variances_say() {
    let cameras = room(4);
    let truth = standing();
    let detections = exact_detections(&truth, &cameras);
    let rays = Rays::new(&detections, &cameras, &[]);
    let start: Vec<Vector3<f64>> = truth.iter().map(|x| x + Vector3::new(6.0, -4.0, 5.0)).collect();
    let config =
        RefineConfig { detection_sigma: Some(2.0), sigma_per_noise: None, sigma: 300.0, ..free() };
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
    // Along the ray the prior speaks, and the body's reach, some 600 mm, hardly.
    let variance = d.dot(&(out.uncertainty[WRIST] * d));
    assert!((variance.sqrt() - 25.0).abs() < 0.1, "{}", variance.sqrt());
}

#[test]
fn a_joint_whose_prior_is_nan_has_none() {
    let cameras = room(4);
    let mut noise = Noise::new(4);
    let detections = noisy_detections(&standing(), &cameras, 3.0, &mut noise);
    let mut frame = with_prior(detections.clone(), perturbed(&standing(), 25.0, &mut noise), 1e-3);
    frame.init_pose.as_mut().unwrap()[4] = Vector3::repeat(f64::NAN);
    frame.init_covariance.as_mut().unwrap()[5] = Matrix3::repeat(f64::NAN);
    let out = refine(&cameras, &frame, free());
    let none = refine(&cameras, &from(detections, None), free());
    for j in [4, 5] {
        assert!((out.pose[j] - none.pose[j]).norm() < 0.2, "joint {j}");
    }
}

// ---- missing data, statuses, reasons --------------------------------------------------------------------------------

#[test]
fn a_joint_that_no_view_sees_keeps_its_start() {
    let cameras = room(4);
    let detections = without(&exact_detections(&standing(), &cameras), |_, j| j == WRIST);
    let start = perturbed(&standing(), 100.0, &mut Noise::new(1));
    for config in [RefineConfig::default(), free()] {
        let out = refine(&cameras, &from(detections.clone(), Some(start.clone())), config.clone());
        assert_eq!(out.joint_status[WRIST], JointStatus::Unobserved);
        assert_eq!(out.pose[WRIST], start[WRIST]);
        assert!(out.uncertainty[WRIST].iter().all(|v| v.is_nan()));
        assert!(out.view_weights.iter().skip(WRIST).step_by(17).all(|k| k.is_nan()));
        let out = refine(&cameras, &from(detections.clone(), None), config);
        assert_eq!(out.joint_status[WRIST], JointStatus::Unobserved);
        assert!(out.pose[WRIST].iter().all(|v| v.is_nan()));
        assert!(out.covariance[WRIST].iter().all(|v| !v.is_finite() || *v == 0.0));
        let rest = |p: &[Vector3<f64>]| [&p[..WRIST], &p[WRIST + 1..]].concat();
        assert!(largest(&rest(&out.pose), &rest(&standing())) < 5.0);
    }
}

/// With a prior it keeps it too, and its error bar is the prior.
#[test]
fn an_unseen_joint_with_a_prior_is_its_prior() {
    let cameras = room(4);
    let detections = without(&exact_detections(&standing(), &cameras), |_, j| j == WRIST);
    let start = perturbed(&standing(), 30.0, &mut Noise::new(1));
    let out = refine(&cameras, &with_prior(detections, start.clone(), 30.0), free());
    assert_eq!(out.joint_status[WRIST], JointStatus::Unobserved);
    assert!((out.pose[WRIST] - start[WRIST]).norm() < 1e-9);
    assert!((out.uncertainty[WRIST] - Matrix3::from_diagonal_element(900.0)).amax() < 1e-6);
}

#[test]
fn a_joint_with_one_view_and_no_start_stays_nan_and_weak() {
    let cameras = room(4);
    let detections = without(&exact_detections(&standing(), &cameras), |i, j| j == WRIST && i > 0);
    let out = refine(&cameras, &from(detections, None), RefineConfig::default());
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
    let out =
        refine(&cameras, &from(nothing.clone(), Some(start.clone())), RefineConfig::default());
    assert_eq!(out.stop_reason, StopReason::NoObservations);
    assert_eq!(out.pose, start);
    assert!(out.joint_status.iter().all(|s| *s == JointStatus::Unobserved));
    let out = refine(&cameras, &from(nothing, None), RefineConfig::default());
    assert_eq!(out.stop_reason, StopReason::NoObservations);
    assert!(out.pose.iter().all(|x| x.x.is_nan()));
}

#[test]
fn the_step_limit_is_an_outcome_with_finite_numbers() {
    let cameras = room(4);
    let detections = noisy_detections(&standing(), &cameras, 3.0, &mut Noise::new(1));
    let start = perturbed(&standing(), 100.0, &mut Noise::new(2));
    for max_steps in [0, 1, 2, 3] {
        for init in [Some(start.clone()), None] {
            let config = RefineConfig { max_steps, find_swaps: false, ..free() };
            let out = refine(&cameras, &from(detections.clone(), init), config);
            // The triangulation before, which has as many steps, may have found the pose.
            assert!(out.stop_reason == StopReason::MaxSteps || max_steps > 0);
            assert!(out.n_iter <= max_steps, "{} of {max_steps}", out.n_iter);
            assert!(out.loss.total.is_finite(), "{max_steps} steps: {:?}", out.loss);
            assert!(out.covariance.iter().all(|c| c.iter().all(|v| v.is_finite())));
            assert!(out.uncertainty.iter().all(|c| c.iter().all(|v| v.is_finite())));
        }
    }
}

/// A detection 300 mm off is not believed; with only one other left the joint is weak.
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

// ---- weights --------------------------------------------------------------------------------------------------------

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
        let config = RefineConfig { view_weights: weights, ..RefineConfig::default() };
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
    let config = RefineConfig { view_weights: Some(weights.to_vec()), ..RefineConfig::default() };
    let by_view = refine(&cameras, &from(detections.clone(), None), config.clone());
    let by_confidence = refine(&cameras, &from(confident.clone(), None), RefineConfig::default());
    assert_eq!(bits(&by_view.pose), bits(&by_confidence.pose));
    let both = refine(&cameras, &from(confident, None), config);
    let squared = weights.map(|w: f64| w * w).to_vec();
    let config = RefineConfig { view_weights: Some(squared), ..RefineConfig::default() };
    let expected = refine(&cameras, &from(detections.clone(), None), config);
    assert_eq!(bits(&both.pose), bits(&expected.pose));
    let plain = refine(&cameras, &from(detections, None), RefineConfig::default());
    assert!(rms(&plain.pose, &by_view.pose) > 1.0);
}

/// Whether all detections are given with confidence 1 or all with less says nothing about which of them to believe.
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
    };
    let a = refine(&cameras, &in_mm, RefineConfig::default());
    let refiner =
        Refiner::new(&metres, Unit::Metre, Some(&layout), RefineConfig::default()).unwrap();
    let b = refiner.refine(&in_m, false, &AtomicBool::new(false)).unwrap();
    let b_mm: Vec<Vector3<f64>> = b.pose.iter().map(|x| x * 1e3).collect();
    assert!(largest(&a.pose, &b_mm) < 1e-6);
    assert_eq!(a.n_iter, b.n_iter);
    assert!((a.noise - b.noise * 1e3).abs() < 1e-9 * a.noise);
    for (a, b) in a.uncertainty.iter().zip(&b.uncertainty) {
        assert!((a - b * 1e6).amax() < 1e-6 * a.amax());
    }
    assert!((a.loss.total / b.loss.total - 1.0).abs() < 1e-9);
}

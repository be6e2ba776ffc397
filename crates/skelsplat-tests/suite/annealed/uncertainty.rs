//! The posterior covariance against the scatter of simulated repetitions.

use super::*;

const REPETITIONS: usize = 600;

/// Repetitions of one person in normal noise of `px`, no symmetry: empirical scatter and estimated
/// covariances.
struct Repeated {
    /// Mean of (x − truth)(x − truth)ᵀ per joint.
    scatter: Vec<Matrix3<f64>>,
    /// Mean of the posterior covariances.
    told: Vec<Matrix3<f64>>,
    noise: f64,
}

fn repeated(cameras: &[Camera], px: f64, config: &RefineConfig, prior: Option<f64>) -> Repeated {
    let refiner = Refiner::new(cameras, Unit::Millimetre, None, config.clone()).unwrap();
    let n = standing().len();
    let mut out = Repeated {
        scatter: vec![Matrix3::zeros(); n],
        told: vec![Matrix3::zeros(); n],
        noise: 0.0,
    };
    let share = 1.0 / REPETITIONS as f64;
    for seed in 0..REPETITIONS {
        let mut noise = Noise::new(seed as u64);
        let detections = noisy_detections(&standing(), cameras, px, &mut noise);
        let frame = match prior {
            Some(s) => with_prior(detections, perturbed(&standing(), s, &mut noise), s),
            None => detections.into(),
        };
        let found = refiner.refine(&frame).unwrap();
        out.noise += found.noise * share;
        for (j, truth) in standing().iter().enumerate() {
            let error = found.pose[j] - truth;
            out.scatter[j] += error * error.transpose() * share;
            out.told[j] += found.uncertainty[j] * share;
        }
    }
    out
}

impl Repeated {
    /// Estimated over empirical standard deviation, root mean square over joints and axes.
    fn ratio(&self) -> f64 {
        let sum = |all: &[Matrix3<f64>]| all.iter().map(Matrix3::trace).sum::<f64>();
        (sum(&self.told) / sum(&self.scatter)).sqrt()
    }

    /// Mean of eᵀΣ⁻¹e: 3 if the covariances have the right size and the right shape.
    fn shape(&self) -> f64 {
        let one = |(told, scatter): (&Matrix3<f64>, &Matrix3<f64>)| {
            (told.try_inverse().unwrap() * scatter).trace()
        };
        let all = self.told.iter().zip(&self.scatter).map(one);
        all.sum::<f64>() / self.told.len() as f64
    }
}

fn plain() -> RefineConfig {
    let settings = AnnealedSettings { find_swaps: false, ..AnnealedSettings::default() };
    RefineConfig { symmetry_tier: 0, ..RefineConfig::from(settings) }
}

/// 600 repetitions of 51 coordinates: the ratio of standard deviations is known to 1/√(2·600·51) =
/// 0.4 %.
#[test]
fn error_bars_are_what_repetitions_scatter() {
    for views in [3, 6] {
        for px in [1.5, 3.0] {
            let config = RefineConfig { detection_sigma_px: Some(px), ..plain() };
            let known = repeated(&room(views), px, &config, None).ratio();
            assert!((known - 1.0).abs() < 0.05, "{views} views, known {px} px: {known:.3}");
        }
        let found = repeated(&room(views), 3.0, &plain(), None);
        assert!((found.ratio() - 1.0).abs() < 0.05, "{views} views: {:.3}", found.ratio());
        // Three coordinates, with a variance known to 10 %.
        assert!((found.shape() / 3.0 - 1.0).abs() < 0.10, "{views} views: {:.3}", found.shape());
    }
}

/// Three views leave half of the residuals over: the noise prior of 3 px has some weight there, and
/// at 6 px (28 mm) the final kernel of 30 mm cuts into the noise.
#[test]
fn error_bars_follow_the_noise() {
    for (views, px) in [(3, 1.5), (6, 1.5), (3, 6.0), (6, 6.0)] {
        let found = repeated(&room(views), px, &plain(), None);
        assert!((found.ratio() - 1.0).abs() < 0.12, "{views} views, {px} px: {:.3}", found.ratio());
    }
}

#[test]
fn error_bars_count_the_prior() {
    for (views, px, sigma) in [(3, 3.0, 20.0), (6, 3.0, 10.0), (3, 6.0, 10.0)] {
        let alone = repeated(&room(views), px, &plain(), None);
        let found = repeated(&room(views), px, &plain(), Some(sigma));
        assert!((found.ratio() - 1.0).abs() < 0.05, "{views} views, {px} px: {:.3}", found.ratio());
        let volume = |r: &Repeated| r.told.iter().map(Matrix3::trace).sum::<f64>();
        assert!(volume(&found) < 0.95 * volume(&alone));
    }
}

/// One camera and an independent pose: along the rays only the prior contributes, across them both
/// do.
#[test]
fn error_bars_of_one_view_with_a_prior_are_what_repetitions_scatter() {
    for px in [1.5, 3.0] {
        let config = RefineConfig { detection_sigma_px: Some(px), ..plain() };
        let found = repeated(&room(1), px, &config, Some(30.0));
        assert!((found.ratio() - 1.0).abs() < 0.05, "given {px} px: {:.3}", found.ratio());
        assert!((found.shape() / 3.0 - 1.0).abs() < 0.12, "given {px} px: {:.3}", found.shape());
    }
    let found = repeated(&room(1), 3.0, &plain(), Some(30.0));
    assert!((found.ratio() - 1.0).abs() < 0.05, "{:.3}", found.ratio());
    // The noise is known only from the prior of 3 px.
    assert!((found.shape() / 3.0 - 1.0).abs() < 0.25, "{:.3}", found.shape());
}

/// Refined from `init`, without a layout.
fn refined(cameras: &[Camera], detections: Detections, init: Vec<Vector3<f64>>) -> Refinement {
    let frame = Frame { init_pose: Some(init), ..detections.into() };
    let refiner = Refiner::new(cameras, Unit::Millimetre, None, plain()).unwrap();
    refiner.refine(&frame).unwrap()
}

/// Noisy detections in four views of which only the second sees `joints`.
fn seen_once(cameras: &[Camera], joints: &[usize]) -> Detections {
    let detections = noisy_detections(&standing(), cameras, 3.0, &mut Noise::new(1));
    without(&detections, |i, j| joints.contains(&j) && i != 1)
}

/// Direction of the second view's ray to joint `j`.
fn direction(seen: &Detections, cameras: &[Camera], j: usize) -> Vector3<f64> {
    Rays::new(seen, cameras, &[]).of_joint(j)[1].direction
}

/// Standard deviation of joint `j` along `d`.
fn along(found: &Refinement, j: usize, d: &Vector3<f64>) -> f64 {
    d.dot(&(found.uncertainty[j] * d)).sqrt()
}

/// Along the only ray of a joint the error bar is as long as the body, across it as short as for a
/// detection.
#[test]
fn a_joint_with_one_view_is_uncertain_along_its_ray() {
    let cameras = room(4);
    let seen = seen_once(&cameras, &[WRIST]);
    let ray = direction(&seen, &cameras, WRIST);
    let found = refined(&cameras, seen, standing());
    let along = along(&found, WRIST, &ray);
    let middle = standing().iter().sum::<Vector3<f64>>() / 17.0;
    let spread = standing().iter().map(|x| (x - middle).norm_squared()).sum::<f64>() / 17.0;
    assert!((along / spread.sqrt() - 1.0).abs() < 0.05, "{along} mm");
    let across = (found.uncertainty[WRIST].trace() - along * along) / 2.0;
    assert!(across.sqrt() < 30.0, "{} mm", across.sqrt());
    let seen = refined(&cameras, seen_once(&cameras, &[]), standing());
    assert!(seen.uncertainty[WRIST].trace().sqrt() < 0.1 * along);
}

#[test]
fn a_view_that_disagrees_widens_the_bar() {
    let cameras = room(4);
    let detections = noisy_detections(&standing(), &cameras, 1.0, &mut Noise::new(2));
    let before = refined(&cameras, detections.clone(), standing());
    // 40 mm: a weight of one half.
    let moved = changed(&detections, |i, j, p| {
        Some((if (i, j) == (0, 5) { p + 6.0 * Vector2::x() } else { p }, 1.0))
    });
    let after = refined(&cameras, moved, standing());
    let wider = |j: usize| (after.uncertainty[j].trace() / before.uncertainty[j].trace()).sqrt();
    assert!(wider(5) > 1.3 && wider(5) > 1.2 * wider(10), "{} {}", wider(5), wider(10));
}

/// A wrist that one view sees, placed by its start or a limb up to 3 m behind the body: the error
/// bar reaches back to it.
#[test]
fn a_bar_along_a_ray_reaches_back_to_the_body() {
    let cameras = room(4);
    let seen = seen_once(&cameras, &[WRIST]);
    let ray = direction(&seen, &cameras, WRIST);
    let truth = standing()[WRIST];
    for beyond in [0.0, 1500.0, 3000.0] {
        let mut init = standing();
        init[WRIST] += beyond * ray;
        let found = refined(&cameras, seen.clone(), init);
        assert!(((found.pose[WRIST] - truth).norm() - beyond).abs() < 50.0);
        let along = along(&found, WRIST, &ray);
        let error = ray.dot(&(found.pose[WRIST] - truth));
        // With a spread s and b beyond 2 s of the middle, where the truth is: (2 s + b)² ≤ 5 (s² +
        // b²).
        assert!(error.abs() < 3.0 * along, "{error} mm off, bar {along} mm");
        assert!(along < 1000.0 + beyond, "{along} mm");
    }
}

/// The body consists of the joints with a known depth: one that is 3 m off does not enlarge it.
#[test]
fn a_joint_without_a_depth_is_no_part_of_the_body() {
    const ANKLE: usize = 3;
    let cameras = room(4);
    let seen = seen_once(&cameras, &[WRIST, ANKLE]);
    let [ray, d] = [WRIST, ANKLE].map(|j| direction(&seen, &cameras, j));
    let along = |away: f64| {
        let mut init = standing();
        init[WRIST] += away * ray;
        along(&refined(&cameras, seen.clone(), init), ANKLE, &d)
    };
    assert!((along(3000.0) / along(0.0) - 1.0).abs() < 1e-3);
}

/// A prior that confines a joint to a plane, with conditions of 1e9 to 1e13: no eigenvalue is lost
/// to rounding.
#[test]
fn covariances_are_positive_under_priors_of_any_condition() {
    for (seed, variances) in
        [(1, [1e-6, 1e3, 1e3]), (2, [1e-8, 10.0, 10.0]), (3, [1e-8, 10.0, 1e5])]
    {
        for n in [1, 2, 4] {
            let cameras = room(n);
            let mut noise = Noise::new(seed);
            let detections = noisy_detections(&standing(), &cameras, 2.0, &mut noise);
            let mut prior = || {
                let axes = Matrix3::from_fn(|_, _| noise.normal()).qr().q();
                let c = axes * Matrix3::from_diagonal(&variances.into()) * axes.transpose();
                0.5 * (c + c.transpose())
            };
            let covariances: Vec<Matrix3<f64>> = (0..17).map(|_| prior()).collect();
            let frame =
                Frame { init_covariance: Some(covariances), ..from(detections, Some(standing())) };
            let refiner =
                Refiner::new(&cameras, Unit::Millimetre, None, RefineConfig::default()).unwrap();
            let found = refiner.refine(&frame).unwrap();
            for covariance in &found.uncertainty {
                assert!((covariance - covariance.transpose()).amax() < 1e-9 * covariance.amax());
                assert!(covariance.symmetric_eigenvalues().min() > 0.0, "{n} views {variances:?}");
            }
        }
    }
}

//! The errors of detections in a recording, from detections that err by known amounts.

use nalgebra::{Matrix3, Vector3};
use skelsplat_core::JointStatus;
use skelsplat_core::study::annealed::{Alone, Ray, Rays};
use skelsplat_core::study::outcome::ErrorBars;
use skelsplat_core::study::sequence::noise::{DetectionNoise, Kernel};
use skelsplat_core::study::sequence::process_noise::ProcessNoise;
use skelsplat_core::study::sequence::scales::Residuals;
use skelsplat_core::study::sequence::solver::{Common, WindowSolver};
use skelsplat_core::study::sequence::tracks::Tracks;
use skelsplat_tests::scenes::Noise;

/// The usual noise, mm, the largest error of wrong detections, and frames per second.
const ERROR: f64 = 8.0;
const FAR: f64 = 250.0;
const FPS: f64 = 30.0;
/// Two joints, of two classes each, in five views.
const CLASSES: [usize; 4] = [0, 0, 2, 2];
const VIEWS: usize = 5;

/// Joints at the origin, seen from all sides; detections of joint j in view i err by `noise(j, i)`,
/// and a share of them by any distance.
fn frame(wrong: f64, error: impl Fn(usize, usize) -> f64, noise: &mut Noise) -> Alone {
    let mut ray = |j: usize, i: usize| {
        let angle = std::f64::consts::TAU * i as f64 / VIEWS as f64;
        let direction = Vector3::new(angle.cos(), angle.sin(), 0.3).normalize();
        let mut off = noise.vector(error(j, i));
        if noise.uniform() < wrong {
            let across = noise.vector(1.0);
            let across = across - direction * direction.dot(&across);
            off = across.normalize() * noise.uniform() * FAR;
        }
        Ray { centre: off - 4000.0 * direction, direction, weight: 1.0, pixel: 1e-3 }
    };
    let joints = CLASSES.len();
    let rays = (0..joints).flat_map(|j| (0..VIEWS).map(move |i| (j, i)));
    Alone {
        rays: Rays::of(rays.map(|(j, i)| ray(j, i)).collect(), VIEWS),
        used_for: (0..VIEWS).flat_map(|_| 0..joints).collect(),
        points: vec![Vector3::zeros(); joints],
        bars: ErrorBars {
            covariances: vec![4.0 * Matrix3::identity(); joints],
            believed: Vec::new(),
            noise: ERROR,
            status: vec![JointStatus::Ok; joints],
        },
    }
}

/// The noise, and its factors in time, that 600 frames show at the true position, where frame t
/// errs by `error(t, j, i)`.
fn shown(wrong: f64, error: impl Fn(usize, usize, usize) -> f64) -> (DetectionNoise, Vec<f64>) {
    let mut noise = Noise::new(3);
    let frames: Vec<Alone> =
        (0..600).map(|t| frame(wrong, |j, i| error(t, j, i), &mut noise)).collect();
    let kernel = Kernel { sigma: vec![30.0; 4], per_noise: Some(2.0), usual: 30.0, least: 0.0 };
    let before = DetectionNoise::uniform(vec![1.0; VIEWS], ERROR * ERROR, kernel);
    let tracks = Tracks::new(&[&frames], 30, &before);
    let common = Common {
        fps: FPS,
        process_noise: vec![ProcessNoise::steady(1e4); 4],
        noise: before.clone(),
        reach: 400.0,
        ..Common::default()
    };
    let start = vec![Vector3::zeros(); 4 * frames.len()];
    let mut run = WindowSolver::new(&tracks, &common, Some(start));
    run.linearise(4.0);
    // The positions are true: they take nothing.
    let residuals = Residuals::of(&run, 4.0, 0.0);
    let found = before.learnt(&residuals, &CLASSES);
    let factors = found.in_time(&residuals, FPS);
    (found, factors)
}

#[test]
fn every_class_and_every_view_has_its_noise_whatever_is_wrong() {
    let error = |_: usize, j: usize, i: usize| {
        ERROR * if j < 2 { 1.0 } else { 3.0 } * if i == 1 { 2.0 } else { 1.0 }
    };
    for wrong in [0.0, 0.1, 0.3] {
        let (found, factors) = shown(wrong, error);
        for (c, variance) in found.variance.iter().enumerate() {
            let (sigma, expected) = (variance.sqrt(), error(0, c / VIEWS, c % VIEWS));
            assert!((sigma / expected).ln().abs() < 0.2, "{wrong}, {c}: {sigma}, {expected}");
        }
        let most = factors.iter().map(|f| f.ln().abs()).fold(0.0, f64::max);
        assert!(most < 0.4, "{wrong}: {most}");
    }
}

#[test]
fn noise_varies_slowly_in_time() {
    let (found, factors) = shown(0.1, |t, _, i| ERROR * if t >= 300 && i != 0 { 4.0 } else { 1.0 });
    let sigma = |t: usize, i: usize| (found.variance[i] * factors[i * 600 + t]).sqrt();
    for (t, i, expected) in [(150, 0, 8.0), (150, 3, 8.0), (450, 0, 8.0), (450, 3, 32.0)] {
        let found = sigma(t, i);
        assert!((found / expected).ln().abs() < 0.25, "{t}, {i}: {found} for {expected}");
    }
}

#[test]
fn a_view_does_not_vote_for_itself() {
    let (found, _) = shown(0.0, |_, _, _| ERROR);
    let even = DetectionNoise::uniform(vec![1.0; VIEWS], ERROR * ERROR, found.kernel);
    let mut biased = even.clone();
    biased.confidence[0] = 0.1;
    // A view whose confidences are ten times as high as those of the others weighs the same.
    let alone = frame(0.0, |_, _| ERROR, &mut Noise::new(4));
    let mut high = alone.clone();
    let rays: Vec<Ray> = (0..4)
        .flat_map(|j| alone.rays.of_joint(j).iter().copied().enumerate())
        .map(|(i, ray)| Ray { weight: if i == 0 { 0.1 } else { 1.0 }, ..ray })
        .collect();
    high.rays = Rays::of(rays, VIEWS);
    let weights = |frame: &Alone, noise: &DetectionNoise| {
        Tracks::new(&[std::slice::from_ref(frame)], 30, noise).weights
    };
    assert_eq!(weights(&high, &biased), weights(&alone, &even));
}

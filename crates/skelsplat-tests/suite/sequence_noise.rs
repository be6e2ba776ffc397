//! The errors of detections in a recording, from detections that err by known amounts.

use nalgebra::{Matrix3, Vector3};
use skelsplat_core::JointStatus;
use skelsplat_core::study::annealed::{Alone, Ray, Rays};
use skelsplat_core::study::sequence::noise::DetectionNoise;
use skelsplat_core::study::sequence::process_noise::ProcessNoise;
use skelsplat_core::study::sequence::solver::{Common, WindowSolver};
use skelsplat_core::study::sequence::tracks::Tracks;
use skelsplat_core::testing::scenes::Noise;

/// Kernel and noise, mm, and the largest error of wrong detections.
const SIGMA: f64 = 30.0;
const ERROR: f64 = 8.0;
const FAR: f64 = 250.0;

/// A joint at the origin, seen from all sides by `views`; each detection errs by noise, and a share
/// of them by any distance.
fn frame(views: usize, wrong: f64, noise: &mut Noise) -> Alone {
    let mut ray = |i: usize| {
        let angle = std::f64::consts::TAU * i as f64 / views as f64;
        let direction = Vector3::new(angle.cos(), angle.sin(), 0.3).normalize();
        let mut off = noise.vector(ERROR);
        if noise.uniform() < wrong {
            let across = noise.vector(1.0);
            let across = across - direction * direction.dot(&across);
            off = across.normalize() * noise.uniform() * FAR;
        }
        Ray { centre: off - 4000.0 * direction, direction, weight: 1.0, pixel: 1e-3 }
    };
    Alone {
        rays: Rays::of((0..views).map(&mut ray).collect(), views),
        used_for: vec![0; views],
        points: vec![Vector3::zeros()],
        spread: vec![4.0 * Matrix3::identity()],
        status: vec![JointStatus::Ok],
        noise: ERROR,
    }
}

/// What 600 frames show, at the true position.
fn shown(views: usize, wrong: f64) -> DetectionNoise {
    let mut noise = Noise::new(3);
    let frames: Vec<Alone> = (0..600).map(|_| frame(views, wrong, &mut noise)).collect();
    let tracks = Tracks::new(&[&frames], 30, SIGMA);
    let common = Common {
        fps: 30.0,
        process_noise: vec![ProcessNoise::steady(1e4)],
        weight: 1.0,
        variance: vec![ERROR * ERROR],
        sigma: vec![SIGMA],
        reach: 400.0,
        ..Common::default()
    };
    let mut run = WindowSolver::new(&tracks, &common, Some(vec![Vector3::zeros(); frames.len()]));
    run.linearise(1.0);
    DetectionNoise::of(&run, &tracks, &common)
}

#[test]
fn wrong_detections_are_told_from_noise() {
    let sound = shown(5, 0.0);
    assert!((sound.share - 1.0).abs() < 1e-12, "{}", sound.share);
    for wrong in [0.1, 0.2, 0.4] {
        let found = shown(5, wrong);
        let much = found.variance[0] / sound.variance[0];
        let (too_much, left) = (much - 1.0, found.share * much - 1.0);
        // A tenth of what was too much, and three standard deviations of a variance from 5000
        // degrees of freedom.
        let bound = 0.1 * too_much + 0.06;
        assert!(too_much > wrong && left.abs() < bound, "{wrong}: {too_much}, {left}");
    }
}

#[test]
fn of_two_views_none_is_outvoted() {
    let [sound, found] = [0.0, 0.2].map(|wrong| shown(2, wrong).share);
    assert!(sound < 1.0 && (sound - found).abs() < 1e-12, "{sound}, {found}");
}

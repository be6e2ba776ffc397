//! The optimiser of the published method, its schedules and when it stops.

use nalgebra::Vector3;
use skelsplat_core::study::gaussian::{Gaussian, GaussianGradient};
use skelsplat_core::study::paper::adam::{Adam, LearningRates};
use skelsplat_core::study::paper::optimise::{WindowMinimum, decayed, views_in_turn};

const RATES: LearningRates = LearningRates { position: 3.0, log_scale: 0.005, rotation: 0.001 };

#[test]
fn first_step_has_the_length_of_the_learning_rate() {
    // m̂/√v̂ = ±1 on the first step whatever the gradient's size.
    let mut g = [Gaussian::isotropic(Vector3::zeros(), 20.0)];
    let before = g[0];
    let mut d = GaussianGradient::default();
    d.mean.x = 1e-4;
    d.log_scales.y = -7.0;
    d.quaternion[3] = 2.0;
    Adam::new(1, [0.9, 0.999], 1e-15).step(&mut g, &[d], RATES);
    assert!((g[0].mean.x + 3.0).abs() < 1e-9);
    assert!((g[0].log_scales.y - before.log_scales.y - 0.005).abs() < 1e-12);
    assert!((g[0].quaternion[3] + 0.001).abs() < 1e-12);
}

#[test]
fn decay_reaches_its_factor() {
    let lr = |t| decayed(3.0, 0.01, 1000.0, t);
    assert!((lr(0) - 3.0).abs() < 1e-15);
    assert!((lr(1000) - 0.03).abs() < 1e-15);
    assert!((lr(500) - 0.3).abs() < 1e-14);
}

#[test]
fn views_take_turns() {
    let mut active = [false; 3];
    let seen: Vec<_> = (0..3)
        .map(|t| {
            views_in_turn(t, 2, &mut active);
            active
        })
        .collect();
    assert_eq!(seen, [[true, true, false], [true, false, true], [false, true, true]]);
}

#[test]
fn compares_the_minima_of_consecutive_windows() {
    let mut stop = WindowMinimum::new(2, 0.1);
    // Windows (5, 4), (4.5, 3), (3.05, 9): minima 4, 3, 3.05.
    let told: Vec<bool> = [5.0, 4.0, 4.5, 3.0, 3.05, 9.0].map(|l| stop.settled(l)).to_vec();
    assert_eq!(told, [false, false, false, false, false, true]);
}

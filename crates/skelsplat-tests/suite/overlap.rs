//! The closed-form loss against the numerical integral and central differences.

use nalgebra::{Matrix2, Vector2};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use skelsplat_core::study::overlap::PlaneGaussian;
use skelsplat_tests::differences::central_differences;

fn gaussian(mean: [f64; 2], spread: [f64; 2], angle: f64) -> PlaneGaussian {
    let r = nalgebra::Rotation2::new(angle);
    let s = Matrix2::from_diagonal(&Vector2::from(spread).map(|s| s * s));
    PlaneGaussian { mean: Vector2::from(mean), covariance: r * s * r.inverse() }
}

fn value(g: &PlaneGaussian, at: Vector2<f64>) -> f64 {
    let x = at - g.mean;
    (-0.5 * x.dot(&(g.covariance.try_inverse().unwrap() * x))).exp()
}

/// Σ (R−P)² over pixels. For a smooth function whose spectrum has died away at the sampling
/// frequency the sum is the integral: (R−P)² of σ ≥ 3 px is below exp(−π²·9) at frequency 1, beyond
/// doubles; the 40 px border leaves exp(−(40/6)²) outside.
#[test]
fn is_the_integral_of_the_squared_difference() {
    let render = gaussian([1.3, -0.4], [3.0, 5.0], 0.7);
    for target in [
        gaussian([0.2, 1.9], [4.0, 3.5], -0.3),
        gaussian([1.3, -0.4], [3.0, 5.0], 0.7),
        gaussian([9.0, 4.0], [3.0, 3.0], 0.0),
    ] {
        let pixels = (-50..=50).flat_map(|v| (-50..=50).map(move |u| (u, v)));
        let sum: f64 = pixels
            .map(|(u, v)| {
                let at = Vector2::new(f64::from(u), f64::from(v));
                (value(&render, at) - value(&target, at)).powi(2)
            })
            .sum();
        let found = render.overlap(&target).unwrap();
        assert!((found.loss - sum).abs() < 1e-11 * render.energy(), "{} {sum}", found.loss);
    }
}

#[test]
fn equal_shapes_give_the_welsch_loss() {
    let target = gaussian([0.0, 0.0], [6.0, 6.0], 0.0);
    let render = gaussian([3.0, 4.0], [6.0, 6.0], 0.0);
    let expected = 2.0 * target.energy() * (1.0 - (-0.25 * 25.0 / 36.0_f64).exp());
    let found = render.overlap(&target).unwrap();
    assert!((found.loss - expected).abs() < 1e-12 * expected);
    assert!((found.weight - (-0.25 * 25.0 / 36.0_f64).exp()).abs() < 1e-15);
}

#[test]
fn a_covariance_without_an_inverse_has_no_overlap() {
    let flat = PlaneGaussian { mean: Vector2::zeros(), covariance: Matrix2::zeros() };
    assert_eq!(flat.overlap(&gaussian([0.0, 0.0], [3.0, 3.0], 0.0)), None);
}

proptest! {
    #![proptest_config(ProptestConfig {
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(7),
        ..ProptestConfig::default()
    })]

    /// Central differences with h = 1e-4 of lengths of some px: O(h²) and ulp/h both leave 1e-8 of
    /// the energy.
    #[test]
    fn gradients_are_central_differences(
        by in prop::array::uniform2(-12.0..12.0_f64),
        spread in prop::array::uniform2(1.0..9.0_f64),
        angle in 0.0..3.2_f64,
    ) {
        let target = gaussian([0.0, 0.0], [4.0, 6.0], 1.0);
        let render = gaussian(by, spread, angle);
        let found = render.overlap(&target).unwrap();
        prop_assert!((0.0..=1.0).contains(&found.weight) && found.loss >= -1e-12 * target.energy());
        let numeric = central_differences(render.mean.as_slice(), 1e-4, |x| {
            let moved = PlaneGaussian { mean: Vector2::from_column_slice(x), ..render };
            moved.overlap(&target).unwrap().loss
        });
        let off = found.d_mean.iter().zip(&numeric).map(|(a, b)| (a - b).abs());
        prop_assert!(off.fold(0.0, f64::max) < 1e-7 * target.energy());
        let numeric = central_differences(render.covariance.as_slice(), 1e-4, |x| {
            let moved = PlaneGaussian { covariance: Matrix2::from_column_slice(x), ..render };
            moved.overlap(&target).unwrap().loss
        });
        let off = found.d_covariance.iter().zip(&numeric).map(|(a, b)| (a - b).abs());
        prop_assert!(off.fold(0.0, f64::max) < 1e-7 * target.energy());
    }
}

//! Hierarchical scales of the detections' noise.

use skelsplat_core::study::noise::Scales;

const EXPECTED: f64 = 9.0;
const VIEWS: usize = 4;
const JOINTS: usize = 12;

fn scales() -> Scales {
    let scales = Scales::new(VIEWS * JOINTS, 4.0);
    scales.by(|c| c % VIEWS, 6.0).by(|c| c / VIEWS, 3.0).by(|c| c, 10.0)
}

/// Squares of cells with these variances, exactly as large as expected.
fn squares(variance: impl Fn(usize) -> f64, freedom: &[f64]) -> Vec<f64> {
    freedom.iter().enumerate().map(|(c, nu)| nu * variance(c)).collect()
}

#[test]
fn without_residuals_every_variance_is_the_expected_one() {
    let none = vec![0.0; VIEWS * JOINTS];
    let mut scales = scales();
    assert!(scales.fit(&none, &none, EXPECTED).iter().all(|v| (v - EXPECTED).abs() < 1e-9));
}

#[test]
fn a_noisy_view_and_a_noisy_joint_are_told_apart() {
    let truth = |c: usize| {
        16.0 * if c % VIEWS == 1 { 25.0 } else { 1.0 } * if c / VIEWS == 3 { 9.0 } else { 1.0 }
    };
    let many = vec![1000.0; VIEWS * JOINTS];
    let mut scales = scales();
    for (c, variance) in scales.fit(&squares(truth, &many), &many, EXPECTED).iter().enumerate() {
        assert!((variance / truth(c) - 1.0).abs() < 0.05, "{c}: {variance} of {}", truth(c));
    }
}

#[test]
fn few_residuals_count_less_than_many() {
    let of = |count: f64| {
        let freedom = vec![count; VIEWS * JOINTS];
        let noisy = |c: usize| if c / VIEWS == 3 { 400.0 } else { EXPECTED };
        scales().fit(&squares(noisy, &freedom), &freedom, EXPECTED)[3 * VIEWS]
    };
    assert!(EXPECTED < of(0.3) && of(0.3) < of(2.0) && of(2.0) < of(50.0) && of(50.0) < 400.0);
}

#[test]
fn the_factors_are_at_the_minimum() {
    let freedom: Vec<f64> = (0..VIEWS * JOINTS).map(|c| 0.3 * (c % 7) as f64).collect();
    let squares = squares(|c| 1.0 + (c % 5) as f64 * 4.0, &freedom);
    let mut scales = scales();
    scales.fit(&squares, &freedom, EXPECTED);
    for level in 0..4 {
        for g in 0..scales.factors(level).len() {
            let shifted = |by: f64| {
                let mut other = scales.clone();
                let mut factors = scales.factors(level).to_vec();
                factors[g] *= f64::exp(by);
                other.set_factors(level, &factors);
                other.objective(&squares, &freedom, EXPECTED)
            };
            let slope = (shifted(1e-4) - shifted(-1e-4)) / 2e-4;
            assert!(slope.abs() < 1e-5, "level {level}, group {g}: {slope}");
        }
    }
}

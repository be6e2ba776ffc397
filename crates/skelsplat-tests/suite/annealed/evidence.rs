//! Large noise or wrong detections: which of two explanations the frame supports.

use super::*;
use skelsplat_core::study::annealed::evidence::{Evidence, evidence_at};
use skelsplat_core::study::bones::expected::Expected;

const WIDEST: f64 = 320.0;

/// `standing` in four cameras, moved by `wrong(view, joint)` px.
fn frame(px: f64, seed: u64, wrong: impl Fn(usize, usize) -> f64) -> Detections {
    let detections = noisy_detections(&standing(), &room(4), px, &mut Noise::new(seed));
    changed(&detections, |i, j, p| {
        let angle = (7 * i + 3 * j) as f64;
        Some((p + wrong(i, j) * Vector2::new(angle.cos(), angle.sin()), 1.0))
    })
}

/// Noise, mm, and positions of the joints one by one.
fn solved(detections: &Detections) -> (f64, Vec<Vector3<f64>>) {
    let frame = AnnealedFrame {
        cameras: &room(4),
        detections,
        view_weights: &[],
        pairs: &[],
        chains: &[],
        expected: &Expected::default(),
        annealing: Annealing::of_joints(17),
        before: None,
        in_recording: false,
    };
    let found = frame.solve();
    (found.bars.noise, found.outcome.points)
}

#[test]
fn large_noise_is_noise() {
    for seed in 0..5 {
        // 20 px are 93 mm; 68 residuals in two axes less 51 know it to 9 %, and the share that is
        // no noise to as much.
        let (noise, _) = solved(&frame(20.0, seed, |_, _| 0.0));
        assert!((noise / 93.0 - 1.0).abs() < 0.35, "{noise}");
    }
}

#[test]
fn small_noise_with_gross_errors_is_small_noise() {
    for seed in 0..5 {
        // One detection of every second joint is 60 to 150 px off, 300 to 700 mm.
        let wrong = |i: usize, j: usize| {
            let off = j.is_multiple_of(2) && i == j % 4 / 2 + j / 8;
            if off { 60.0 + 5.0 * j as f64 } else { 0.0 }
        };
        let (noise, points) = solved(&frame(2.0, seed, wrong));
        assert!(noise < 25.0, "seed {seed}: {noise}");
        // A wrong ray may happen to meet those of two cameras that face each other: three against
        // one.
        let off = |j: &usize| (points[*j] - standing()[*j]).norm() > 100.0;
        assert!((0..17).filter(off).count() <= 1, "seed {seed}");
    }
}

/// The evidence at the truth with 2 px of noise.
fn at_the_truth(detections: &Detections, priors: &[Prior]) -> Evidence {
    let rays = Rays::new(detections, &room(4), &[]);
    evidence_at(&rays, &standing(), 9.4 * 9.4, priors, WIDEST)
}

/// The true share of wrong detections is found, with a prior of one in two.
#[test]
fn the_share_of_wrong_detections_is_found() {
    let wrong = |i: usize, j: usize| if i == 1 && j.is_multiple_of(2) { 100.0 } else { 0.0 };
    let found = at_the_truth(&frame(2.0, 3, wrong), &[]);
    assert!((found.wrong - 10.0 / 70.0).abs() < 0.02, "{}", found.wrong);
}

/// Priors that contradict the pose count against it.
#[test]
fn priors_are_evidence() {
    let detections = frame(2.0, 2, |_, _| 0.0);
    let prior = |x: &Vector3<f64>, off: f64| Prior {
        mean: x + Vector3::new(off, 0.0, 0.0),
        precision: Matrix3::from_diagonal_element(1e-2),
        spread: 10.0,
    };
    let log = |off: f64| {
        let priors: Vec<Prior> = standing().iter().map(|x| prior(x, off)).collect();
        at_the_truth(&detections, &priors).log
    };
    // ½ (30/10)² for each of 17 joints.
    assert!((log(0.0) - log(30.0) - 17.0 * 4.5).abs() < 1e-9);
}

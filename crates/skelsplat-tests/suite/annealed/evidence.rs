//! Large noise or wrong detections: which of two solutions the frame supports.

use super::*;
use skelsplat_core::study::annealed::locate::{anywhere, locate};

/// Rays of `standing` in four cameras, moved by `wrong(view, joint)` px.
fn frame(px: f64, seed: u64, wrong: impl Fn(usize, usize) -> f64) -> Rays {
    let cameras = room(4);
    let detections = noisy_detections(&standing(), &cameras, px, &mut Noise::new(seed));
    let detections = changed(&detections, |i, j, p| {
        let angle = (7 * i + 3 * j) as f64;
        Some((p + wrong(i, j) * Vector2::new(angle.cos(), angle.sin()), 1.0))
    });
    Rays::new(&detections, &cameras, &[])
}

fn narrow_and_wide(rays: &Rays) -> [Solution; 2] {
    let annealing = Annealing::of_joints(17);
    [Widening::NONE, Widening::FREE].map(|widening| {
        let problem =
            Problem { rays, pairs: &[], bones: &[], priors: None, annealing: &annealing, widening };
        solve(&problem, &standing(), &[f64::INFINITY; 17])
    })
}

fn prefers_wide(rays: &Rays) -> bool {
    let widest = anywhere(rays, &Annealing::of_joints(17));
    let [narrow, wide] = narrow_and_wide(rays).map(|s| evidence(rays, &s, None, widest).log);
    wide > narrow
}

#[test]
fn large_noise_is_noise() {
    for seed in 0..5 {
        let rays = frame(20.0, seed, |_, _| 0.0);
        assert!(prefers_wide(&rays), "seed {seed}");
        let found = locate(&rays, &Annealing::of_joints(17));
        assert!(found.widening.follows_noise);
        // 20 px are 93 mm; 68 residuals in two axes less 51 know it to 9 %, and the share that is
        // no noise to as much.
        assert!((found.solution.noise / 93.0 - 1.0).abs() < 0.35, "{}", found.solution.noise);
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
        let rays = frame(2.0, seed, wrong);
        assert!(!prefers_wide(&rays), "seed {seed}");
        let found = locate(&rays, &Annealing::of_joints(17));
        assert!(!found.widening.follows_noise);
        // A wrong ray may happen to meet those of two cameras that face each other: three against
        // one.
        let off = |j: &usize| (found.solution.points[*j] - standing()[*j]).norm() > 100.0;
        assert!((0..17).filter(off).count() <= 1, "seed {seed}");
    }
}

/// The true share of wrong detections is found, with a prior of one in two.
#[test]
fn the_share_of_wrong_detections_is_found() {
    let wrong = |i: usize, j: usize| if i == 1 && j.is_multiple_of(2) { 100.0 } else { 0.0 };
    let rays = frame(2.0, 3, wrong);
    let [narrow, _] = narrow_and_wide(&rays);
    let found = evidence(&rays, &narrow, None, AnnealedSettings::default().sigma_start_mm);
    assert!((found.wrong - 10.0 / 70.0).abs() < 0.02, "{}", found.wrong);
}

/// A prior that contradicts the wide solution counts against it.
#[test]
fn priors_are_evidence() {
    let rays = frame(20.0, 2, |_, _| 0.0);
    let [_, wide] = narrow_and_wide(&rays);
    let prior = |x: &Vector3<f64>, off: f64| Prior {
        mean: x + Vector3::new(off, 0.0, 0.0),
        precision: Matrix3::from_diagonal_element(1e-2),
        spread: 10.0,
    };
    let log = |off: f64| {
        let priors: Vec<Prior> = wide.points.iter().map(|x| prior(x, off)).collect();
        evidence(&rays, &wide, Some(&priors), AnnealedSettings::default().sigma_start_mm).log
    };
    // ½ (30/10)² for each of 17 joints.
    assert!((log(0.0) - log(30.0) - 17.0 * 4.5).abs() < 1e-9);
}

//! Triangulation from the views that agree: rejected and kept detections, and undecidable cases.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Vector2, Vector3};
use skelsplat_core::study::triangulate::{Triangulated, dlt, ransac};
use skelsplat_core::{Camera, Detections};
use skelsplat_tests::scenes::{Noise, pixels, room, standing};

/// Detections where the cameras see the points, moved by `shift(view, joint)` pixels; NaN is a
/// missing one.
fn seen(
    cameras: &[Camera],
    points: &[Vector3<f64>],
    shift: impl Fn(usize, usize) -> [f64; 2],
) -> Detections {
    let confidence: Vec<f64> =
        (0..cameras.len() * points.len()).map(|k| 0.4 + 0.1 * (k % 7) as f64).collect();
    let pixels = pixels(cameras, points, shift);
    Detections::new(cameras.len(), points.len(), &pixels, Some(&confidence)).unwrap()
}

/// A pixel or two that look random.
fn jitter(i: usize, j: usize) -> [f64; 2] {
    [((7 * i + 3 * j) as f64).sin(), ((5 * i + 11 * j) as f64).cos()]
}

const MISSING: [f64; 2] = [f64::NAN; 2];

/// The (view, joint) of every rejected detection.
fn rejected(found: &Triangulated) -> Vec<(usize, usize)> {
    let n = found.points.len();
    (0..found.rejected.len()).filter(|&k| found.rejected[k]).map(|k| (k / n, k % n)).collect()
}

#[test]
fn views_that_agree_are_all_kept() {
    for n in [2, 4, 5, 8] {
        let (cameras, points) = (room(n), standing());
        let exact = ransac(&seen(&cameras, &points, |_, _| [0.0; 2]), &cameras);
        for (x, truth) in exact.points.iter().zip(&points) {
            // 1e-13 px of rounding is 1e-12 mm; two opposed cameras lose up to 1e4 of it
            assert!((x - truth).norm() < 1e-8);
        }
        let detections = seen(&cameras, &points, jitter);
        let found = ransac(&detections, &cameras);
        assert_eq!(found.rejected, vec![false; n as usize * points.len()]);
        assert_eq!(found.points, dlt(&detections, &cameras));
    }
}

#[test]
fn one_wrong_view_of_four_is_named_and_left_out() {
    // No two are opposite each other: near their baseline the wrong view would decide the position.
    let (cameras, points) = (room(5)[..4].to_vec(), standing());
    let shift = |wrong: usize, [x, y]: [f64; 2]| {
        move |i, j| if i == (wrong + j) % 4 { [x, y] } else { jitter(i, j) }
    };
    for wrong in 0..4 {
        for by in [[120.0, 0.0], [0.0, -120.0], [-85.0, 85.0]] {
            let detections = seen(&cameras, &points, shift(wrong, by));
            let found = ransac(&detections, &cameras);
            let mut expected: Vec<_> = (0..points.len()).map(|j| ((wrong + j) % 4, j)).collect();
            expected.sort_unstable();
            assert_eq!(rejected(&found), expected);
            let without = seen(&cameras, &points, shift(wrong, MISSING));
            assert_eq!(found.points, dlt(&without, &cameras));
        }
    }
}

#[test]
fn half_of_eight_views_may_be_wrong() {
    let cameras = room(8);
    let mut noise = Noise::new(3);
    let points: Vec<_> =
        (0..24).flat_map(|_| standing()).map(|x| x + noise.vector(100.0)).collect();
    let n = points.len();
    let shifts: Vec<[f64; 2]> = (0..8 * n)
        .map(|k| {
            let (radius, angle) = (80.0 + 320.0 * noise.uniform(), TAU * noise.uniform());
            let wrong = (k / n + k % n) % 2 == 0;
            if wrong { [radius * angle.cos(), radius * angle.sin()] } else { [0.0; 2] }
        })
        .collect();
    let detections = seen(&cameras, &points, |i, j| shifts[i * n + j]);
    let found = ransac(&detections, &cameras);
    let near = |x: &[Vector3<f64>]| {
        let found = x.iter().zip(&points).filter(|(x, truth)| (*x - *truth).norm() < 1e-6);
        found.count() as f64 / n as f64
    };
    // Ten different pairs of 28 miss the six of right views with C(22, 10) / C(28, 10) = 4.9 %;
    // four standard deviations of 408 such draws are 4.3 %.
    let share = near(&found.points);
    assert!((share - 0.951).abs() < 0.043, "{share}");
    assert_eq!(near(&dlt(&detections, &cameras)), 0.0);
    for j in (0..n).filter(|&j| (found.points[j] - points[j]).norm() < 1e-6) {
        let wrong: Vec<_> = (0..8).map(|i| found.rejected[i * n + j]).collect();
        assert_eq!(wrong, (0..8).map(|i| (i + j) % 2 == 0).collect::<Vec<_>>());
    }
}

#[test]
fn views_of_which_no_two_agree_are_all_used() {
    for (n, heights) in [(4, [0.0, 200.0, MISSING[0], MISSING[0]]), (3, [0.0, 300.0, -300.0, 0.0])]
    {
        let (cameras, points) = (room(n), standing());
        let detections = seen(&cameras, &points, |i, _| [0.0, heights[i]]);
        let found = ransac(&detections, &cameras);
        assert_eq!(rejected(&found), []);
        assert_eq!(found.points, dlt(&detections, &cameras));
        assert!(found.points.iter().all(|x| x.iter().all(|v| v.is_finite())));
    }
}

#[test]
fn inliers_from_one_place_do_not_decide() {
    let ring = room(4);
    let cameras = [ring[0].clone(), ring[0].clone(), ring[1].clone()];
    let truth = standing()[0];
    let mut pixels = Vec::new();
    for (i, camera) in cameras.iter().enumerate() {
        let p = camera.project(&truth).unwrap();
        pixels.extend([p.x, p.y + if i == 2 { 200.0 } else { 0.0 }]);
    }
    let detections = Detections::new(3, 1, &pixels, Some(&[1.0, 1.0, 0.01])).unwrap();
    let found = ransac(&detections, &cameras);
    assert_eq!(rejected(&found), []);
    assert_eq!(found.points, dlt(&detections, &cameras));
    assert!(found.points[0].x.is_finite());
}

#[test]
fn missing_views_are_not_rejected() {
    let (cameras, points) = (room(4), standing());
    let shift = |i: usize, j: usize| match (i, j) {
        (0 | 1 | 3, 4) | (_, 5) | (1, 6) => MISSING,
        (2, 6) => [0.0, 150.0],
        _ => [0.0; 2],
    };
    let found = ransac(&seen(&cameras, &points, shift), &cameras);
    assert_eq!(rejected(&found), [(2, 6)]);
    for (j, (x, truth)) in found.points.iter().zip(&points).enumerate() {
        match j {
            4 | 5 => assert!(x.iter().all(|v| v.is_nan()), "{j} is seen by fewer than two views"),
            _ => assert!((x - truth).norm() < 1e-8, "{j}: {x:?}"),
        }
    }
    let nothing = ransac(&Detections::new(0, 2, &[], None).unwrap(), &[]);
    assert!(nothing.points.iter().all(|x| x.x.is_nan()) && nothing.rejected.is_empty());
}

#[test]
fn a_camera_that_looks_away_does_not_agree() {
    let (mut cameras, points) = (room(4), standing());
    let detections = seen(&cameras, &points, |_, _| [0.0; 2]);
    // Rotated by 180° about its vertical axis, with v mirrored, it has the same rays behind it.
    let c = &cameras[1];
    let turn = Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, -1.0));
    let r = turn * c.rotation();
    cameras[1] = Camera::new(&c.k(), &r, &-(r * c.centre()), c.size()).unwrap();
    let mirrored = detections.map(|i, p| {
        let [_, cy] = cameras[1].principal_point();
        Some(if i == 1 { Vector2::new(p.x, 2.0 * cy - p.y) } else { p })
    });
    let found = ransac(&mirrored, &cameras);
    assert_eq!(rejected(&found), (0..points.len()).map(|j| (1, j)).collect::<Vec<_>>());
    assert!((dlt(&mirrored, &cameras)[3] - points[3]).norm() < 1e-8, "its rays do meet the others");
    assert!((found.points[3] - points[3]).norm() < 1e-8);
}

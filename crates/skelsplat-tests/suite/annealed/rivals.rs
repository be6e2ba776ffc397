//! Two positions with equally many votes.

use super::*;
use skelsplat_core::study::annealed::consensus::{NEAR_TIE, TIE, rivals};

const SIGMA: f64 = 20.0;

/// Rays of `cameras` cameras of a room, of which camera i sees `at[i]`.
fn seeing(at: &[Vector3<f64>]) -> Vec<Ray> {
    let cameras = room(u32::try_from(at.len()).unwrap());
    let pixels: Vec<f64> =
        cameras.iter().zip(at).flat_map(|(c, x)| <[f64; 2]>::from(c.project(x).unwrap())).collect();
    let detections = Detections::new(at.len(), 1, &pixels, None).unwrap();
    Rays::new(&detections, &cameras, &[]).of_joint(0).to_vec()
}

fn here() -> Vector3<f64> {
    Vector3::new(100.0, -50.0, 1000.0)
}

/// 600 mm higher: no ray of one position comes near the other.
fn elsewhere() -> Vector3<f64> {
    Vector3::new(-200.0, 250.0, 1600.0)
}

#[test]
fn two_views_against_two_are_a_tie() {
    let rays = seeing(&[here(), here(), elsewhere(), elsewhere()]);
    for (x, other) in [(here(), elsewhere()), (elsewhere(), here())] {
        let found = rivals(&rays, &x, SIGMA, TIE);
        assert_eq!(found.len(), 1);
        assert!((found[0].at - other).norm() < 1e-6);
        assert!((found[0].share - 0.5).abs() < 1e-9);
    }
}

/// A detection that fits both positions leaves three votes for each.
#[test]
fn a_ray_that_both_places_share_decides_nothing() {
    let mut rays = seeing(&[here(), here(), elsewhere(), elsewhere(), here()]);
    let through = (elsewhere() - here()).normalize();
    (rays[4].centre, rays[4].direction) = (here() - 3000.0 * through, through);
    let found = rivals(&rays, &here(), SIGMA, TIE);
    assert_eq!(found.len(), 1);
    assert!((found[0].at - elsewhere()).norm() < 1e-6);
    assert!((found[0].share - 0.5).abs() < 1e-9);
}

#[test]
fn three_views_outvote_one_and_two() {
    let one = seeing(&[here(), here(), here(), elsewhere()]);
    let two = seeing(&[here(), here(), here(), elsewhere(), elsewhere()]);
    for slack in [TIE, NEAR_TIE] {
        assert_eq!(rivals(&one, &here(), SIGMA, slack), Vec::new());
        assert_eq!(rivals(&two, &here(), SIGMA, slack), Vec::new());
    }
}

#[test]
fn a_place_that_all_views_see_has_no_rival() {
    assert_eq!(rivals(&seeing(&[here(); 4]), &here(), SIGMA, NEAR_TIE), Vec::new());
    // Nor has one around which the rays scatter within the kernel.
    let near: Vec<_> = (0..4).map(|k| here() + 10.0 * Vector3::ith(k % 3, 1.0)).collect();
    assert_eq!(rivals(&seeing(&near), &here(), SIGMA, NEAR_TIE), Vec::new());
}

/// Confidences are votes.
#[test]
fn less_confident_views_do_not_tie() {
    let mut rays = seeing(&[here(), here(), elsewhere(), elsewhere()]);
    rays[2..].iter_mut().for_each(|ray| ray.weight = 0.5);
    assert_eq!(rivals(&rays, &here(), SIGMA, TIE), Vec::new());
    assert_eq!(rivals(&rays, &elsewhere(), SIGMA, TIE).len(), 1);
}

//! Whether rays determine a depth.

use super::*;
use skelsplat_core::study::annealed::depth::{have_parallax, may_be_fixed};

const PIXEL: f64 = 1e-3;

/// A ray from `centre` to `at`, whose pixels span a milliradian.
fn ray(centre: Vector3<f64>, at: Vector3<f64>) -> Ray {
    Ray { centre, direction: (at - centre).normalize(), weight: 1.0, pixel: PIXEL }
}

/// Two rays that meet 3 m away at the angle `phi`.
fn pair(phi: f64) -> [Ray; 2] {
    let at = |half: f64| 3000.0 * Vector3::new(half.sin(), half.cos(), 0.0);
    [-0.5 * phi, 0.5 * phi].map(|half| ray(at(half), Vector3::zeros()))
}

/// Two rays at the angle φ give Δχ² = φ²/2a²: the limit of 25 is at φ = √50 a, with 3 px of noise 3
/// milliradians.
fn limit() -> f64 {
    50.0_f64.sqrt() * 3.0 * PIXEL
}

#[test]
fn the_limit_of_two_rays_follows_the_formula() {
    let limit = limit();
    for (phi, fixed) in [(0.0, false), (0.99, false), (1.01, true), (3.0, true)] {
        let rays = pair(phi * limit);
        assert_eq!(may_be_fixed(&rays, &Vector3::zeros(), f64::INFINITY), fixed, "{phi}");
        let [a, b] = pair(phi * limit);
        assert_eq!(have_parallax(&a, &b), fixed, "{phi}");
    }
    // Opposite directions are the farthest apart that rays can be.
    let facing = [-3000.0, 3000.0].map(|x| ray(Vector3::new(x, 0.0, 0.0), Vector3::zeros()));
    assert!(may_be_fixed(&facing, &Vector3::zeros(), f64::INFINITY));
    assert!(have_parallax(&facing[0], &facing[1]));
}

/// N rays in two bundles of equal size are as good as two of N/2 times the weight.
#[test]
fn more_rays_fix_more() {
    let limit = limit();
    let twice = |phi: f64| [pair(phi), pair(phi)].concat();
    let half = limit / 2.0_f64.sqrt();
    assert!(!may_be_fixed(&twice(0.99 * half), &Vector3::zeros(), f64::INFINITY));
    assert!(may_be_fixed(&twice(1.01 * half), &Vector3::zeros(), f64::INFINITY));
}

/// What two rays miss a point by counts against its depth: 40 mm, 4.4 times the noise, cost 2 ·
/// 19.8 of the 25 · 2.25 gained.
#[test]
fn rays_that_miss_the_point_do_not_fix_it() {
    let mut rays = pair(1.5 * limit());
    assert!(may_be_fixed(&rays, &Vector3::zeros(), f64::INFINITY));
    rays[0].centre.z += 40.0;
    rays[1].centre.z -= 40.0;
    assert!(!may_be_fixed(&rays, &Vector3::zeros(), f64::INFINITY));
    // Under a kernel that leaves out the one that misses it by far, the others decide.
    let mut three = [pair(0.5).to_vec(), vec![pair(0.0)[0]]].concat();
    three[2].centre.z += 2000.0;
    assert!(!may_be_fixed(&three, &Vector3::zeros(), f64::INFINITY));
    assert!(may_be_fixed(&three, &Vector3::zeros(), 30.0));
}

/// `n` cameras side by side, `apart` mm from each other, 3 m from a person.
fn side_by_side(n: usize, apart: f64) -> Vec<Camera> {
    let at = |k: usize| Vector3::new(apart * k as f64, -3000.0, 1000.0);
    (0..n)
        .map(|k| look_at(at(k), at(k) + Vector3::new(0.0, 1.0, 0.0), 1100.0, [1920, 1080]))
        .collect()
}

/// At 3 m a pixel spans 2.7 mm: 1 mm between cameras is a third of one, 200 mm are 73.
#[test]
fn the_noise_of_the_frame_decides() {
    for (apart, expected) in
        [(0.0, JointStatus::Weak), (1.0, JointStatus::Weak), (200.0, JointStatus::Ok)]
    {
        let cameras = side_by_side(2, apart);
        let detections = noisy_detections(&standing(), &cameras, 2.0, &mut Noise::new(5));
        let out = refine(&cameras, &from(detections, Some(standing())), free());
        assert_eq!(out.joint_status, vec![expected; 17], "{apart} mm");
    }
}

/// No ray agrees on a point behind its camera.
#[test]
fn a_point_behind_the_cameras_is_not_fixed() {
    let centres = [-1500.0, 1500.0].map(|x| Vector3::new(x, -3000.0, 0.0));
    let rays = centres.map(|c| ray(c, Vector3::zeros()));
    assert!(may_be_fixed(&rays, &Vector3::zeros(), 30.0));
    assert!(!may_be_fixed(&rays, &Vector3::new(0.0, -6000.0, 0.0), 30.0));
    // Rays that meet behind the cameras leave the joint without a position.
    let cameras = side_by_side(2, 200.0);
    let mirrored: Vec<Vector3<f64>> =
        standing().iter().map(|x| Vector3::new(x.x, -6000.0 - x.y, x.z)).collect();
    let pixels: Vec<f64> = cameras
        .iter()
        .flat_map(|c| mirrored.iter().map(move |x| c.to_camera(x)))
        .flat_map(|x| [1100.0 * x.x / x.z + 959.5, 1100.0 * x.y / x.z + 539.5])
        .collect();
    let detections = Detections::new(2, 17, &pixels, None).unwrap();
    assert!(robust(&detections, &cameras).points.iter().all(|x| x.x.is_nan()));
}

//! Cameras: parity with `OpenCV`, derivatives, undistortion and its range, and rejected input.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, SQRT_2};

use nalgebra::{Matrix2x3, Matrix3, Rotation3, Vector2, Vector3};
use skelsplat_core::Error;
use skelsplat_core::study::camera::{Camera, Distortion, NEAR, for_camera};
use skelsplat_tests::refused;

/// A lens with every term of the general model.
const C: [f64; 14] = [
    0.11, -0.24, 0.0012, -0.0009, 0.05, 0.21, -0.03, 0.008, 0.002, -0.0007, -0.0011, 0.0005, 0.04,
    -0.03,
];
const FISHEYE: [f64; 4] = [-0.02, 0.013, -0.009, 0.002];
/// Strong lenses whose one-to-one range still covers the test image (distorted radius up to 1.1).
const WIDE: [f64; 8] = [0.9, 0.2, 0.001, -0.002, 0.0, 1.3, 0.5, 0.02];
const PINCUSHION: [f64; 5] = [0.4, 0.1, 0.0, 0.0, 0.02];

fn k() -> Matrix3<f64> {
    Matrix3::new(1100.0, 0.0, 980.5, 0.0, 1080.0, 520.25, 0.0, 0.0, 1.0)
}

/// `cv2.Rodrigues` of (0.3, -0.2, 0.1).
fn rotation() -> Matrix3<f64> {
    *Rotation3::new(Vector3::new(0.3, -0.2, 0.1)).matrix()
}

/// A constructor of a lens from its coefficients.
type Model = fn(&[f64]) -> Result<Distortion, Error>;

fn camera(lens: Result<Distortion, Error>) -> Camera {
    let t = Vector3::new(50.0, -80.0, 3000.0);
    Camera::new(&k(), &rotation(), &t, [1920, 1080]).unwrap().with_distortion(lens.unwrap())
}

fn lenses() -> Vec<Camera> {
    let general = [4, 5, 8, 12, 14].map(|n| camera(Distortion::brown_conrady(&C[..n])));
    let others = [
        camera(Distortion::brown_conrady(&[])),
        camera(Distortion::brown_conrady(&WIDE)),
        camera(Distortion::brown_conrady(&PINCUSHION)),
        camera(Distortion::fisheye(&FISHEYE)),
        camera(Distortion::fisheye(&[0.0; 4])),
    ];
    general.into_iter().chain(others).collect()
}

/// The principal point and pixels around it, to the image's corners or as far as lens `C` is
/// one-to-one: with eight coefficients to a distorted radius of 0.78, where the corners lie at
/// 1.01.
fn pixels(camera: &Camera) -> impl Iterator<Item = Vector2<f64>> {
    let reach = if camera.distortion().coefficients().first() == Some(&C[0]) { 0.7 } else { 1.0 };
    (-6..=6).flat_map(move |i| {
        let at = move |j| Vector2::new(163.0 * f64::from(i), 130.0 * f64::from(j)) * reach;
        (-4..=4).map(move |j| at(j) + Vector2::new(980.5, 520.25))
    })
}

fn converged(camera: &Camera, pixel: Vector2<f64>) -> Vector2<f64> {
    match camera.undistort(pixel) {
        Some(ideal) => ideal,
        None => {
            panic!("{pixel:?} is out of range of {:?}", camera.distortion())
        }
    }
}

#[test]
fn undistort_inverts_distort_over_the_image() {
    for camera in lenses() {
        for pixel in pixels(&camera) {
            let ideal = converged(&camera, pixel);
            // the tolerance of `undistort`
            assert!((camera.distort(&ideal) - pixel).amax() <= 1e-9, "{pixel:?} {camera:?}");
            let again = converged(&camera, camera.distort(&ideal));
            // the same 1e-9 px, in the ideal image stretched by the inverse Jacobian (below 10
            // here)
            assert!((again - ideal).amax() <= 1e-8, "{again:?} {ideal:?} {camera:?}");
        }
    }
}

#[test]
fn distort_is_what_separates_ideal_from_real_projection() {
    let x = Vector3::new(-400.0, 350.0, 120.0);
    for camera in lenses() {
        let ideal = camera.project_ideal(&x).unwrap();
        // two roundings of 1e3 px
        assert!((camera.distort(&ideal) - camera.project(&x).unwrap()).amax() < 1e-11);
        let homogeneous = camera.k() * (camera.rotation() * x + camera.translation());
        assert!((homogeneous.xy() / homogeneous.z - ideal).amax() < 1e-11);
    }
}

#[test]
fn jacobians_are_central_differences() {
    // Truncation h²f'''/6 and rounding 1e-13 px/h are both some 1e-11 px/mm at h = 0.05 mm, where J
    // is some 0.3 px/mm.
    let h = 0.05;
    let on_axis =
        |c: &Camera| c.rotation().tr_mul(&(Vector3::new(1.0, 2.0, 2500.0) - c.translation()));
    for camera in lenses() {
        let at = [
            Vector3::new(100.0, 200.0, 300.0),
            Vector3::new(-900.0, 400.0, -200.0),
            Vector3::new(800.0, -600.0, 900.0),
            on_axis(&camera),
        ];
        for x in at {
            let (pixel, analytic) = camera.project_with_jacobian(&x).unwrap();
            assert!((pixel - camera.project(&x).unwrap()).amax() < 1e-11);
            let columns: [Vector2<f64>; 3] = std::array::from_fn(|i| {
                let mut d = Vector3::zeros();
                d[i] = h;
                (camera.project(&(x + d)).unwrap() - camera.project(&(x - d)).unwrap()) / (2.0 * h)
            });
            let error = (Matrix2x3::from_columns(&columns) - analytic).amax();
            assert!(error < 1e-7 * analytic.amax(), "{error:e} {x:?} {:?}", camera.distortion());
        }
    }
}

/// Distorted pixel at normalised radius `r` to the right of the principal point.
fn at_radius(r: f64) -> Vector2<f64> {
    Vector2::new(980.5 + 1100.0 * r, 520.25)
}

#[test]
fn pixels_beyond_the_fold_are_out_of_range() {
    // r (1 - 0.3 r²) turns at r = 1/√0.9 = 1.0541 with 0.70273; r/(1 + r²/2) at √2 with 0.70711; θ
    // ends at π/2 = 1.5708; under a tilted sensor rays at right angles to the axis end at 1/sin τy.
    let mut tilted = [0.0; 14];
    tilted[13] = 0.5;
    let cases: [(Model, &[f64], f64, f64); 4] = [
        (Distortion::brown_conrady, &[-0.3, 0.0, 0.0, 0.0], 0.70273, 1.0541),
        (
            Distortion::brown_conrady,
            &[0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0],
            FRAC_1_SQRT_2,
            SQRT_2,
        ),
        (Distortion::fisheye, &[0.0; 4], FRAC_PI_2, f64::INFINITY),
        (Distortion::brown_conrady, &tilted, 1.0 / 0.5_f64.sin(), f64::INFINITY),
    ];
    for (model, coefficients, edge, turn) in cases {
        let camera = camera(model(coefficients));
        let inside = converged(&camera, at_radius(edge - 1e-4));
        assert!((inside.x - 980.5) / 1100.0 < turn, "{coefficients:?}: {inside:?}");
        assert_eq!(camera.undistort(at_radius(edge + 1e-4)), None);
    }
}

#[test]
fn the_fold_counts_with_tangential_terms_too() {
    // p1 moves the fold by some 1e-3 only: 0.68 lies before it, 0.73 beyond, in every direction.
    let camera = camera(Distortion::brown_conrady(&[-0.3, 0.0, 0.001, -0.001]));
    for degrees in 0..36 {
        let (s, c) = f64::to_radians(10.0 * f64::from(degrees)).sin_cos();
        let at = |r: f64| Vector2::new(980.5 + 1100.0 * r * c, 520.25 + 1080.0 * r * s);
        let ideal = converged(&camera, at(0.68));
        let r = Vector2::new((ideal.x - 980.5) / 1100.0, (ideal.y - 520.25) / 1080.0).norm();
        assert!(r < 1.06, "{r}");
        assert_eq!(camera.undistort(at(0.73)), None);
    }
}

#[test]
fn a_pole_bounds_the_range() {
    // r/(1 - r²/2) goes to infinity at √2, so every pixel is reached from before it
    let camera = camera(Distortion::brown_conrady(&[0.0, 0.0, 0.0, 0.0, 0.0, -0.5, 0.0, 0.0]));
    let ideal = converged(&camera, at_radius(50.0));
    assert!(ideal.x > 980.5 && ideal.x < 980.5 + 1100.0 * SQRT_2);
}

/// Around the inflection of this polynomial plain Newton oscillates for ever.
#[test]
fn an_inflection_does_not_trap_the_solver() {
    let camera = camera(Distortion::fisheye(&[0.018, 0.0286, 0.0834, -0.041]));
    for step in 1..4000 {
        let ideal = at_radius(0.001 * f64::from(step));
        let found = converged(&camera, camera.distort(&ideal));
        // 1e-9 px over the slope of θ_d(atan r), which is above 0.01 up to r = 4
        assert!((found - ideal).amax() < 1e-7, "{step}: {found:?}");
    }
}

#[test]
fn points_at_or_behind_the_near_plane_are_not_seen() {
    let t = Vector3::zeros();
    let camera = Camera::new(&k(), &Matrix3::identity(), &t, [1920, 1080]).unwrap();
    for z in [-5.0, 0.0, NEAR, f64::NAN] {
        let x = Vector3::new(0.0, 0.0, z);
        assert_eq!(camera.project(&x), None);
        assert_eq!(camera.project_ideal(&x), None);
        assert_eq!(camera.project_with_jacobian(&x), None);
    }
    let just = Vector3::new(0.0, 0.0, 2.0 * NEAR);
    assert_eq!(camera.project(&just), Some(Vector2::new(980.5, 520.25)));
}

#[test]
fn coefficients_come_back_as_given() {
    for n in [0, 4, 5, 8, 12, 14] {
        let lens = Distortion::brown_conrady(&C[..n]).unwrap();
        assert_eq!(lens.coefficients(), C[..n]);
        assert_eq!(lens.is_none(), n == 0);
    }
    let fisheye = Distortion::fisheye(&FISHEYE).unwrap();
    assert_eq!((fisheye.coefficients(), fisheye.is_fisheye()), (FISHEYE.to_vec(), true));
    assert!(Distortion::brown_conrady(&[0.0; 5]).unwrap().is_none());
    // an equidistant lens is not a pinhole
    assert!(!Distortion::fisheye(&[0.0; 4]).unwrap().is_none());
}

#[test]
fn a_scaled_camera_sees_the_resized_image() {
    let x = Vector3::new(100.0, -200.0, 300.0);
    for camera in lenses() {
        for factor in [0.25, 0.5, 1.5] {
            let scaled = camera.scaled(factor).unwrap();
            let expected = camera.project(&x).unwrap().map(|u| (u + 0.5) * factor - 0.5);
            assert!((scaled.project(&x).unwrap() - expected).amax() < 1e-11);
        }
    }
    let pinhole = camera(Distortion::brown_conrady(&[]));
    assert_eq!(pinhole.scaled(0.3).unwrap().size(), [576, 324]);
    assert_eq!(pinhole.scaled(1e-9).unwrap().size(), [1, 1]);
    for factor in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(refused(pinhole.scaled(factor)), "factor");
    }
}

#[test]
fn a_rotation_of_few_digits_becomes_the_nearest_one_and_an_exact_one_stays() {
    let (exact, t) = (rotation(), Vector3::new(1.0, 2.0, 3.0));
    let kept = Camera::new(&k(), &exact, &t, [640, 480]).unwrap();
    assert_eq!(kept.rotation(), &exact);
    for digits in [1e3, 1e4, 1e6] {
        let rounded = exact.map(|entry| (entry * digits).round() / digits);
        let camera = Camera::new(&k(), &rounded, &t, [640, 480]).unwrap();
        let svd = rounded.svd(true, true);
        let nearest = svd.u.unwrap() * svd.v_t.unwrap();
        assert!((camera.rotation() - nearest).amax() < 1e-14);
    }
}

#[test]
fn a_broken_part_is_refused_by_its_name() {
    let (r, t, size) = (rotation(), Vector3::zeros(), [640, 480]);
    let entries =
        [((0, 2), f64::NAN), ((0, 0), -1100.0), ((1, 1), 0.0), ((0, 1), 2.0), ((2, 2), 2.0)];
    for (entry, value) in entries {
        let mut broken = k();
        broken[entry] = value;
        assert_eq!(refused(Camera::new(&broken, &r, &t, size)), "K");
    }
    let sheared = Matrix3::new(1.0, 2e-3, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
    let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
    for broken in [sheared, mirror, Matrix3::repeat(f64::INFINITY)] {
        assert_eq!(refused(Camera::new(&k(), &broken, &t, size)), "R");
    }
    let nowhere = Vector3::new(0.0, f64::NAN, 0.0);
    assert_eq!(refused(Camera::new(&k(), &r, &nowhere, size)), "t");
    assert_eq!(refused(Camera::new(&k(), &r, &t, [640, 0])), "size");
    for lens in [
        Distortion::brown_conrady(&[0.1; 6]),
        Distortion::fisheye(&[0.1; 5]),
        Distortion::brown_conrady(&[0.1, f64::NAN, 0.0, 0.0]),
    ] {
        let of_camera = lens.map_err(for_camera("left"));
        assert_eq!(refused(of_camera), "distortion of camera 'left'");
    }
}

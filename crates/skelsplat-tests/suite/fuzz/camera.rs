//! Cameras of any numbers, and lenses that are undone.

use nalgebra::{Matrix3, Vector2, Vector3};
use proptest::prelude::*;
use skelsplat_core::{Camera, Distortion};

use super::any::{any_number, config, lens};

fn numbers(n: usize) -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(any_number(), n)
}

/// A rotation, or any nine numbers.
fn rotation() -> impl Strategy<Value = Matrix3<f64>> {
    let turned = prop::array::uniform3(-4.0..4.0_f64)
        .prop_map(|v| *nalgebra::Rotation3::new(Vector3::from(v)).matrix());
    prop_oneof![3 => turned, 1 => numbers(9).prop_map(|v| Matrix3::from_row_slice(&v))]
}

/// K of focal lengths and a principal point, or of any nine numbers.
fn intrinsics() -> impl Strategy<Value = Matrix3<f64>> {
    let usual = numbers(4)
        .prop_map(|v| Matrix3::new(v[0].abs(), 0.0, v[2], 0.0, v[1].abs(), v[3], 0.0, 0.0, 1.0));
    prop_oneof![6 => usual, 1 => numbers(9).prop_map(|v| Matrix3::from_row_slice(&v))]
}

/// How far the pixel moves when the ideal one does by its rounding: coefficients of a thousand
/// magnify it.
fn rounding(camera: &Camera, ideal: &Vector2<f64>) -> f64 {
    let [cx, cy] = camera.principal_point();
    let least = 4.0 * f64::EPSILON * (ideal.amax() + cx.abs().max(cy.abs()));
    let moved = |x: f64, y: f64| {
        camera.distort(&(ideal + least * Vector2::new(x, y))) - camera.distort(ideal)
    };
    moved(1.0, 0.0).amax() + moved(0.0, 1.0).amax()
}

proptest! {
    #![proptest_config(config(100))]

    /// A camera is refused, or sees every point somewhere or not at all.
    #[test]
    fn any_numbers_make_a_camera_or_an_error(
        k in intrinsics(), r in rotation(), t in numbers(3),
        size in prop::array::uniform2(any::<u32>()),
        coefficients in prop::sample::select(vec![0, 3, 4, 5, 8, 12, 14]).prop_flat_map(numbers),
        fisheye in any::<bool>(), points in numbers(12), pixels in numbers(8),
    ) {
        let size = size.map(|s| s % 70_000);
        let made = Camera::new(&k, &r, &Vector3::from_column_slice(&t), size);
        let model = if fisheye { Distortion::fisheye } else { Distortion::brown_conrady };
        let lens = model(&coefficients);
        let (Ok(camera), Ok(lens)) = (made, lens) else { return Ok(()) };
        let camera = camera.with_distortion(lens);
        for x in points.chunks_exact(3) {
            let _ = camera.project_with_jacobian(&Vector3::from_column_slice(x));
        }
        for p in pixels.chunks_exact(2) {
            let p = Vector2::from_column_slice(p);
            if let Some(ideal) = camera.undistort(p) {
                prop_assert!(ideal.iter().all(|v| v.is_finite()), "{ideal:?}");
                let size = p.amax() + camera.k().amax();
                let most = 1e-9 + 1e-12 * size + rounding(&camera, &ideal);
                prop_assert!((camera.distort(&ideal) - p).amax() <= most, "{p:?} {ideal:?}");
            }
        }
    }

    /// What is undistorted falls back on the pixel, and comes back from there.
    #[test]
    fn lenses_are_undone(
        lens in lens(),
        focal in 200.0..3000.0_f64,
        at in prop::array::uniform2(-200.0..1200.0_f64),
    ) {
        let k = Matrix3::new(focal, 0.0, 500.0, 0.0, 1.1 * focal, 480.0, 0.0, 0.0, 1.0);
        let pinhole = Camera::new(&k, &Matrix3::identity(), &Vector3::zeros(), [1000, 1000]);
        let camera = pinhole.unwrap().with_distortion(lens);
        let pixel = Vector2::from(at);
        if let Some(ideal) = camera.undistort(pixel) {
            prop_assert!((camera.distort(&ideal) - pixel).amax() <= 2e-9);
            let again = camera.undistort(camera.distort(&ideal));
            let Some(twice) = again else {
                return Err(TestCaseError::fail("out of range the second time"));
            };
            // 1e-9 px of the image, as much more as the lens compresses there.
            let by = |step| (camera.distort(&(ideal + step)) - camera.distort(&ideal)).norm();
            let stretch = by(1e-3 * Vector2::x()).min(by(1e-3 * Vector2::y())) / 1e-3;
            prop_assert!((twice - ideal).amax() <= 1e-7 / stretch.max(1e-3), "{ideal:?} {twice:?}");
        }
    }
}

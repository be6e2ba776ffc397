//! Multi-view fusion of monocular 3D poses.

use nalgebra::Vector3;

use crate::camera::Camera;
use crate::detections::Detections;

/// Lower limit of the mean reprojection error, in pixels; an exact pose would otherwise have
/// infinite weight.
pub const MIN_ERROR_PX: f64 = 1e-3;

/// Fuses poses estimated from one view each, in world coordinates, weighted by their agreement with
/// all views: `X_j = Σ_i w_ij X_ij` with `w_ij ∝ 1/e_ij` and `e_ij` the mean reprojection error of
/// `X_ij` over the views that detect `j`.
///
/// `poses` holds one pose of `N` joints per monocular estimate, NaN where a joint is missing;
/// `detections` are ideal pixels. An `X_ij` that is missing or lies behind a camera that detects
/// the joint gets no weight, errors below [`MIN_ERROR_PX`] are raised to it, and a joint without
/// detections is the plain mean of its `X_ij`. NaN where no `X_ij` remains.
///
/// # Panics
/// If a pose has another number of joints than the detections, or the detections another number of
/// views than there are cameras.
pub fn fuse_monocular(
    poses: &[Vec<Vector3<f64>>],
    detections: &Detections,
    cameras: &[Camera],
) -> Vec<Vector3<f64>> {
    let n = detections.n_joints();
    assert_eq!(detections.n_views(), cameras.len(), "one camera per view");
    assert!(poses.iter().all(|p| p.len() == n), "every pose has the {n} joints of the detections");
    (0..n)
        .map(|j| {
            let mut total = 0.0;
            let mut sum = Vector3::zeros();
            for x in poses.iter().map(|pose| pose[j]) {
                if let Some(error) = reprojection_error(&x, j, detections, cameras) {
                    let weight = 1.0 / error.max(MIN_ERROR_PX);
                    total += weight;
                    sum += x * weight;
                }
            }
            // 0/0 where all weights are zero
            sum / total
        })
        .collect()
}

/// Mean distance in pixels between the projections of `x` and the detections of joint `j`; 0 if
/// there are none, `None` if `x` is not finite or is behind a camera that detects the joint.
fn reprojection_error(
    x: &Vector3<f64>,
    joint: usize,
    detections: &Detections,
    cameras: &[Camera],
) -> Option<f64> {
    if !x.iter().all(|v| v.is_finite()) {
        return None;
    }
    let (mut sum, mut n) = (0.0, 0_u32);
    for (i, camera) in cameras.iter().enumerate() {
        if let Some((pixel, _)) = detections.get(i, joint) {
            sum += (camera.project_ideal(x)? - pixel).norm();
            n += 1;
        }
    }
    Some(sum / f64::from(n.max(1)))
}

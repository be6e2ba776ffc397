//! Algebraic triangulation by the direct linear transform.

use nalgebra::{Matrix4, RowVector4, Vector2, Vector3, Vector4};

use crate::camera::{Camera, NEAR};
use crate::detections::Detections;

/// Third singular value, relative to the first, below which the rays do not determine a point (one
/// centre, or all centres on the ray), and homogeneous coordinate, relative to the point in rig
/// lengths, below which it is at infinity: what is left of 0 after rounding.
const RANK: f64 = 1e-10;

/// Triangulates each joint from the ideal pixels of the views that detect it.
///
/// Every detection gives the rows c·(u P₃ − P₁) and c·(v P₃ − P₂) with its confidence c and the
/// rows P of K [R | t], and the point is their right null vector: the algebraic method of learnable
/// triangulation, in which a row weighs c times a focal length times the point's depth. World
/// coordinates are first normalised to the cameras in use (origin at their mean centre, RMS
/// distance from it as unit), so that the unit-norm constraint, and with it the result on noisy
/// data, depends neither on the unit of length, nor on the world's origin, nor on cameras without
/// usable detections.
///
/// NaN where fewer than two views detect the joint, where the rays are parallel or coincide,
/// and where the point lies behind every camera that detects it.
pub fn dlt(detections: &Detections, cameras: &[Camera]) -> Vec<Vector3<f64>> {
    (0..detections.n_joints()).map(|j| point(detections, cameras, j, |_| true)).collect()
}

/// The joint from its detections in the views `used`; NaN as for [`dlt()`].
pub(super) fn point(
    detections: &Detections,
    cameras: &[Camera],
    joint: usize,
    used: impl Fn(usize) -> bool,
) -> Vector3<f64> {
    let nan = Vector3::repeat(f64::NAN);
    let used = &used;
    let seen = || {
        let views = cameras.iter().enumerate().filter(|(i, _)| used(*i));
        views.filter_map(move |(i, camera)| Some((camera, detections.get(i, joint)?)))
    };
    let frame = RigFrame::of(seen().map(|(camera, _)| camera));
    let strongest = seen().map(|(_, (_, c))| c).fold(0.0, f64::max);
    let mut system = Matrix4::zeros();
    for (camera, (pixel, confidence)) in seen() {
        for row in frame.rows(camera, &pixel) {
            add_row(&mut system, row * (confidence / strongest));
        }
    }
    let Some(h) = null_vector(&system).filter(|_| seen().count() >= 2) else {
        return nan;
    };
    if h.w.abs() <= RANK {
        return nan;
    }
    let x = frame.origin + h.xyz() * (frame.length / h.w);
    let in_front = seen().any(|(camera, _)| camera.to_camera(&x).z > NEAR);
    if in_front { x } else { nan }
}

/// Origin and lengths of the cameras that are used.
struct RigFrame {
    origin: Vector3<f64>,
    length: f64,
    focal: f64,
}

impl RigFrame {
    fn of<'a>(cameras: impl Iterator<Item = &'a Camera> + Clone) -> Self {
        let n = cameras.clone().count().max(1) as f64;
        let origin = cameras.clone().map(Camera::centre).sum::<Vector3<f64>>() / n;
        let squares = cameras.clone().map(|c| (c.centre() - origin).norm_squared());
        let square = squares.sum::<f64>() / n;
        let length = if square > 0.0 { square.sqrt() } else { 1.0 };
        Self { origin, length, focal: cameras.flat_map(Camera::focal).fold(1.0, f64::max) }
    }

    /// u P₃ − P₁ = fx·(x̂ r₃ − r₁) with x̂ = (u − cx)/fx, and likewise for v, in units of the
    /// largest focal length.
    fn rows(&self, camera: &Camera, pixel: &Vector2<f64>) -> [RowVector4<f64>; 2] {
        let ([fx, fy], [cx, cy]) = (camera.focal(), camera.principal_point());
        let (r, t) = (camera.rotation(), camera.to_camera(&self.origin) / self.length);
        // Rows of [R | t].
        let p = [0, 1, 2].map(|k| RowVector4::new(r[(k, 0)], r[(k, 1)], r[(k, 2)], t[k]));
        [
            (p[2] * ((pixel.x - cx) / fx) - p[0]) * (fx / self.focal),
            (p[2] * ((pixel.y - cy) / fy) - p[1]) * (fy / self.focal),
        ]
    }
}

/// Rotates one more row into an upper triangular `R` with `RᵀR = AᵀA`, so that the number of views
/// needs no storage.
fn add_row(triangle: &mut Matrix4<f64>, mut row: RowVector4<f64>) {
    for k in 0..4 {
        let length = triangle[(k, k)].hypot(row[k]);
        if length == 0.0 {
            continue;
        }
        let (c, s) = (triangle[(k, k)] / length, row[k] / length);
        let top = triangle.row(k).into_owned();
        triangle.set_row(k, &(top * c + row * s));
        row = row * c - top * s;
    }
}

/// The right singular vector of the smallest singular value, if it is unique.
fn null_vector(a: &Matrix4<f64>) -> Option<Vector4<f64>> {
    let svd = a.try_svd(false, true, f64::EPSILON, 1000)?;
    let s = svd.singular_values;
    (s[2] > RANK * s[0]).then(|| svd.v_t.map(|v| v.row(3).transpose()))?
}

//! Algebraic triangulation by the direct linear transform.

use nalgebra::{Matrix3, Matrix4, RowVector4, Vector2, Vector3, Vector4};

use crate::camera::{Camera, NEAR};
use crate::detections::Detections;

/// Third singular value, relative to the first, below which the rays do not determine a point
/// (one centre, or all centres on the ray).
const RANK: f64 = 1e-10;
/// Homogeneous coordinate, relative to the point in rig lengths, below which the point is at infinity.
const AT_INFINITY: f64 = 1e-9;
/// Added to AᵀA, relative to its trace, so that it has an inverse where the rays meet exactly.
const SHIFT: f64 = 1e-13;
/// Steps of the inverse iteration, of two each.
const ITERATIONS: usize = 4;

/// Triangulates each joint from the ideal pixels of the views that detect it.
///
/// Every detection gives the rows c·(u P₃ − P₁) and c·(v P₃ − P₂) with its confidence c and the rows P of K [R | t],
/// and the point is their right null vector: the algebraic method of learnable triangulation, in which a row weighs
/// c times a focal length times the point's depth. World coordinates are first normalised to the cameras
/// in use (origin at their mean centre, RMS distance from it as unit), so that the unit-norm constraint, and with it the
/// result on noisy data, depends neither on the unit of length, nor on the world's origin, nor on cameras without usable
/// detections.
///
/// NaN where fewer than two views detect the joint, where the rays are parallel or coincide,
/// and where the point lies behind every camera that detects it.
#[must_use]
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
    if h.w.abs() <= AT_INFINITY {
        return nan;
    }
    let x = frame.origin + h.xyz() * (frame.length / h.w);
    let in_front = seen().any(|(camera, _)| camera.to_camera(&x).z > NEAR);
    if in_front { x } else { nan }
}

/// Two cameras whose detections of one joint are triangulated many times: as [`dlt()`], without its decomposition.
pub(crate) struct TwoViews {
    cameras: [Camera; 2],
    frame: RigFrame,
    /// Rows of [R | t] of the cameras in the frame.
    rows: [[RowVector4<f64>; 3]; 2],
    /// Fundamental matrix: bᵀ F a = 0 for homogeneous ideal pixels.
    fundamental: Matrix3<f64>,
}

impl TwoViews {
    pub(crate) fn new(one: &Camera, other: &Camera) -> Self {
        let rotation = other.rotation() * one.rotation().transpose();
        let shift = other.to_camera(&one.centre());
        let inverse =
            |camera: &Camera| camera.k().try_inverse().unwrap_or_else(|| Matrix3::repeat(f64::NAN));
        let fundamental =
            inverse(other).transpose() * shift.cross_matrix() * rotation * inverse(one);
        let frame = RigFrame::of([one, other].into_iter());
        let rows = [frame.extrinsics(one), frame.extrinsics(other)];
        Self { cameras: [one.clone(), other.clone()], frame, rows, fundamental }
    }

    /// By how many pixels two ideal pixels miss the epipolar constraint, to first order; NaN if one is missing.
    pub(crate) fn apart_px(&self, one: &Vector2<f64>, other: &Vector2<f64>) -> f64 {
        let (a, b) = (one.push(1.0), other.push(1.0));
        let (line, back) = (self.fundamental * a, self.fundamental.tr_mul(&b));
        let steepness = line.xy().norm_squared() + back.xy().norm_squared();
        b.dot(&line).abs() / steepness.sqrt()
    }

    /// The joint from its two ideal pixels and their confidences; NaN where [`dlt()`] has no point.
    ///
    /// The right singular vector is the eigenvector of AᵀA with the smallest eigenvalue: inverse iteration.
    pub(crate) fn point(&self, pixels: [&Vector2<f64>; 2], confidence: [f64; 2]) -> Vector3<f64> {
        let nan = Vector3::repeat(f64::NAN);
        if !(pixels[0].x + pixels[1].x).is_finite() {
            return nan;
        }
        let strongest = confidence[0].max(confidence[1]);
        let mut square = Matrix4::zeros();
        for k in 0..2 {
            for row in self.frame.weighed(&self.cameras[k], &self.rows[k], pixels[k]) {
                let row = row * (confidence[k] / strongest);
                square += row.transpose() * row;
            }
        }
        let shifted = square + Matrix4::identity() * (SHIFT * square.trace());
        let Some(inverse) = shifted.try_inverse() else { return nan };
        let inverse = inverse / inverse.trace();
        let twice = inverse * inverse;
        let longest = (0..4).fold(0, |k, l| if twice[(l, l)] > twice[(k, k)] { l } else { k });
        let mut h = twice.column(longest).into_owned(); // its largest eigenvalue is nearly the trace: no overflow
        for _ in 0..ITERATIONS {
            h = twice * h;
        }
        if h.w.is_nan() || h.w.abs() <= AT_INFINITY * h.norm() {
            return nan;
        }
        let x = self.frame.origin + h.xyz() * (self.frame.length / h.w);
        let in_front = self.cameras.iter().any(|camera| camera.to_camera(&x).z > NEAR);
        if in_front { x } else { nan }
    }
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

    /// Rows of [R | t] of a camera.
    fn extrinsics(&self, camera: &Camera) -> [RowVector4<f64>; 3] {
        let r = camera.rotation();
        let t = camera.to_camera(&self.origin) / self.length;
        [0, 1, 2].map(|k| RowVector4::new(r[(k, 0)], r[(k, 1)], r[(k, 2)], t[k]))
    }

    fn rows(&self, camera: &Camera, pixel: &Vector2<f64>) -> [RowVector4<f64>; 2] {
        self.weighed(camera, &self.extrinsics(camera), pixel)
    }

    /// u P₃ − P₁ = fx·(x̂ r₃ − r₁) with x̂ = (u − cx)/fx, and likewise for v, in units of the largest focal length.
    fn weighed(
        &self,
        camera: &Camera,
        p: &[RowVector4<f64>; 3],
        pixel: &Vector2<f64>,
    ) -> [RowVector4<f64>; 2] {
        let ([fx, fy], [cx, cy]) = (camera.focal(), camera.principal_point());
        [
            (p[2] * ((pixel.x - cx) / fx) - p[0]) * (fx / self.focal),
            (p[2] * ((pixel.y - cy) / fy) - p[1]) * (fy / self.focal),
        ]
    }
}

/// Rotates one more row into an upper triangular `R` with `RᵀR = AᵀA`, so that the number of views needs no storage.
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

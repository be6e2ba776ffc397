//! Triangulation from two views that is done very often: four joints at a time, without a decomposition.

use nalgebra::{Matrix3, RowVector4, Vector3};
use wide::f64x4;

use super::dlt::{AT_INFINITY, RigFrame};
use crate::camera::{Camera, NEAR};

/// Trace of the adjugate of AᵀA, relative to that of AᵀA cubed, below which the rays do not determine a point.
const RANK: f64 = 1e-14;
/// Steps of the inverse iteration, at most; it ends with a step of this square, relative to the point's.
const STEPS: usize = 16;
const SETTLED: f64 = 1e-18;
/// Square of a distance, in lengths of the rig, from which a point is at infinity.
const FARTHEST: f64x4 = f64x4::splat(1.0 / (AT_INFINITY * AT_INFINITY));
const MISSING: f64x4 = f64x4::splat(f64::NAN);

/// Four joints in one view: ideal pixels from the principal point, NaN where missing, and confidences.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen {
    pub(crate) x: f64x4,
    pub(crate) y: f64x4,
    pub(crate) confidence: f64x4,
}

/// Two cameras: as [`super::dlt()`], up to rounding.
pub(crate) struct TwoViews {
    frame: RigFrame,
    /// Rows of [R | t] of the cameras in the frame: the third over the focal length, the others in units of it.
    rows: [[RowVector4<f64>; 3]; 2],
    /// Third rows of [R | t].
    depth: [RowVector4<f64>; 2],
    /// Fundamental matrix: bᵀ F a = 0 for homogeneous ideal pixels from the principal points.
    fundamental: Matrix3<f64>,
}

impl TwoViews {
    pub(crate) fn new(one: &Camera, other: &Camera) -> Self {
        let rotation = other.rotation() * one.rotation().transpose();
        let shift = other.to_camera(&one.centre());
        let inverse = |camera: &Camera| {
            let [fx, fy] = camera.focal();
            Matrix3::from_diagonal(&Vector3::new(1.0 / fx, 1.0 / fy, 1.0))
        };
        let fundamental = inverse(other) * shift.cross_matrix() * rotation * inverse(one);
        let frame = RigFrame::of([one, other].into_iter());
        let rows = [one, other].map(|camera| {
            let ([fx, fy], [p, q, r]) = (camera.focal(), frame.extrinsics(camera));
            [p * (fx / frame.focal), q * (fy / frame.focal), r / frame.focal]
        });
        let depth = [one, other].map(|camera| frame.extrinsics(camera)[2]);
        Self { frame, rows, depth, fundamental }
    }

    /// The lines (a, b, c) in the second view of joints in the first, and a² + b².
    #[inline]
    pub(crate) fn lines(&self, one: &Seen) -> [f64x4; 4] {
        let (f, Seen { x, y, .. }) = (&self.fundamental, *one);
        let a = x * f[(0, 0)] + y * f[(0, 1)] + f[(0, 2)];
        let b = x * f[(1, 0)] + y * f[(1, 1)] + f[(1, 2)];
        let c = x * f[(2, 0)] + y * f[(2, 1)] + f[(2, 2)];
        [a, b, c, a * a + b * b]
    }

    /// By how many pixels joints of the second view miss the lines, to first order, squared; NaN if one is missing.
    #[inline]
    pub(crate) fn apart2(&self, lines: &[f64x4; 4], other: &Seen) -> f64x4 {
        let (f, Seen { x, y, .. }) = (&self.fundamental, *other);
        let miss = x * lines[0] + y * lines[1] + lines[2];
        let a = x * f[(0, 0)] + y * f[(1, 0)] + f[(2, 0)];
        let b = x * f[(0, 1)] + y * f[(1, 1)] + f[(2, 1)];
        miss * miss / (a * a + b * b + lines[3])
    }

    /// The joints in the world; NaN where [`super::dlt()`] has no point.
    #[inline]
    pub(crate) fn points(&self, one: &Seen, other: &Seen) -> [f64x4; 3] {
        let weight = f64x4::ONE / one.confidence.fast_max(other.confidence);
        let mut square = [f64x4::ZERO; 10];
        add_view(&mut square, one, &self.rows[0], one.confidence * weight);
        add_view(&mut square, other, &self.rows[1], other.confidence * weight);
        let inverse = adjugate(&square);
        let trace = (square[0] + square[4]) + (square[7] + square[9]);
        let determined = ((inverse[0] + inverse[4]) + (inverse[7] + inverse[9]))
            .simd_gt(trace * trace * trace * RANK);
        let [x, y, z] = smallest(&inverse);
        let near = (x * x + y * y + z * z).simd_le(FARTHEST);
        let depth = |row: &RowVector4<f64>| x * row[0] + y * row[1] + z * row[2] + row[3];
        let least = f64x4::splat(NEAR / self.frame.length);
        let in_front = depth(&self.depth[0]).simd_gt(least) | depth(&self.depth[1]).simd_gt(least);
        let there = determined & near & in_front;
        let (length, origin) = (self.frame.length, &self.frame.origin);
        [
            there.bitselect(x * length + origin.x, MISSING),
            there.bitselect(y * length + origin.y, MISSING),
            there.bitselect(z * length + origin.z, MISSING),
        ]
    }
}

/// Adds a view's rows to AᵀA, their upper half by rows.
#[inline]
fn add_view(square: &mut [f64x4; 10], seen: &Seen, rows: &[RowVector4<f64>; 3], weight: f64x4) {
    let [p, q, r] = rows;
    let (x, y) = (seen.x, seen.y);
    let u = |k: usize| (x * r[k] - p[k]) * weight;
    let v = |k: usize| (y * r[k] - q[k]) * weight;
    let (a, b, c, d) = (u(0), u(1), u(2), u(3));
    let (e, f, g, h) = (v(0), v(1), v(2), v(3));
    square[0] += a * a + e * e;
    square[1] += a * b + e * f;
    square[2] += a * c + e * g;
    square[3] += a * d + e * h;
    square[4] += b * b + f * f;
    square[5] += b * c + f * g;
    square[6] += b * d + f * h;
    square[7] += c * c + g * g;
    square[8] += c * d + g * h;
    square[9] += d * d + h * h;
}

/// The inverse of a symmetric matrix times its determinant, which may be 0.
#[inline]
fn adjugate([a, b, c, d, e, f, g, h, i, j]: &[f64x4; 10]) -> [f64x4; 10] {
    let (a, b, c, d, e, f, g, h, i, j) = (*a, *b, *c, *d, *e, *f, *g, *h, *i, *j);
    // Minors of the first two rows and of the last two; the last of the former is the first of the latter.
    let (m01, m02, m03) = (a * e - b * b, a * f - c * b, a * g - d * b);
    let (m12, m13, m23) = (b * f - c * e, b * g - d * e, c * g - d * f);
    let (n02, n03, n12) = (c * i - h * d, c * j - i * d, f * i - h * g);
    let (n13, n23) = (f * j - i * g, h * j - i * i);
    [
        e * n23 - f * n13 + g * n12,
        c * n13 - b * n23 - d * n12,
        g * m23 - i * m13 + j * m12,
        h * m13 - f * m23 - i * m12,
        a * n23 - c * n03 + d * n02,
        i * m03 - d * m23 - j * m02,
        c * m23 - h * m03 + i * m02,
        d * m13 - g * m03 + j * m01,
        f * m03 - c * m13 - i * m01,
        c * m12 - f * m02 + h * m01,
    ]
}

/// The eigenvector of a matrix for its smallest eigenvalue, divided by its last entry, from the matrix's adjugate.
#[inline]
fn smallest(m: &[f64x4; 10]) -> [f64x4; 3] {
    let (mut a, mut b, mut c, mut d) = (m[3], m[6], m[8], m[9]);
    let (mut x, mut y, mut z) = (MISSING, MISSING, MISSING);
    for step in 0..STEPS {
        (a, b, c, d) = (
            m[0] * a + m[1] * b + (m[2] * c + m[3] * d),
            m[1] * a + m[4] * b + (m[5] * c + m[6] * d),
            m[2] * a + m[5] * b + (m[7] * c + m[8] * d),
            m[3] * a + m[6] * b + (m[8] * c + m[9] * d),
        );
        let over = f64x4::ONE / d;
        let (u, v, w) = (a * over, b * over, c * over);
        let (p, q, r) = (u - x, v - y, w - z);
        (x, y, z) = (u, v, w);
        let least = (u * u + v * v + w * w + 1.0) * SETTLED;
        if step > 0 && !(p * p + q * q + r * r).simd_gt(least).any() {
            break;
        }
    }
    [x, y, z]
}

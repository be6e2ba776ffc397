//! Triangulation from two views that is done very often: four joints at a time, without a
//! decomposition.

use nalgebra::{Matrix3, Matrix4, RowVector4};
use wide::f64x4;

use super::dlt::{AT_INFINITY, RigFrame};
use crate::camera::{Camera, NEAR};

/// Trace of the adjugate of AᵀA, relative to that of AᵀA cubed, below which the rays do not
/// determine a point.
const RANK: f64 = 1e-14;
/// Most steps towards the smallest eigenvalue.
const STEPS: usize = 16;
/// Size of the last step, relative to the gap above the eigenvalue.
const SETTLED: f64 = 1e-6;
/// Square of a distance, in lengths of the rig, from which a point is at infinity.
const FARTHEST: f64x4 = f64x4::splat(1.0 / (AT_INFINITY * AT_INFINITY));
/// A joint without a position.
const MISSING: f64x4 = f64x4::splat(f64::NAN);

/// Four joints in one view: ideal pixels from the principal point, NaN where missing, and
/// confidences.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FourJoints {
    pub(crate) x: f64x4,
    pub(crate) y: f64x4,
    pub(crate) confidence: f64x4,
}

/// Two cameras: as [`super::dlt()`], up to rounding.
pub(crate) struct TwoViews {
    frame: RigFrame,
    /// Rows of [R | t] of the cameras in the frame: the third over the focal length, the others in
    /// units of it.
    rows: [[RowVector4<f64>; 3]; 2],
    /// Third rows of [R | t].
    depth: [RowVector4<f64>; 2],
    /// Fundamental matrix: bᵀ F a, for homogeneous ideal pixels from the principal points, is the
    /// determinant of their rows.
    fundamental: Matrix3<f64>,
}

impl TwoViews {
    pub(crate) fn new(first: &Camera, other: &Camera) -> Self {
        let frame = RigFrame::of([first, other].into_iter());
        let rows = [first, other].map(|camera| {
            let ([fx, fy], [p, q, r]) = (camera.focal(), frame.extrinsics(camera));
            [p * (fx / frame.focal), q * (fy / frame.focal), r / frame.focal]
        });
        let depth = [first, other].map(|camera| frame.extrinsics(camera)[2]);
        let others = |k: usize, side: usize| [(k + 1) % 3, (k + 2) % 3].map(|k| rows[side][k]);
        let fundamental = Matrix3::from_fn(|i, j| {
            let ([p, q], [r, s]) = (others(j, 0), others(i, 1));
            Matrix4::from_rows(&[p, q, r, s]).determinant()
        });
        Self { frame, rows, depth, fundamental }
    }

    /// The lines (a, b, c) in the second view of joints in the first, and a² + b².
    #[inline]
    pub(crate) fn lines(&self, seen: &FourJoints) -> [f64x4; 4] {
        let (f, FourJoints { x, y, .. }) = (&self.fundamental, *seen);
        let a = x * f[(0, 0)] + y * f[(0, 1)] + f[(0, 2)];
        let b = x * f[(1, 0)] + y * f[(1, 1)] + f[(1, 2)];
        let c = x * f[(2, 0)] + y * f[(2, 1)] + f[(2, 2)];
        [a, b, c, a * a + b * b]
    }

    /// By how many pixels joints of the second view miss the lines, to first order, squared; NaN if
    /// one is missing.
    #[inline]
    pub(crate) fn apart2(&self, lines: &[f64x4; 4], other: &FourJoints) -> f64x4 {
        let (f, FourJoints { x, y, .. }) = (&self.fundamental, *other);
        let miss = x * lines[0] + y * lines[1] + lines[2];
        let a = x * f[(0, 0)] + y * f[(1, 0)] + f[(2, 0)];
        let b = x * f[(0, 1)] + y * f[(1, 1)] + f[(2, 1)];
        miss * miss / (a * a + b * b + lines[3])
    }

    /// The joints in the world; NaN where [`super::dlt()`] has no point.
    #[inline]
    pub(crate) fn points(&self, seen: &FourJoints, other: &FourJoints) -> [f64x4; 3] {
        let weight = f64x4::ONE / seen.confidence.fast_max(other.confidence);
        let weights = [seen.confidence * weight, other.confidence * weight];
        let mut square = [f64x4::ZERO; 10];
        add_view(&mut square, seen, &self.rows[0], weights[0]);
        add_view(&mut square, other, &self.rows[1], weights[1]);
        let [a, b, c, _] = self.lines(seen);
        let weight = weights[0] * weights[1];
        let root = (other.x * a + other.y * b + c) * (weight * weight);
        let (determined, [x, y, z]) = smallest(&square, root * root);
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
fn add_view(
    square: &mut [f64x4; 10],
    seen: &FourJoints,
    rows: &[RowVector4<f64>; 3],
    weight: f64x4,
) {
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

/// The eigenvector of a symmetric matrix, with its determinant, for the smallest eigenvalue,
/// divided by its last entry; and whether there is only one.
///
/// Newton's steps on the characteristic polynomial stay below its roots if they start there. The
/// eigenvector is a column of the adjugate of what is left of the matrix. Determinants of matrices
/// of nearly rank 3 have to be those of their roots, squared.
#[inline]
fn smallest(square: &[f64x4; 10], determinant: f64x4) -> (f64x4, [f64x4; 3]) {
    let &[a, b, c, d, e, f, g, h, i, j] = square;
    // Minors of the first two rows and of the last quadratic; the last of the former is the first
    // of the latter.
    let (m01, m02, m03) = (a * e - b * b, a * f - c * b, a * g - d * b);
    let (m12, m13, m23) = (b * f - c * e, b * g - d * e, c * g - d * f);
    let (n02, n03, n12) = (c * i - h * d, c * j - i * d, f * i - h * g);
    let (n13, n23) = (f * j - i * g, h * j - i * i);
    let linear = (e * n23 - f * n13 + g * n12) + (a * n23 - c * n03 + d * n02);
    let linear = linear + ((j * m01 - g * m03 + d * m13) + (h * m01 - f * m02 + c * m12));
    let quadratic =
        (m01 + n23) + (a * h - c * c) + (a * j - d * d) + (e * h - f * f) + (e * j - g * g);
    let cubic = (a + e) + (h + j);
    let mut root = determinant / linear;
    let least = linear / quadratic * SETTLED;
    for _ in 0..STEPS {
        let value = (((root - cubic) * root + quadratic) * root - linear) * root + determinant;
        let slope = ((root * 4.0 - cubic * 3.0) * root + quadratic * 2.0) * root - linear;
        let step = slope.simd_lt(f64x4::ZERO) & (value / slope);
        root -= step;
        if !step.abs().simd_gt(least).any() {
            break;
        }
    }
    let (a, e, h) = (a - root, e - root, h - root);
    let (m01, m02, m03) = (a * e - b * b, a * f - c * b, a * g - d * b);
    let (m12, m13) = (b * f - c * e, b * g - d * e);
    let over = f64x4::ONE / (h * m01 - f * m02 + c * m12);
    let x = (h * m13 - f * m23 - i * m12) * over;
    let y = (i * m02 - h * m03 + c * m23) * over;
    let z = (f * m03 - c * m13 - i * m01) * over;
    (linear.simd_gt(cubic * cubic * cubic * RANK), [x, y, z])
}

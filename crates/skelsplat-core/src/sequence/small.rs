//! Small arithmetic: medians, and products of 3×3 matrices, written out: the library's general ones
//! are not inlined everywhere, and take several times as long.

use nalgebra::{Matrix3, Vector3};

use crate::symmetric::Symmetric;

/// A v.
#[inline(always)]
pub(super) fn times(a: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(
        a.m11 * v.x + a.m12 * v.y + a.m13 * v.z,
        a.m21 * v.x + a.m22 * v.y + a.m23 * v.z,
        a.m31 * v.x + a.m32 * v.y + a.m33 * v.z,
    )
}

/// Aᵀ v.
#[inline(always)]
pub(super) fn transposed_times(a: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(
        a.m11 * v.x + a.m21 * v.y + a.m31 * v.z,
        a.m12 * v.x + a.m22 * v.y + a.m32 * v.z,
        a.m13 * v.x + a.m23 * v.y + a.m33 * v.z,
    )
}

/// A B.
#[inline(always)]
pub(super) fn product(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    let column = |x: f64, y: f64, z: f64| times(a, &Vector3::new(x, y, z));
    let (x, y, z) =
        (column(b.m11, b.m21, b.m31), column(b.m12, b.m22, b.m32), column(b.m13, b.m23, b.m33));
    Matrix3::new(x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z)
}

/// The inverse of a symmetric positive definite matrix; zero where it has none, so that nothing
/// moves.
#[inline(always)]
pub(super) fn inverse(m: &Matrix3<f64>) -> Matrix3<f64> {
    let symmetric = Symmetric::of(m);
    let cofactors = symmetric.cofactors();
    let determinant = symmetric.determinant(&cofactors);
    if determinant.is_nan() || determinant <= 0.0 {
        return Matrix3::zeros();
    }
    cofactors.scaled(1.0 / determinant).matrix()
}

/// The median; NaN of nothing.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Number of frames in `seconds`, at least one.
#[must_use]
pub(super) fn frames_in(seconds: f64, fps: f64) -> usize {
    ((seconds * fps).round() as usize).max(1)
}

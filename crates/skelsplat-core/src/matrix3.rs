//! 3×3 matrices, written out: sums over rays, products and small inverses are what most time goes
//! into, and the library's general ones, not inlined everywhere, take several times as long.

use std::ops::{Add, Mul, Neg, Sub};

use nalgebra::{Matrix3, Vector3};

/// Numbers, or several of them at a time.
pub(crate) trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
}

impl<T> Number for T where
    T: Copy + Add<Output = T> + Sub<Output = T> + Mul<Output = T> + Neg<Output = T>
{
}

/// Determinant, relative to the cube of the mean eigenvalue, below which cofactors lose more than
/// half of the digits to rounding: that of two rays at 0.1 mrad from each other.
pub(crate) const ILL_CONDITIONED: f64 = 1e-8;

/// A symmetric 3×3 matrix: xx, xy, xz, yy, yz, zz.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Symmetric<T = f64>(pub(crate) [T; 6]);

impl<T: Number> Symmetric<T> {
    /// Adds `w` d dᵀ.
    #[inline(always)]
    pub(crate) fn add_outer(&mut self, w: T, d: &[T; 3]) {
        let (v, a) = (d.map(|d| w * d), &mut self.0);
        a[0] = a[0] + v[0] * d[0];
        a[1] = a[1] + v[0] * d[1];
        a[2] = a[2] + v[0] * d[2];
        a[3] = a[3] + v[1] * d[1];
        a[4] = a[4] + v[1] * d[2];
        a[5] = a[5] + v[2] * d[2];
    }

    /// s (w I − A) + μ I: with A = Σ w d dᵀ over rays and w = Σ w, the information Σ w (I − d dᵀ)
    /// of what lies across them.
    #[inline(always)]
    #[must_use]
    pub(crate) fn below(&self, w: T, s: T, mu: T) -> Self {
        let [xx, xy, xz, yy, yz, zz] = self.0;
        let diagonal = |a: T| (w - a) * s + mu;
        Self([diagonal(xx), -(xy * s), -(xz * s), diagonal(yy), -(yz * s), diagonal(zz)])
    }

    /// The cofactors: |A| A⁻¹.
    #[inline(always)]
    #[must_use]
    pub(crate) fn cofactors(&self) -> Self {
        let [xx, xy, xz, yy, yz, zz] = self.0;
        Self([
            yy * zz - yz * yz,
            xz * yz - xy * zz,
            xy * yz - xz * yy,
            xx * zz - xz * xz,
            xy * xz - xx * yz,
            xx * yy - xy * xy,
        ])
    }

    /// |A|, from the cofactors.
    #[inline(always)]
    pub(crate) fn determinant(&self, cofactors: &Self) -> T {
        let (a, c) = (&self.0, &cofactors.0);
        a[0] * c[0] + a[1] * c[1] + a[2] * c[2]
    }

    /// Sum of the eigenvalues.
    #[inline(always)]
    pub(crate) fn trace(&self) -> T {
        self.0[0] + self.0[3] + self.0[5]
    }

    /// A v.
    #[inline(always)]
    pub(crate) fn times(&self, v: &[T; 3]) -> [T; 3] {
        let [xx, xy, xz, yy, yz, zz] = self.0;
        [
            xx * v[0] + xy * v[1] + xz * v[2],
            xy * v[0] + yy * v[1] + yz * v[2],
            xz * v[0] + yz * v[1] + zz * v[2],
        ]
    }

    /// s A.
    #[inline(always)]
    #[must_use]
    pub(crate) fn scaled(&self, s: T) -> Self {
        Self(self.0.map(|a| a * s))
    }

    /// Adds B.
    #[inline(always)]
    pub(crate) fn add(&mut self, other: &Self) {
        self.0.iter_mut().zip(other.0).for_each(|(a, b)| *a = *a + b);
    }
}

impl Symmetric {
    /// The upper triangle of `m`.
    #[inline(always)]
    pub(crate) fn of(m: &Matrix3<f64>) -> Self {
        Self([m.m11, m.m12, m.m13, m.m22, m.m23, m.m33])
    }

    /// All nine entries.
    #[inline(always)]
    pub(crate) fn matrix(&self) -> Matrix3<f64> {
        let [xx, xy, xz, yy, yz, zz] = self.0;
        Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    }

    /// A⁻¹ if |A| is above `least`.
    #[inline(always)]
    pub(crate) fn inverse_above(&self, least: f64) -> Option<Matrix3<f64>> {
        let cofactors = self.cofactors();
        let determinant = self.determinant(&cofactors);
        (determinant > least).then(|| cofactors.scaled(1.0 / determinant).matrix())
    }
}

/// The inverse of a symmetric positive definite matrix; zero where it has none, so that nothing
/// moves.
#[inline(always)]
pub(crate) fn inverse(m: &Matrix3<f64>) -> Matrix3<f64> {
    Symmetric::of(m).inverse_above(0.0).unwrap_or_else(Matrix3::zeros)
}

/// ½ (A + Aᵀ).
pub(crate) fn symmetrised(m: &Matrix3<f64>) -> Matrix3<f64> {
    (m + m.transpose()) * 0.5
}

/// A v.
#[inline(always)]
pub(crate) fn times(a: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(
        a.m11 * v.x + a.m12 * v.y + a.m13 * v.z,
        a.m21 * v.x + a.m22 * v.y + a.m23 * v.z,
        a.m31 * v.x + a.m32 * v.y + a.m33 * v.z,
    )
}

/// A B.
#[inline(always)]
pub(crate) fn product(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    let column = |x: f64, y: f64, z: f64| times(a, &Vector3::new(x, y, z));
    let (x, y, z) =
        (column(b.m11, b.m21, b.m31), column(b.m12, b.m22, b.m32), column(b.m13, b.m23, b.m33));
    Matrix3::new(x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z)
}

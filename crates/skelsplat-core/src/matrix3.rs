//! 3×3 matrices, written out: sums over rays, products and small inverses are what most time goes
//! into, and the library's general ones, not inlined everywhere, take several times as long.

use nalgebra::{Matrix3, Vector3};

/// A symmetric 3×3 matrix.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Symmetric {
    xx: f64,
    xy: f64,
    xz: f64,
    yy: f64,
    yz: f64,
    zz: f64,
}

impl Symmetric {
    /// The upper triangle of `m`.
    #[inline(always)]
    pub(crate) fn of(m: &Matrix3<f64>) -> Self {
        Self { xx: m.m11, xy: m.m12, xz: m.m13, yy: m.m22, yz: m.m23, zz: m.m33 }
    }

    /// Adds `w` d dᵀ.
    #[inline(always)]
    pub(crate) fn add_outer(&mut self, w: f64, d: &Vector3<f64>) {
        let wd = w * d;
        self.xx += wd.x * d.x;
        self.xy += wd.x * d.y;
        self.xz += wd.x * d.z;
        self.yy += wd.y * d.y;
        self.yz += wd.y * d.z;
        self.zz += wd.z * d.z;
    }

    /// w I − A: with A = Σ w d dᵀ over rays and w = Σ w, the information Σ w (I − d dᵀ) of what
    /// lies across them.
    #[inline(always)]
    #[must_use]
    pub(crate) fn below(&self, w: f64) -> Self {
        let Self { xx, xy, xz, yy, yz, zz } = *self;
        Self { xx: w - xx, xy: -xy, xz: -xz, yy: w - yy, yz: -yz, zz: w - zz }
    }

    /// The cofactors: |A| A⁻¹.
    #[inline(always)]
    #[must_use]
    pub(crate) fn cofactors(&self) -> Self {
        let (a, b, c, d, e, f) = (self.xx, self.xy, self.xz, self.yy, self.yz, self.zz);
        Self {
            xx: d * f - e * e,
            xy: c * e - b * f,
            xz: b * e - c * d,
            yy: a * f - c * c,
            yz: b * c - a * e,
            zz: a * d - b * b,
        }
    }

    /// |A|, from the cofactors.
    #[inline(always)]
    pub(crate) fn determinant(&self, cofactors: &Self) -> f64 {
        self.xx * cofactors.xx + self.xy * cofactors.xy + self.xz * cofactors.xz
    }

    /// Mean of the eigenvalues.
    #[inline(always)]
    pub(crate) fn scale(&self) -> f64 {
        (self.xx + self.yy + self.zz) / 3.0
    }

    /// A v.
    #[inline(always)]
    pub(crate) fn times(&self, v: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(
            self.xx * v.x + self.xy * v.y + self.xz * v.z,
            self.xy * v.x + self.yy * v.y + self.yz * v.z,
            self.xz * v.x + self.yz * v.y + self.zz * v.z,
        )
    }

    /// s A.
    #[inline(always)]
    #[must_use]
    pub(crate) fn scaled(&self, s: f64) -> Self {
        let Self { xx, xy, xz, yy, yz, zz } = *self;
        Self { xx: xx * s, xy: xy * s, xz: xz * s, yy: yy * s, yz: yz * s, zz: zz * s }
    }

    /// All nine entries.
    #[inline(always)]
    pub(crate) fn matrix(&self) -> Matrix3<f64> {
        let Self { xx, xy, xz, yy, yz, zz } = *self;
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

/// Aᵀ v.
#[inline(always)]
pub(crate) fn transposed_times(a: &Matrix3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
    times(&a.transpose(), v)
}

/// A B.
#[inline(always)]
pub(crate) fn product(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Matrix3<f64> {
    let column = |x: f64, y: f64, z: f64| times(a, &Vector3::new(x, y, z));
    let (x, y, z) =
        (column(b.m11, b.m21, b.m31), column(b.m12, b.m22, b.m32), column(b.m13, b.m23, b.m33));
    Matrix3::new(x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z)
}

//! Symmetric 3×3 matrices by their upper triangle, written out: sums over rays and small inverses
//! are what most time goes into, and general matrices take several times as long.

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
}

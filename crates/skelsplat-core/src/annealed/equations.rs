//! The posterior covariance of joints coupled by few scalar residuals.
//!
//! The normal matrix is H = D + G Λ Gᵀ: a 3×3 block D_j per joint (its detections and its prior)
//! and one rank-one term per coupling (a symmetric pair of limbs, a bone), whose gradient is the
//! column g of G. Woodbury's identity inverts it exactly, coupled limbs together, with nothing
//! larger than the number of couplings P:
//!
//! ```text
//! H⁻¹ = D⁻¹ − D⁻¹ G Q⁻¹ Gᵀ D⁻¹        Q = Λ⁻¹ + Gᵀ D⁻¹ G   (P × P)
//! ```

use nalgebra::{DMatrix, Matrix3, Vector3};

use crate::matrix3::{ILL_CONDITIONED, Symmetric};

/// A scalar residual r of four joints, or of two.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coupling {
    /// The joints.
    pub joints: [usize; 4],
    /// ∂r/∂x of each.
    pub gradient: [Vector3<f64>; 4],
    /// r.
    pub residual: f64,
    /// Λ, its inverse variance.
    pub precision: f64,
    /// Length of the longer limb, or of the bone, mm.
    pub length: f64,
}

impl Coupling {
    /// Whether it is that of a bone.
    pub fn is_bone(&self) -> bool {
        self.gradient[2] == Vector3::zeros()
    }

    /// The joints that it moves, each with ∂r/∂x.
    pub fn ends(&self) -> impl Iterator<Item = (usize, &Vector3<f64>)> {
        let n = if self.is_bone() { 2 } else { 4 };
        self.joints[..n].iter().copied().zip(&self.gradient)
    }

    /// Bounds of the curvature that residuals far from zero have, for the blocks of two joints.
    ///
    /// With limbs of lengths l, whose unit vectors u change with their ends, the Hessian of ½ Λ r²
    /// has Λ r ∇²r besides Λ g gᵀ. Its part that is positive in r ∇²r is |r| (I − u uᵀ)/l across
    /// the longer limb, its ends against each other; [A, −A; −A, A] ≤ diag(2A, 2A). Where a joint's
    /// only ray is at right angles to its limb the first term vanishes along the ray, and a step
    /// without the second always overshoots.
    pub fn bend(&self) -> Option<([usize; 2], Matrix3<f64>)> {
        if self.is_bone() && self.residual <= 0.0 {
            return None;
        }
        let longer = if self.residual > 0.0 { 0 } else { 2 };
        let (ends, u) = ([self.joints[longer], self.joints[longer + 1]], self.gradient[longer]);
        let strength = 2.0 * self.precision * self.residual.abs() / self.length;
        Some((ends, (Matrix3::identity() - u * u.transpose()) * strength))
    }
}

/// Factor on the diagonal of Q, so that rounding leaves it positive definite.
pub(super) const RIDGE: f64 = 1.0 + 1e-12;

/// The diagonal blocks of H⁻¹; zero where a joint is not determined.
pub fn covariances(blocks: &[Matrix3<f64>], couplings: &[Coupling]) -> Vec<Matrix3<f64>> {
    let mut covariances: Vec<Matrix3<f64>> = blocks.iter().map(inverse_of).collect();
    let (n, p) = (3 * blocks.len(), couplings.len());
    // D⁻¹ G, transposed, and Q.
    let (mut moves, mut q) = (DMatrix::zeros(p, n), DMatrix::zeros(p, p));
    for (a, coupling) in couplings.iter().enumerate() {
        for (j, gradient) in coupling.ends() {
            let mut of_joint = moves.fixed_view_mut::<1, 3>(a, 3 * j);
            of_joint += (covariances[j] * gradient).transpose();
        }
    }
    for (b, coupling) in couplings.iter().enumerate() {
        for (j, gradient) in coupling.ends() {
            let mut column = q.column_mut(b);
            column += moves.fixed_columns::<3>(3 * j) * gradient;
        }
        q[(b, b)] = RIDGE * (q[(b, b)] + 1.0 / coupling.precision);
    }
    let gained = q.cholesky().and_then(|factor| factor.l().solve_lower_triangular(&moves));
    if let Some(gained) = gained.filter(|_| p > 0) {
        for (j, covariance) in covariances.iter_mut().enumerate() {
            let of_joint = gained.fixed_columns::<3>(3 * j);
            *covariance -= of_joint.tr_mul(&of_joint);
        }
    }
    covariances
}

/// Inverse of a symmetric positive definite matrix, zero where it has none.
#[inline]
pub(super) fn inverse_of(m: &Matrix3<f64>) -> Matrix3<f64> {
    let symmetric = Symmetric::of(m);
    let scale = symmetric.trace() / 3.0;
    let least = ILL_CONDITIONED * scale * scale * scale;
    let carefully = || m.cholesky().map_or_else(Matrix3::zeros, |factor| factor.inverse());
    symmetric.inverse_above(least).unwrap_or_else(carefully)
}

//! Lengths of bones: the residual (‖x_a − x_b‖ − l)/σ under a robust kernel, with value, gradient
//! and Gauss–Newton block.
//!
//! With d = x_a − x_b, u = d/‖d‖ and r = ‖d‖ − l the term κ(r) is a Welsch loss of reach c = 6σ,
//!
//! ```text
//! E = c²/σ² (1 − exp(−r²/2c²))      ∂E/∂x_a = k r/σ² u = −∂E/∂x_b      k = exp(−r²/2c²)
//! H = k/σ² (u uᵀ + (r₊/‖d‖) (I − u uᵀ))
//! ```
//!
//! H is the block of x_a and x_b each, −H the one between them. The second term is the positive
//! part of r ∇²r: without it, a joint with a single ray at right angles to its bone always
//! overshoots.

pub mod expected;
pub mod population;

use nalgebra::{Matrix3, Vector3};

/// Reach of the kernel, in standard deviations, also of accelerations: what
/// differs by more loses its influence like outlying detections.
pub const REACH: f64 = 6.0;

/// The expected length of a bone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Length {
    /// l, mm.
    pub mean: f64,
    /// σ, mm.
    pub sigma: f64,
}

/// The joint at the other end of a bone of joint `j`; `None` if it is no bone of this joint.
pub fn other_end([a, b]: [usize; 2], j: usize) -> Option<usize> {
    match j {
        j if j == a => Some(b),
        j if j == b => Some(a),
        _ => None,
    }
}

/// A bone with its expected length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bone {
    /// Its joints.
    pub joints: [usize; 2],
    /// l and σ, mm.
    pub length: Length,
}

/// A bone's term at two positions, linearised; by default none: of an unknown length, or of ends
/// that coincide.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Pull {
    /// E.
    pub loss: f64,
    /// u.
    pub along: Vector3<f64>,
    /// ∂E/∂x_a along u.
    pub slope: f64,
    /// k/σ², the block along u.
    pub stiffness: f64,
    /// k r₊/(σ² ‖d‖), the block across u.
    pub bend: f64,
}

impl Pull {
    /// The term of a bone from `b` to `a`.
    #[inline]
    pub fn new(a: &Vector3<f64>, b: &Vector3<f64>, length: Length) -> Self {
        let d = a - b;
        let long = d.norm();
        if !(long > 0.0 && length.sigma.is_finite()) {
            return Self::default();
        }
        let r = long - length.mean;
        let variance = length.sigma * length.sigma;
        let kept = (-0.5 * r * r / (REACH * REACH * variance)).exp();
        let stiffness = kept / variance;
        Self {
            loss: REACH * REACH * (1.0 - kept),
            along: d / long,
            slope: stiffness * r,
            stiffness,
            bend: stiffness * r.max(0.0) / long,
        }
    }

    /// ∂E/∂x_a = −∂E/∂x_b.
    #[inline]
    pub fn gradient(&self) -> Vector3<f64> {
        self.along * self.slope
    }

    /// H times a vector.
    #[inline]
    pub fn times(&self, v: &Vector3<f64>) -> Vector3<f64> {
        self.along * ((self.stiffness - self.bend) * self.along.dot(v)) + v * self.bend
    }

    /// H.
    #[inline]
    pub fn block(&self) -> Matrix3<f64> {
        self.along * (self.along * (self.stiffness - self.bend)).transpose()
            + Matrix3::from_diagonal_element(self.bend)
    }
}

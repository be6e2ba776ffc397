//! The rendering loss of one channel in closed form: no pixels, no window, any σ at the same cost.
//!
//! A channel holds one Gaussian R = exp(−½ (p−m)ᵀΣr⁻¹(p−m)) and its target P = exp(−½
//! (p−d)ᵀΣp⁻¹(p−d)). Over the plane ∫R² = π√|Σr|, and the product of two Gaussians is a Gaussian,
//! so that with C = Σr + Σp, r = m − d
//!
//! ```text
//! k        = exp(−½ rᵀ C⁻¹ r)
//! B        = 4π √(|Σr| |Σp| / |C|) · k                  (= 2 ∫RP)
//! ∫(R−P)²  = π√|Σr| + π√|Σp| − B
//!
//! ∂/∂m     = B C⁻¹ r
//! ∂/∂Σr    = ½ π √|Σr| Σr⁻¹ − ½ B (Σr⁻¹ − C⁻¹ + C⁻¹ r rᵀ C⁻¹)
//! ```
//!
//! from d√|Σ| = ½ √|Σ| tr(Σ⁻¹dΣ) and d(C⁻¹) = −C⁻¹ dC C⁻¹. With Σr = Σp = S it is 2π√|S| (1 −
//! exp(−¼ rᵀS⁻¹r)), a Welsch loss: k ∈ [0, 1] is how much the detection is trusted. Unlike the
//! raster it has no cut at 1/255, no clamp at 0.99 and no image border.

use std::f64::consts::PI;

use nalgebra::{Matrix2, Vector2};

/// A Gaussian on the image plane with peak 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneGaussian {
    /// Centre, pixels.
    pub mean: Vector2<f64>,
    /// Covariance, pixels².
    pub covariance: Matrix2<f64>,
}

/// ∫(R−P)² of one channel with its gradient.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Overlap {
    /// ∫(R−P)², pixels.
    pub loss: f64,
    /// k, how much the detection is trusted.
    pub weight: f64,
    /// With respect to the render's mean.
    pub d_mean: Vector2<f64>,
    /// With respect to the render's covariance (symmetric, every entry counted).
    pub d_covariance: Matrix2<f64>,
}

impl PlaneGaussian {
    /// ∫R², pixels: the loss of a channel without a render.
    pub fn energy(&self) -> f64 {
        PI * self.covariance.determinant().max(0.0).sqrt()
    }

    /// Compares `self`, the render, with `target`; `None` if a covariance has no inverse.
    pub fn overlap(&self, target: &Self) -> Option<Overlap> {
        let total = self.covariance + target.covariance;
        let (inverse, total_inverse) = (self.covariance.try_inverse()?, total.try_inverse()?);
        let pull = total_inverse * (self.mean - target.mean);
        let weight = (-0.5 * (self.mean - target.mean).dot(&pull)).exp();
        let ratio =
            self.covariance.determinant() * target.covariance.determinant() / total.determinant();
        let shared = 4.0 * PI * ratio.max(0.0).sqrt() * weight;
        let own = self.energy();
        Some(Overlap {
            loss: own + target.energy() - shared,
            weight,
            d_mean: shared * pull,
            d_covariance: 0.5 * own * inverse
                - 0.5 * shared * (inverse - total_inverse + pull * pull.transpose()),
        })
    }
}

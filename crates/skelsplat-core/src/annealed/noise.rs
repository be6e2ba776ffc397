//! The detection noise, estimated from the residuals.
//!
//! e has two degrees of freedom and variance s² along each; a detection of weight c k contributes c
//! k |e|², and a joint's three coordinates take up three degrees. For normal e the kernel k =
//! exp(−|e|²/4σ²) shrinks the mean of |e|² to 2 s² c²/(s²+c²) with c² = 2σ², from the means
//! 2s²(1+s²/c²)⁻² of k|e|² and (1+s²/c²)⁻¹ of k. A scaled inverse χ² prior stabilises the estimate
//! where few detections remain.

use super::rays::{Rays, there};
use nalgebra::Vector3;

/// Prior knowledge of the noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum NoiseModel {
    /// Given: standard deviation per axis for a detection of mean weight, pixels.
    Pixels(f64),
    /// Given: the same across the ray, mm.
    Millimetres(f64),
    /// Unknown: estimated.
    Estimated,
}

/// Scale from pixels and confidences of a frame to mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Scale {
    /// Mean size of a pixel at the joints, mm.
    pub(super) pixel: f64,
    /// Mean weight of the detections.
    pub(super) weight: f64,
    /// Whether the frame has more noise than the prior expects.
    pub(super) refuted: bool,
}

/// Weight of the prior, in residuals: fewer are no estimate.
pub(super) const PRIOR_DOF: f64 = 6.0;
/// The shrinkage by the kernel is corrected up to this factor of the variance.
const MOST_UNSHRUNK: f64 = 4.0;

/// Mean size of a pixel at the joints, mm; `None` if nothing is detected in front of a camera.
pub(super) fn pixel_of(rays: &Rays, points: impl Iterator<Item = Vector3<f64>>) -> Option<f64> {
    let (mut pixel, mut n) = (0.0, 0.0);
    for (j, x) in points.enumerate().filter(|(_, x)| x.x.is_finite()) {
        for ray in there(rays.of_joint(j)) {
            let range = ray.offset(&x).range;
            if range > 0.0 {
                (pixel, n) = (pixel + range * ray.pixel, n + 1.0);
            }
        }
    }
    (n > 0.0).then(|| pixel / n)
}

/// Weighted squares and degrees of freedom of one joint.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Residuals {
    /// Σ c k |e|², mm².
    pub squares: f64,
    /// Σ k.
    pub support: f64,
    /// 2 Σ k − 3, at least 0.
    pub freedom: f64,
}

impl Residuals {
    pub(super) fn new(squares: f64, support: f64) -> Self {
        Self { squares, support, freedom: (2.0 * support - 3.0).max(0.0) }
    }
}

impl NoiseModel {
    /// The prior of the estimate.
    pub const PRIOR_PX: f64 = 3.0;

    /// s², mm², from the joints' squares and degrees of freedom under a kernel of standard
    /// deviation `sigma`; like the squares, it is multiplied by the frame's mean weight.
    pub(super) fn variance(self, [squares, freedom]: [f64; 2], sigma: f64, scale: Scale) -> f64 {
        let Scale { pixel, weight, refuted } = scale;
        match self {
            Self::Pixels(px) => weight * (px * pixel).powi(2),
            Self::Millimetres(mm) => weight * mm * mm,
            Self::Estimated => {
                // Where the frame has more noise than the prior expects, that counts half.
                let dof = if refuted { 0.5 * PRIOR_DOF } else { PRIOR_DOF };
                let prior = dof * weight * (Self::PRIOR_PX * pixel).powi(2);
                let shrunk = (prior + squares) / (dof + freedom);
                let kernel = 2.0 * weight * sigma * sigma;
                shrunk / (1.0 - shrunk / kernel).max(1.0 / MOST_UNSHRUNK)
            }
        }
    }
}

//! What the solver of a frame starts from, and what it finds.

use nalgebra::{Matrix3, Vector3};

use super::noise::{NoiseModel, Residuals};

/// A Gaussian prior of one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// x⁰, mm.
    pub mean: Vector3<f64>,
    /// Π, the inverse of its covariance, mm⁻².
    pub precision: Matrix3<f64>,
    /// Largest standard deviation along an axis of the world, mm; 0 if it has none.
    pub spread: f64,
}

/// The annealing schedule and the stopping rule.
#[derive(Debug, Clone, PartialEq)]
pub struct Annealing {
    /// Widest kernel, mm.
    pub start: f64,
    /// Final kernel of each joint, mm; narrower according to `per_noise`.
    pub end: Vec<f64>,
    /// The final kernel of a joint with `end` equal to `base` is at most this multiple of the
    /// noise, that of others in proportion to `end`; infinite: always `end`.
    pub per_noise: f64,
    /// See [`Self::per_noise`], mm.
    pub base: f64,
    /// Factor from one step to the next.
    pub factor: f64,
    /// σ_sym, mm.
    pub symmetry_sigma: f64,
    /// Maximum number of steps.
    pub max_steps: usize,
    /// The solver stops when no joint moves by more than this fraction of its standard deviation.
    pub tolerance: f64,
    /// Model of the noise.
    pub noise: NoiseModel,
}

impl Annealing {
    /// Widest kernel, and standard deviation per axis of wrong detections, mm: about the distance
    /// between neighbouring joints, as most of them are other parts of the body.
    pub const START: f64 = 320.0;
    /// Widest final kernel, mm.
    pub const END: f64 = 30.0;
    /// Final σ as a multiple of the noise.
    pub const PER_NOISE: f64 = 2.0;
    /// Steps that are shorter than this share of the standard deviation end the work.
    pub const TOLERANCE: f64 = 0.01;
    /// σ_sym, mm.
    pub const SYMMETRY_SIGMA: f64 = 15.0;
}

/// Positions of the joints, and their residuals.
#[derive(Debug, Clone)]
pub struct Solution {
    /// Positions `(N)`, mm; NaN where unknown.
    pub points: Vec<Vector3<f64>>,
    /// Kernel of each joint at the end, mm.
    pub sigma: Vec<f64>,
    /// Residuals of each joint at the end.
    pub residuals: Vec<Residuals>,
    /// Standard deviation of the detection noise across the ray, mm, for a detection of mean
    /// weight.
    pub noise: f64,
    /// ŝ², mm²: the variance for weight 1, as in F.
    pub variance: f64,
    /// Mean size of a pixel at the joints, mm.
    pub pixel: f64,
    /// Steps taken.
    pub n_iter: usize,
    /// Whether the steps became small.
    pub converged: bool,
}

/// From these squares on, in multiples of what is expected, a joint may have more noise.
const LOUD: f64 = 3.0;

impl Solution {
    /// Whether joint `j` may have more noise than the others.
    pub(super) fn is_loud(&self, j: usize) -> bool {
        self.residuals[j].squares > LOUD * self.variance * self.residuals[j].freedom
    }
}

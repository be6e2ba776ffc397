//! The detections' noise in a recording as it is used: a variance for each joint and view, and the
//! kernels that follow it; [`super::scales`] learns it.

use crate::refine::{Method, Refiner};
use crate::statistics::median;

/// Lower limit of a kernel's σ², as a share of what the noise alone would give, once wrong
/// detections are told from noise: errors of recordings are smallest from 0.4 to 0.8.
pub(super) const WIDER: f64 = 0.6;

/// The final kernels of the joints by their noise.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Kernel {
    /// σ where the noise is usual, `(N)`, mm.
    pub sigma: Vec<f64>,
    /// Multiple of the noise that it is where that is less; `None`: never.
    pub per_noise: Option<f64>,
    /// σ of a joint without a setting of its own, mm.
    pub usual: f64,
    /// Share of its square per noise that it has at least: none while wrong detections pass for
    /// noise.
    pub least: f64,
}

impl Kernel {
    /// Those of `n` joints.
    pub(super) fn of(refiner: &Refiner, n: usize) -> Self {
        let per_noise = match &refiner.config().method {
            Method::Annealed(own) => own.sigma_per_noise,
            Method::Paper(_) => None,
        };
        let usual = refiner.config().sigma_mm();
        Self { sigma: refiner.sigmas(n), per_noise, usual, least: 0.0 }
    }

    /// σ² of joint `j` for noise of this variance, mm².
    #[inline]
    fn square(&self, j: usize, variance: f64) -> f64 {
        let share = self.per_noise.map_or(1.0, |per_noise| {
            let square = per_noise * per_noise * variance / (self.usual * self.usual);
            square.min(1.0).max(self.least * square)
        });
        self.sigma[j] * self.sigma[j] * share
    }

    /// σ of every joint for noise of this standard deviation, mm.
    pub(super) fn of_noise(&self, noise: f64) -> Vec<f64> {
        (0..self.sigma.len()).map(|j| self.square(j, noise * noise).sqrt()).collect()
    }
}

/// The detections' noise: a scale for each joint and view.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DetectionNoise {
    /// Mean confidence of every view's detections `(M)`.
    pub confidence: Vec<f64>,
    /// Variance of a detection of this confidence `(N, M)`, mm².
    pub variance: Vec<f64>,
    /// Share of wrong detections ε; 0 before a recording shows it.
    pub wrong: f64,
    /// The final kernels.
    pub kernel: Kernel,
}

impl DetectionNoise {
    /// The same for all joints (of the `kernel`) and views, mm².
    pub fn uniform(confidence: Vec<f64>, variance: f64, kernel: Kernel) -> Self {
        let cells = kernel.sigma.len() * confidence.len();
        Self { confidence, variance: vec![variance; cells], wrong: 0.0, kernel }
    }

    /// That of every joint, mm²: the inverse of the views' mean precision.
    pub fn of_joints(&self) -> Vec<f64> {
        let m = self.confidence.len();
        let mean = |views: &[f64]| m as f64 / views.iter().map(|v| 1.0 / v).sum::<f64>();
        self.variance.chunks(m).map(mean).collect()
    }

    /// Standard deviation of every view, mm: the median over the joints.
    pub(super) fn of_views(&self) -> Vec<f64> {
        let m = self.confidence.len();
        let of_view = |i: usize| median(self.variance.iter().skip(i).step_by(m).copied()).sqrt();
        (0..m).map(of_view).collect()
    }

    /// The final kernel of every joint, mm.
    pub fn kernels(&self) -> Vec<f64> {
        let of_joint = |(j, variance): (usize, &f64)| self.kernel.square(j, *variance).sqrt();
        self.of_joints().iter().enumerate().map(of_joint).collect()
    }

    /// Precision and 1/4σ² of a detection of this confidence, whose variance is `factor` times
    /// the usual one.
    #[inline]
    pub(super) fn of(&self, j: usize, i: usize, confidence: f64, factor: f64) -> [f64; 2] {
        let variance = self.variance[j * self.confidence.len() + i] * factor;
        [confidence / (self.confidence[i] * variance), 0.25 / self.kernel.square(j, variance)]
    }
}

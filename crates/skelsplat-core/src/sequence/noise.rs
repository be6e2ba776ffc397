//! The detections' noise in a recording as it is used: a variance for each joint and view, and the
//! kernels that follow it; [`super::scales`] learns it.

use super::serialise::Serialiser;
pub use crate::kernel::Kernel;

/// Share of wrong detections before a recording shows it.
const WRONG: f64 = 0.1;

/// The detections' noise: a scale for each joint and view.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DetectionNoise {
    /// Mean confidence of every view's detections `(M)`.
    pub confidence: Vec<f64>,
    /// Variance of a detection of this confidence `(N, M)`, mm².
    pub variance: Vec<f64>,
    /// Share of wrong detections ε.
    pub wrong: f64,
    /// The final kernels.
    pub kernel: Kernel,
}

impl DetectionNoise {
    /// The same for all joints (of the `kernel`) and views, mm².
    pub fn uniform(confidence: Vec<f64>, variance: f64, kernel: Kernel) -> Self {
        let cells = kernel.sigma.len() * confidence.len();
        Self { confidence, variance: vec![variance; cells], wrong: WRONG, kernel }
    }

    /// That of joint `j`, mm²: the inverse of the views' mean precision.
    pub fn of_joint(&self, j: usize) -> f64 {
        let m = self.confidence.len();
        let views = &self.variance[j * m..(j + 1) * m];
        m as f64 / views.iter().map(|v| 1.0 / v).sum::<f64>()
    }

    /// That of every joint.
    pub fn of_joints(&self) -> Vec<f64> {
        (0..self.kernel.sigma.len()).map(|j| self.of_joint(j)).collect()
    }

    /// The final kernel of every joint, mm.
    pub fn kernels(&self) -> Vec<f64> {
        let of_joint = |j: usize| self.kernel.square(j, self.of_joint(j)).sqrt();
        (0..self.kernel.sigma.len()).map(of_joint).collect()
    }

    pub(super) fn serialise(&mut self, serialiser: &mut Serialiser) {
        for list in [&mut self.confidence, &mut self.variance, &mut self.kernel.sigma] {
            serialiser.list(list, 0.0, |v, serialiser| serialiser.number(v));
        }
        serialiser.number(&mut self.wrong);
        serialiser.number(&mut self.kernel.usual);
        let mut per_noise = self.kernel.per_noise.unwrap_or(f64::NAN);
        serialiser.number(&mut per_noise);
        self.kernel.per_noise = Some(per_noise).filter(|k| k.is_finite());
    }

    /// The least of any joint and view.
    pub fn least(&self) -> f64 {
        self.variance.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// Precision and 1/4σ² of a detection of this confidence, whose variance is `factor` times
    /// the usual one.
    #[inline]
    pub(super) fn of(&self, j: usize, i: usize, confidence: f64, factor: f64) -> [f64; 2] {
        let variance = self.variance[j * self.confidence.len() + i] * factor;
        [confidence / (self.confidence[i] * variance), 0.25 / self.kernel.square(j, variance)]
    }
}

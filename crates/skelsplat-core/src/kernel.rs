//! How wide the kernels of detections end: they follow the noise.

/// Share of the kernel's square per noise that it has at least, however large the noise is.
const WIDER: f64 = 0.6;

/// The final kernel of a joint by its noise.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Kernel {
    /// σ where the noise is usual, `(N)`, mm.
    pub sigma: Vec<f64>,
    /// Multiple of the noise that it is where that is less; `None`: never.
    pub per_noise: Option<f64>,
    /// σ of a joint without a setting of its own, mm.
    pub usual: f64,
}

impl Kernel {
    /// σ² of joint `j` for noise of this variance, mm².
    #[inline]
    pub fn square(&self, j: usize, variance: f64) -> f64 {
        let share = self.per_noise.map_or(1.0, |per_noise| {
            let square = variance / (self.usual * self.usual);
            (per_noise * per_noise * square).min(1.0).max(WIDER * per_noise * per_noise * square)
        });
        self.sigma[j] * self.sigma[j] * share
    }

    /// σ of every joint for noise of this standard deviation, mm.
    pub fn of(&self, noise: f64) -> Vec<f64> {
        (0..self.sigma.len()).map(|j| self.square(j, noise * noise).sqrt()).collect()
    }
}

//! Adam (Kingma & Ba 2015) with one learning rate per parameter group: position, log-scale,
//! rotation.

use crate::gaussian::{Gaussian, GaussianGradient};

/// Parameters of one Gaussian: mean, log-scales, quaternion.
const PARAMETERS: usize = 10;

/// Learning rates of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LearningRates {
    /// Of the mean, mm per step.
    pub position: f64,
    /// Of the log-scales.
    pub log_scale: f64,
    /// Of the quaternion.
    pub rotation: f64,
}

/// First and second moment estimates of every parameter.
#[derive(Debug, Clone)]
pub struct Adam {
    betas: [f64; 2],
    epsilon: f64,
    step: i32,
    moments: Vec<[[f64; 2]; PARAMETERS]>,
}

fn flat(g: &GaussianGradient) -> [f64; PARAMETERS] {
    let (m, s, q) = (&g.mean, &g.log_scales, &g.quaternion);
    [m.x, m.y, m.z, s.x, s.y, s.z, q[0], q[1], q[2], q[3]]
}

impl Adam {
    /// The initial state for `n` Gaussians.
    pub fn new(n: usize, betas: [f64; 2], epsilon: f64) -> Self {
        Self { betas, epsilon, step: 0, moments: vec![[[0.0; 2]; PARAMETERS]; n] }
    }

    /// Moves every parameter by −lr · m̂ / (√v̂ + ε), with m̂ and v̂ the bias-corrected moments. A
    /// parameter whose gradient has always been zero does not move.
    pub fn step(
        &mut self,
        gaussians: &mut [Gaussian],
        gradient: &[GaussianGradient],
        rates: LearningRates,
    ) {
        self.step += 1;
        let correction = self.betas.map(|b| 1.0 - b.powi(self.step));
        for ((g, moments), d) in gaussians.iter_mut().zip(&mut self.moments).zip(gradient) {
            let mut move_ = [0.0; PARAMETERS];
            for ((m, d), out) in moments.iter_mut().zip(flat(d)).zip(&mut move_) {
                m[0] = self.betas[0] * m[0] + (1.0 - self.betas[0]) * d;
                m[1] = self.betas[1] * m[1] + (1.0 - self.betas[1]) * d * d;
                *out = (m[0] / correction[0]) / ((m[1] / correction[1]).sqrt() + self.epsilon);
            }
            for k in 0..3 {
                g.mean[k] -= rates.position * move_[k];
                g.log_scales[k] -= rates.log_scale * move_[3 + k];
            }
            for k in 0..4 {
                g.quaternion[k] -= rates.rotation * move_[6 + k];
            }
        }
    }
}

//! Schedules over the steps: the position learning rate and the views of each step.

/// lr(t) = lr₀ · decay^(t / steps), t counted from 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExponentialDecay {
    /// lr₀.
    pub initial: f64,
    /// Factor reached after `steps` steps.
    pub decay: f64,
    /// Number of steps for that factor.
    pub steps: f64,
}

impl ExponentialDecay {
    /// Learning rate of step `t`.
    pub fn at(&self, t: usize) -> f64 {
        #[allow(clippy::cast_precision_loss, reason = "step counts are far below 2^52")]
        let t = t as f64;
        self.initial * self.decay.powf(t / self.steps)
    }
}

/// Marks the `per_step` views of step `t` in `active`, taken in turn: (t·per_step + k) mod M.
pub fn views_in_turn(t: usize, per_step: usize, active: &mut [bool]) {
    active.fill(false);
    let n = active.len();
    for k in 0..per_step.min(n) {
        active[(t * per_step + k) % n] = true;
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decay_reaches_its_factor() {
        let lr = ExponentialDecay { initial: 3.0, decay: 0.01, steps: 1000.0 };
        assert!((lr.at(0) - 3.0).abs() < 1e-15);
        assert!((lr.at(1000) - 0.03).abs() < 1e-15);
        assert!((lr.at(500) - 0.3).abs() < 1e-14);
    }

    #[test]
    fn views_take_turns() {
        let mut active = [false; 3];
        let seen: Vec<_> = (0..3)
            .map(|t| {
                views_in_turn(t, 2, &mut active);
                active
            })
            .collect();
        assert_eq!(seen, [[true, true, false], [true, false, true], [false, true, true]]);
    }
}

//! Schedules over the steps: the position learning rate and the views of each step.

/// The learning rate of step `t`, counted from 0: lr(t) = lr₀ · decay^(t / steps), which reaches
/// the factor `decay` after so many `steps`.
pub fn decayed(initial: f64, decay: f64, steps: f64, t: usize) -> f64 {
    initial * decay.powf(t as f64 / steps)
}

/// Marks the `per_step` views of step `t` in `active`, taken in turn: (t·per_step + k) mod M.
pub fn views_in_turn(t: usize, per_step: usize, active: &mut [bool]) {
    active.fill(false);
    let n = active.len();
    for k in 0..per_step.min(n) {
        active[(t * per_step + k) % n] = true;
    }
}

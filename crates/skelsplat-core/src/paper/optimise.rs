//! The paper's optimisation: Adam on the rendering loss, gradients accumulated over views, and
//! early stopping on window minima (paper §3 "Optimization").

use std::sync::atomic::AtomicBool;

use super::adam::{Adam, LearningRates};
use super::objective::Objective;
use super::rows::Pixel;
use super::settings::PaperSettings;
use crate::error::{Result, unless_cancelled};
use crate::gaussian::Gaussian;
use crate::outcome::{Loss, StopReason};

/// The outcome of an optimisation.
#[derive(Debug, Clone, PartialEq)]
pub struct Optimised {
    /// Steps taken.
    pub n_iter: usize,
    /// Why the optimisation ended.
    pub stop_reason: StopReason,
    /// Loss of every step, if requested.
    pub history: Vec<Loss>,
}

/// Moves `gaussians` to a minimum of `objective` over `n_views` views; `position_lr` in mm per
/// step.
/// Errors: [`crate::Error::Cancelled`] once `cancel`, the flag of the objective, is set.
pub fn optimise<P: Pixel>(
    gaussians: &mut [Gaussian],
    objective: &mut Objective<'_, P>,
    settings: &PaperSettings,
    position_lr: f64,
    cancel: &AtomicBool,
) -> Result<Optimised> {
    let n_views = objective.n_views();
    let per_step = settings.views_per_step.unwrap_or(n_views);
    let mut adam = Adam::new(gaussians.len(), settings.adam_betas, settings.adam_epsilon);
    let window = settings.stop_window.unwrap_or(n_views);
    let mut stopping = WindowMinimum::new(window, settings.stop_tolerance);
    let mut active = vec![true; n_views];
    let mut last = gaussians.to_vec();
    let mut run = Optimised { n_iter: 0, stop_reason: StopReason::MaxSteps, history: Vec::new() };

    for step in 0..settings.max_steps {
        views_in_turn(step, per_step, &mut active);
        let loss = objective.evaluate(gaussians, &active);
        unless_cancelled(cancel)?;
        let mut diverged = !loss.total.is_finite();
        if !diverged {
            last.copy_from_slice(gaussians);
            adam.step(gaussians, objective.gradient(), rates(settings, position_lr, step));
            diverged = !stayed_finite(gaussians, &last);
        }
        if diverged {
            gaussians.copy_from_slice(&last);
            run.stop_reason = StopReason::Diverged;
            break;
        }
        run.n_iter = step + 1;
        if settings.loss_history {
            run.history.push(loss);
        }
        if stopping.settled(loss.total) {
            run.stop_reason = StopReason::Converged;
            break;
        }
    }
    Ok(run)
}

/// Whether every Gaussian that was finite before a step is finite after it.
fn stayed_finite(now: &[Gaussian], before: &[Gaussian]) -> bool {
    now.iter().zip(before).all(|(now, before)| before.is_finite() <= now.is_finite())
}

fn rates(settings: &PaperSettings, initial: f64, step: usize) -> LearningRates {
    let position = decayed(initial, settings.lr_decay, settings.lr_decay_steps, step);
    LearningRates { position, log_scale: settings.log_scale_lr, rotation: settings.rotation_lr }
}

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

/// Stops when the minimum loss of one window of steps differs by less than `tolerance` from that of
/// the previous window.
#[derive(Debug, Clone)]
pub struct WindowMinimum {
    window: usize,
    tolerance: f64,
    count: usize,
    current: f64,
    previous: Option<f64>,
}

impl WindowMinimum {
    /// Windows of `window` ≥ 1 steps.
    pub fn new(window: usize, tolerance: f64) -> Self {
        Self { window: window.max(1), tolerance, count: 0, current: f64::INFINITY, previous: None }
    }

    /// Records the loss of one step; returns whether the optimisation has converged.
    pub fn settled(&mut self, loss: f64) -> bool {
        self.current = self.current.min(loss);
        self.count += 1;
        if self.count < self.window {
            return false;
        }
        let settled = self.previous.is_some_and(|p| (p - self.current).abs() < self.tolerance);
        self.previous = Some(self.current);
        (self.count, self.current) = (0, f64::INFINITY);
        settled
    }
}

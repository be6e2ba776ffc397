//! What a method hands to the front door for one frame, in mm. Not converging and not being seen are outcomes.

use nalgebra::{Matrix3, Vector3};

/// Why the optimisation ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum StopReason {
    /// The window minimum of the loss settled, or the steps became small.
    Converged,
    /// The step limit came first.
    MaxSteps,
    /// No joint has a usable detection: nothing was optimised.
    NoObservations,
    /// The loss or a parameter stopped being finite; the last finite state is returned.
    Diverged,
}

impl StopReason {
    /// The name used in Python and in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Converged => "converged",
            Self::MaxSteps => "max_steps",
            Self::NoObservations => "no_observations",
            Self::Diverged => "diverged",
        }
    }
}

/// How far a joint's position can be relied on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointStatus {
    /// Its splat meets its detection in two views or more, which fix its place.
    Ok,
    /// Detected, but not determined: its splat meets its detection in fewer than two views, or these are too close together
    /// to fix the depth, or as many views agree on another place.
    Weak,
    /// No usable detection: the joint keeps its initial position, NaN if it has none.
    Unobserved,
}

impl JointStatus {
    /// The name used in Python and in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Weak => "weak",
            Self::Unobserved => "unobserved",
        }
    }
}

/// The loss and its terms.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Loss {
    /// L_render + λ_sym L_sym.
    pub total: f64,
    /// L_render.
    pub render: f64,
    /// L_sym, mm², without its weight.
    pub symmetry: f64,
}

/// The joints' splats.
#[derive(Debug, Clone, PartialEq)]
pub enum Splats {
    /// Standard deviations `(N)` of round ones, mm.
    Round(Vec<f64>),
    /// Covariances `(N)`, mm².
    Free(Vec<Matrix3<f64>>),
}

/// A pose that a method has found.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Joint positions `(N)`; NaN where nothing is known.
    pub points: Vec<Vector3<f64>>,
    /// The splats at the end.
    pub splats: Splats,
    /// Where it began `(N)`.
    pub init: Vec<Vector3<f64>>,
    /// How far each joint can be relied on `(N)`.
    pub status: Vec<JointStatus>,
    /// For every detection `(M, N)` the joint that it was used for.
    pub used_for: Vec<usize>,
    /// Loss of the pose over all views.
    pub loss: Loss,
    /// Loss of every step, if asked for.
    pub loss_history: Vec<Loss>,
    /// Steps taken.
    pub n_iter: usize,
    /// Why it ended.
    pub stop_reason: StopReason,
}

/// What the residuals at a pose say of it.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorBars {
    /// Posterior covariances `(N)`; NaN where nothing is known.
    pub covariances: Vec<Matrix3<f64>>,
    /// k of every ray `(N, M)`, how far it is believed; NaN where there is none.
    pub believed: Vec<f64>,
    /// Standard deviation of the detections' noise across the ray; NaN without any detection.
    pub noise: f64,
    /// Status of every joint by these residuals `(N)`.
    pub status: Vec<JointStatus>,
}

/// Every detection `(M, N)` used for the joint that it is given as.
#[must_use]
pub fn as_given(n_views: usize, n_joints: usize) -> Vec<usize> {
    (0..n_views * n_joints).map(|k| k % n_joints).collect()
}

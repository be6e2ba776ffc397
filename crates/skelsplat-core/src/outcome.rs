//! The result of a method for one frame, in mm. Lack of convergence and unobserved joints are
//! outcomes, not errors.

use nalgebra::{Matrix3, Vector3};

use crate::names::named;

/// Why the iteration ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum StopReason {
    /// The window minimum of the loss stopped changing, or the steps became small.
    Converged,
    /// The step limit was reached.
    MaxSteps,
    /// No joint has a usable detection: nothing was optimised.
    NoObservations,
    /// The loss or a parameter is no longer finite; the last finite state is returned.
    Diverged,
}

named!(StopReason {
    Converged: "converged",
    MaxSteps: "max_steps",
    NoObservations: "no_observations",
    Diverged: "diverged",
});

/// Reliability of a joint's position.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointStatus {
    /// Its splat matches its detection in at least two views, which determine its position.
    Ok,
    /// Detected but not determined: its splat matches its detection in fewer than two views, the
    /// views are too close together to determine the depth, or equally many views agree on another
    /// position.
    Weak,
    /// No usable detection: the joint keeps its initial position, NaN if it has none.
    Unobserved,
    /// Determined by its bones or by the frames around it, not by two views of this frame.
    Inferred,
}

named!(JointStatus { Ok: "ok", Weak: "weak", Unobserved: "unobserved", Inferred: "inferred" });

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

/// The pose found by a method.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Joint positions `(N)`; NaN where unobserved.
    pub points: Vec<Vector3<f64>>,
    /// The splats at the end.
    pub splats: Splats,
    /// Initial pose `(N)`.
    pub init: Vec<Vector3<f64>>,
    /// The joint for which each detection `(M, N)` was used.
    pub used_for: Vec<usize>,
    /// Loss of the pose over all views.
    pub loss: Loss,
    /// Loss of every step, if requested.
    pub loss_history: Vec<Loss>,
    /// Steps taken.
    pub n_iter: usize,
    /// Why the iteration ended.
    pub stop_reason: StopReason,
}

/// Error bars and weights, from the residuals at a pose.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorBars {
    /// Posterior covariances `(N)`; NaN where unobserved.
    pub covariances: Vec<Matrix3<f64>>,
    /// Weight k of every ray `(N, M)`: how much it is trusted; NaN where missing.
    pub believed: Vec<f64>,
    /// Standard deviation of the detection noise across the ray; NaN without detections.
    pub noise: f64,
    /// Reliability of each joint `(N)`.
    pub status: Vec<JointStatus>,
}

/// The identity: every detection `(M, N)` used for its own joint.
pub fn as_given(n_views: usize, n_joints: usize) -> Vec<usize> {
    (0..n_views * n_joints).map(|k| k % n_joints).collect()
}

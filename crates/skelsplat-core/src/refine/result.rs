//! What comes out of a refinement. Not converging and not being seen are outcomes.

use nalgebra::{Matrix3, Vector3};

use super::objective::Loss;

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

/// A refined pose, in the unit of the cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct Refinement {
    /// Joint positions `(N)`; NaN where nothing is known.
    pub pose: Vec<Vector3<f64>>,
    /// Splat covariances Σ `(N)`, unit²; not an error bar.
    pub covariance: Vec<Matrix3<f64>>,
    /// Posterior covariance of the position `(N)`, unit²: the error bar. NaN where nothing is known.
    pub uncertainty: Vec<Matrix3<f64>>,
    /// k of every detection `(M, N)`, how far it is believed; NaN where there is none.
    pub view_weights: Vec<f64>,
    /// Detections `(M, N)` that were used with left and right exchanged.
    pub swapped: Vec<bool>,
    /// ŝ, standard deviation of the detections' noise across the ray, in the unit of the cameras.
    pub noise: f64,
    /// The initial pose that was used `(N)`.
    pub init_pose: Vec<Vector3<f64>>,
    /// Distance between detection and reprojection `(M, N)`, pixels of the original image; NaN where
    /// there is no detection or no reprojection.
    pub reprojection_error: Vec<f64>,
    /// How far each joint can be relied on `(N)`.
    pub joint_status: Vec<JointStatus>,
    /// Loss of the returned pose over all views.
    pub loss: Loss,
    /// Loss of every step, if asked for.
    pub loss_history: Vec<Loss>,
    /// Steps taken.
    pub n_iter: usize,
    /// Why it ended.
    pub stop_reason: StopReason,
}

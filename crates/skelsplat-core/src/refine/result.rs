//! The result of a refinement, in the unit of the cameras.

use std::iter::zip;
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use crate::outcome::{ErrorBars, JointStatus, Loss, Outcome, Splats, StopReason};

/// A refined pose, in the unit of the cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct Refinement {
    /// Joint positions `(N)`; NaN where unobserved.
    pub pose: Vec<Vector3<f64>>,
    /// Splat covariances Σ `(N)`, unit²; not an error bar.
    pub covariance: Vec<Matrix3<f64>>,
    /// Posterior covariance of the position `(N)`, unit²: the scatter, what another recording of
    /// the same pose by the same detector would give. NaN where unobserved.
    pub uncertainty: Vec<Matrix3<f64>>,
    /// Standard deviation per axis of the detector's joints `(N)` from anatomical ones, the same in
    /// all views and frames.
    pub joint_bias: Arc<[f64]>,
    /// Weight k of every detection `(M, N)`: how much it is trusted; NaN where missing.
    pub view_weights: Vec<f64>,
    /// Detections `(M, N)` that were used with left and right swapped.
    pub swapped: Vec<bool>,
    /// ŝ, standard deviation of the detection noise across the ray, in the unit of the cameras; NaN
    /// without detections.
    pub noise: f64,
    /// The initial pose that was used `(N)`.
    pub init_pose: Vec<Vector3<f64>>,
    /// Distance between detection and reprojection `(M, N)`, pixels of the original image; NaN
    /// where there is no detection or no reprojection.
    pub reprojection_error: Vec<f64>,
    /// Reliability of each joint `(N)`.
    pub joint_status: Vec<JointStatus>,
    /// Loss of the returned pose over all views.
    pub loss: Loss,
    /// Loss of every step, if requested.
    pub loss_history: Vec<Loss>,
    /// Steps taken.
    pub n_iter: usize,
    /// Why the iteration ended.
    pub stop_reason: StopReason,
}

impl Refinement {
    /// Covariance of the distance from an anatomical joint `(N)`, unit²: `uncertainty` +
    /// `joint_bias`² I. NaN where unobserved.
    pub fn error_bar(&self) -> Vec<Matrix3<f64>> {
        let bar = |(scatter, bias): (&Matrix3<f64>, &f64)| {
            scatter + Matrix3::from_diagonal_element(bias * bias)
        };
        zip(&self.uncertainty, self.joint_bias.iter()).map(bar).collect()
    }

    /// `outcome` and `bars`, of which `mm` are a unit of the cameras, converted to this unit, which
    /// `joint_bias` already has.
    pub(super) fn new(
        outcome: Outcome,
        bars: &ErrorBars,
        reprojection_error: Vec<f64>,
        joint_bias: Arc<[f64]>,
        mm: f64,
    ) -> Self {
        let n = outcome.points.len();
        let m = outcome.used_for.len() / n.max(1);
        let round = |(x, sigma): (&Vector3<f64>, &f64)| {
            let variance = if x.x.is_nan() { f64::NAN } else { (sigma / mm).powi(2) };
            Matrix3::from_diagonal_element(variance)
        };
        let covariance = match &outcome.splats {
            Splats::Round(sigmas) => outcome.points.iter().zip(sigmas).map(round).collect(),
            Splats::Free(covariances) => covariances.iter().map(|c| c / (mm * mm)).collect(),
        };
        let used_for = || outcome.used_for.iter().enumerate();
        Self {
            pose: outcome.points.iter().map(|p| p / mm).collect(),
            covariance,
            uncertainty: bars.covariances.iter().map(|c| c / (mm * mm)).collect(),
            joint_bias,
            view_weights: used_for().map(|(k, j)| bars.believed[j * m + k / n]).collect(),
            swapped: used_for().map(|(k, j)| *j != k % n).collect(),
            noise: bars.noise / mm,
            init_pose: outcome.init.iter().map(|p| p / mm).collect(),
            reprojection_error,
            joint_status: bars.status.clone(),
            loss: outcome.loss,
            loss_history: outcome.loss_history,
            n_iter: outcome.n_iter,
            stop_reason: outcome.stop_reason,
        }
    }
}

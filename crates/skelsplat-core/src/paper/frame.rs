//! The published method for one frame: Gaussians start at the initial pose and are optimised by
//! Adam.

use std::sync::atomic::AtomicBool;

use nalgebra::{Matrix3, Vector3};

use super::objective::Objective;
use super::optimise::{Optimised, optimise};
use super::rows::Pixel;
use super::settings::{PaperSettings, PositionLearningRate};
use crate::camera::Camera;
use crate::detections::Detections;
use crate::error::{Result, unless_cancelled};
use crate::gaussian::{Gaussian, GaussianGradient};
use crate::outcome::{JointStatus, Loss, Outcome, Splats, StopReason, as_given};
use crate::projection::View;
use crate::symmetry::LimbPair;
use crate::triangulate::dlt;

/// Mean and covariance per joint `(N)`, the shapes of the pseudo ground truth.
pub type Shapes = Vec<(Vector3<f64>, Matrix3<f64>)>;

/// One frame, in mm.
#[derive(Debug, Clone, Copy)]
pub struct PaperFrame<'a> {
    /// The cameras at full resolution.
    pub cameras: &'a [Camera],
    /// The cameras at the rendering resolution.
    pub views: &'a [View],
    /// Detections as ideal pixels of the full resolution.
    pub detections: &'a Detections,
    /// Limbs of equal length.
    pub pairs: &'a [LimbPair],
    /// The settings.
    pub settings: &'a PaperSettings,
    /// Whether to distribute the windows of the pose over the threads of the caller's pool.
    pub parallel: bool,
    /// Once set, the work ends.
    pub cancel: &'a AtomicBool,
}

/// The loss of a skeleton and its gradient `(N)`.
#[derive(Debug, Clone, PartialEq)]
pub struct LossAndGradient {
    /// Loss over all views.
    pub loss: Loss,
    /// Gradient with respect to the parameters of every Gaussian.
    pub gradient: Vec<GaussianGradient>,
}

impl PaperFrame<'_> {
    /// The pose of the frame, starting from the known joints of `init`, with splats of standard
    /// deviation `sigmas` `(N)`, and the status of every joint. Errors:
    /// [`crate::Error::OutOfMemory`] if the windows are too large, [`crate::Error::Cancelled`] once
    /// `cancel` is set.
    pub fn solve(
        &self,
        init: Option<&[Option<Vector3<f64>>]>,
        sigmas: &[f64],
    ) -> Result<(Outcome, Vec<JointStatus>)> {
        let init = self.initial_pose(init);
        let round = |(mean, sigma): (&Vector3<f64>, &f64)| Gaussian::isotropic(*mean, *sigma);
        let mut gaussians: Vec<Gaussian> = init.iter().zip(sigmas).map(round).collect();
        let shapes = gaussians.iter().map(|g| (g.mean, g.covariance())).collect();
        let mut objective = self.objective::<f32>(&shapes)?;
        let observed = (0..gaussians.len()).any(|j| objective.usable_views(j) > 0);
        let run = if observed {
            let position_lr = position_lr(self.settings, self.cameras);
            optimise(&mut gaussians, &mut objective, self.settings, position_lr, self.cancel)?
        } else {
            Optimised { n_iter: 0, stop_reason: StopReason::NoObservations, history: Vec::new() }
        };
        let loss = objective.evaluate(&gaussians, &vec![true; self.views.len()]);
        unless_cancelled(self.cancel)?;
        let covariance = |g: &Gaussian| {
            if g.mean.x.is_nan() { Matrix3::repeat(f64::NAN) } else { g.covariance() }
        };
        let status = (0..gaussians.len()).map(|j| status(&objective, j)).collect();
        let outcome = Outcome {
            points: gaussians.iter().map(|g| g.mean).collect(),
            splats: Splats::Free(gaussians.iter().map(covariance).collect()),
            init,
            used_for: as_given(self.detections.n_views(), self.detections.n_joints()),
            loss,
            loss_history: run.history,
            n_iter: run.n_iter,
            stop_reason: run.stop_reason,
        };
        Ok((outcome, status))
    }

    /// Loss over all views and its gradient for any Gaussians `(N)`, in doubles; `shapes` determine
    /// the pseudo ground truth.
    pub fn loss_and_gradient(
        &self,
        gaussians: &[Gaussian],
        shapes: &Shapes,
    ) -> Result<LossAndGradient> {
        let mut objective = self.objective::<f64>(shapes)?;
        let loss = objective.evaluate(gaussians, &vec![true; self.views.len()]);
        unless_cancelled(self.cancel)?;
        Ok(LossAndGradient { loss, gradient: objective.gradient().to_vec() })
    }

    /// The initial pose; missing joints are triangulated.
    fn initial_pose(&self, init: Option<&[Option<Vector3<f64>>]>) -> Vec<Vector3<f64>> {
        match init {
            Some(pose) if pose.iter().all(Option::is_some) => {
                pose.iter().copied().flatten().collect()
            }
            Some(pose) => {
                let fill = dlt(self.detections, self.cameras);
                pose.iter().zip(fill).map(|(p, f)| p.unwrap_or(f)).collect()
            }
            None => dlt(self.detections, self.cameras),
        }
    }

    fn objective<P: Pixel>(&self, shapes: &Shapes) -> Result<Objective<'_, P>> {
        // Pixels of the rendering resolution: u' = (u + ½) s − ½.
        let s = self.settings.resolution;
        let detections = self.detections.map(|_, p| Some(p.map(|u| (u + 0.5) * s - 0.5)));
        let Self { views, settings, pairs, parallel, cancel, .. } = *self;
        let objective = Objective::new(views, &detections, shapes, settings, parallel, cancel)?;
        Ok(objective.with_symmetry(pairs.iter().copied(), settings.symmetry_weight))
    }
}

fn status(objective: &Objective<'_, f32>, joint: usize) -> JointStatus {
    match (objective.usable_views(joint), objective.meeting_views(joint)) {
        (0, _) => JointStatus::Unobserved,
        (_, 0 | 1) => JointStatus::Weak,
        _ => JointStatus::Ok,
    }
}

fn position_lr(settings: &PaperSettings, cameras: &[Camera]) -> f64 {
    let rate = match settings.position_lr_mm {
        PositionLearningRate::Millimetres(mm) => mm,
        PositionLearningRate::CameraExtent => {
            let sum: Vector3<f64> = cameras.iter().map(Camera::centre).sum();
            let mean = sum / cameras.len() as f64;
            let reach = cameras.iter().map(|c| (c.centre() - mean).norm()).fold(0.0, f64::max);
            5e-4 * 1.1 * reach
        }
    };
    rate * settings.position_lr_factor
}

//! The paper's method for one frame: Gaussians at the initial pose, moved by Adam.

use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::{Matrix3, Vector3};

use super::config::{PositionLearningRate, RefineConfig};
use super::objective::{Loss, Objective, Targets};
use super::paper::{self, Run};
use super::refiner::{Frame, Refiner, Shapes};
use super::result::{JointStatus, Refinement, StopReason};
use crate::camera::Camera;
use crate::detections::Detections;
use crate::error::{Error, Result};
use crate::gaussian::{Gaussian, GaussianGradient};
use crate::raster::rows::Pixel;
use crate::threads;
use crate::triangulate::dlt;

/// Share of the largest camera distance that the released formula takes as learning rate.
const EXTENT_LR: f64 = 5e-4 * 1.1;

impl Refiner {
    /// The initial pose in mm; joints that have none are triangulated from `used`.
    fn initial_pose(&self, frame: &Frame, used: &Detections) -> Vec<Vector3<f64>> {
        let scale = self.unit.millimetres();
        let finite = |p: &Vector3<f64>| p.iter().all(|v| v.is_finite());
        match &frame.init_pose {
            Some(pose) if pose.iter().all(finite) => pose.iter().map(|p| p * scale).collect(),
            Some(pose) => {
                let fill = dlt(used, &self.cameras);
                let given =
                    |(p, f): (&Vector3<f64>, Vector3<f64>)| if finite(p) { p * scale } else { f };
                pose.iter().zip(fill).map(given).collect()
            }
            None => dlt(used, &self.cameras),
        }
    }

    /// With `parallel` in the pool of threads that the caller is in, else in that of the process: never in rayon's
    /// global one, which does not survive a fork.
    pub(super) fn refine_adam(
        &self,
        frame: &Frame,
        parallel: bool,
        cancel: &AtomicBool,
    ) -> Result<Refinement> {
        if parallel && rayon::current_thread_index().is_none() {
            return threads::install(None, |parallel| self.adam(frame, parallel, cancel));
        }
        self.adam(frame, parallel, cancel)
    }

    fn adam(&self, frame: &Frame, parallel: bool, cancel: &AtomicBool) -> Result<Refinement> {
        let used = self.usable(&frame.detections);
        let init = self.initial_pose(frame, &used);
        let mut gaussians: Vec<Gaussian> = init
            .iter()
            .enumerate()
            .map(|(j, mean)| Gaussian::isotropic(*mean, self.sigma(j)))
            .collect();
        let shapes = gaussians.iter().map(|g| (g.mean, g.covariance())).collect();
        let detections = self.at_resolution(&used);
        let mut objective = self.objective::<f32>(&detections, &shapes, parallel, cancel)?;
        let observed = (0..gaussians.len()).any(|j| objective.usable_views(j) > 0);
        let run = if observed {
            paper::optimise(&mut gaussians, &mut objective, &self.config, self.position_lr, cancel)?
        } else {
            Run { n_iter: 0, stop_reason: StopReason::NoObservations, history: Vec::new() }
        };
        let loss = objective.evaluate(&gaussians, &vec![true; self.views.len()]);
        if cancel.load(Ordering::Relaxed) {
            return Err(Error::Cancelled);
        }
        let status = (0..gaussians.len()).map(|j| status(&objective, j)).collect();
        Ok(self.adam_result(frame, (&used, &init, &gaussians), (loss, run), status))
    }

    /// Loss over all views and its gradient for any Gaussians `(N)`, in doubles, for study and tests.
    ///
    /// Means and log-scales (ln σ) are in the unit of the cameras, as is the gradient. The pseudo ground
    /// truth is shaped by the `targets` (mean and covariance per joint; `None`: the Gaussians themselves).
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if views or joints do not match, [`Error::OutOfMemory`] if the splats' windows are too
    /// large, [`Error::Cancelled`] once `cancel` is set.
    pub fn loss_and_gradient(
        &self,
        gaussians: &[Gaussian],
        detections: &Detections,
        targets: Option<Shapes>,
        cancel: &AtomicBool,
    ) -> Result<(Loss, Vec<GaussianGradient>)> {
        let means = gaussians.iter().map(|g| g.mean).collect();
        self.check(&Frame {
            detections: detections.clone(),
            init_pose: Some(means),
            init_covariance: None,
            past: false,
        })?;
        let mm = self.unit.millimetres();
        let in_mm = |g: &Gaussian| Gaussian {
            mean: g.mean * mm,
            log_scales: g.log_scales.add_scalar(mm.ln()),
            quaternion: g.quaternion,
        };
        let gaussians: Vec<Gaussian> = gaussians.iter().map(in_mm).collect();
        let shapes = match targets {
            None => gaussians.iter().map(|g| (g.mean, g.covariance())).collect(),
            Some(t) if t.len() == gaussians.len() => {
                t.into_iter().map(|(m, c)| (m * mm, c * (mm * mm))).collect::<Shapes>()
            }
            Some(t) => {
                let expected = format!("{} Gaussians", gaussians.len());
                return Err(Error::invalid("target_means", expected, t.len().to_string()));
            }
        };
        let at_resolution = self.at_resolution(&self.usable(detections));
        let mut objective = self.objective::<f64>(&at_resolution, &shapes, false, cancel)?;
        let loss = objective.evaluate(&gaussians, &vec![true; self.views.len()]);
        if cancel.load(Ordering::Relaxed) {
            return Err(Error::Cancelled);
        }
        let mut gradient = objective.gradient().to_vec();
        gradient.iter_mut().for_each(|g| g.mean *= mm);
        Ok((loss, gradient))
    }

    fn objective<'a, P: Pixel>(
        &'a self,
        detections: &Detections,
        shapes: &Shapes,
        parallel: bool,
        cancel: &'a AtomicBool,
    ) -> Result<Objective<'a, P>> {
        let targets = Targets {
            detections,
            gaussians: shapes,
            dilation: self.config.dilation,
            encoding: self.config.encoding,
            renderer: self.config.renderer,
        };
        let objective = Objective::new(&self.views, &targets, parallel, cancel)?;
        Ok(objective.with_symmetry(self.pairs.iter().copied(), self.config.symmetry_weight))
    }

    /// Pixels of the rendering resolution: u' = (u + ½) s − ½.
    fn at_resolution(&self, detections: &Detections) -> Detections {
        let s = self.config.resolution;
        detections.map(|_, p| Some(p.map(|u| (u + 0.5) * s - 0.5)))
    }

    fn adam_result(
        &self,
        frame: &Frame,
        (used, init, gaussians): (&Detections, &[Vector3<f64>], &[Gaussian]),
        (loss, run): (Loss, Run),
        joint_status: Vec<JointStatus>,
    ) -> Refinement {
        let mm = self.unit.millimetres();
        let covariance = |g: &Gaussian| {
            if g.mean.x.is_nan() { Matrix3::repeat(f64::NAN) } else { g.covariance() / (mm * mm) }
        };
        let points: Vec<Vector3<f64>> = gaussians.iter().map(|g| g.mean).collect();
        let bars = self.error_bars(used, &points);
        let doubted = |(s, bars): (JointStatus, &JointStatus)| match (s, bars) {
            (JointStatus::Ok, JointStatus::Weak) => JointStatus::Weak,
            _ => s,
        };
        let joint_status = joint_status.into_iter().zip(&bars.status).map(doubted).collect();
        Refinement {
            pose: points.iter().map(|p| p / mm).collect(),
            covariance: gaussians.iter().map(covariance).collect(),
            uncertainty: bars.uncertainty,
            swapped: vec![false; bars.view_weights.len()],
            view_weights: bars.view_weights,
            noise: bars.noise,
            init_pose: init.iter().map(|p| p / mm).collect(),
            reprojection_error: self.reprojection_error(&frame.detections, &points, |_, j| j),
            joint_status,
            loss,
            loss_history: run.history,
            n_iter: run.n_iter,
            stop_reason: run.stop_reason,
        }
    }
}

fn status(objective: &Objective<'_, f32>, joint: usize) -> JointStatus {
    match (objective.usable_views(joint), objective.meeting_views(joint)) {
        (0, _) => JointStatus::Unobserved,
        (_, 0 | 1) => JointStatus::Weak,
        _ => JointStatus::Ok,
    }
}

pub(super) fn position_lr(config: &RefineConfig, cameras: &[Camera]) -> f64 {
    let rate = match config.position_lr {
        PositionLearningRate::Millimetres(mm) => mm,
        PositionLearningRate::CameraExtent => {
            let sum: Vector3<f64> = cameras.iter().map(Camera::centre).sum();
            let n = u32::try_from(cameras.len()).unwrap_or(u32::MAX);
            let mean = sum / f64::from(n);
            let reach = cameras.iter().map(|c| (c.centre() - mean).norm()).fold(0.0, f64::max);
            EXTENT_LR * reach
        }
    };
    rate * config.position_lr_factor
}

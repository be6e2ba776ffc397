//! `refine` for one frame: from detections in pixels to a pose in the unit of the cameras.

use std::sync::atomic::AtomicBool;

use nalgebra::{Matrix3, Vector3};

use super::config::{Optimizer, PositionLearningRate, RefineConfig, Renderer};
use super::objective::{Loss, Objective, Targets};
use super::paper::{self, Run};
use super::result::{JointStatus, Refinement, StopReason};
use crate::camera::Camera;
use crate::detections::Detections;
use crate::error::{Error, Result};
use crate::gaussian::{Gaussian, GaussianGradient};
use crate::layout::Layout;
use crate::projection::View;
use crate::raster::rows::Pixel;
use crate::symmetry::LimbPair;
use crate::triangulate::dlt;
use crate::unit::Unit;

/// Share of the largest camera distance that the released formula takes as learning rate.
const EXTENT_LR: f64 = 5e-4 * 1.1;

/// Mean and covariance per joint `(N)`, the shapes of the pseudo ground truth.
pub type Shapes = Vec<(Vector3<f64>, Matrix3<f64>)>;

/// One frame: detections, and an initial pose `(N)` in the unit of the cameras (`None`: triangulated; a NaN
/// joint is triangulated too).
#[derive(Debug, Clone)]
pub struct Frame {
    /// Where each view saw each joint.
    pub detections: Detections,
    /// Where to start.
    pub init_pose: Option<Vec<Vector3<f64>>>,
}

/// Cameras, layout and settings prepared once for any number of frames. Everything inside is in mm.
#[derive(Debug, Clone)]
pub struct Refiner {
    /// At full resolution.
    cameras: Vec<Camera>,
    /// At the rendering resolution.
    views: Vec<View>,
    pairs: Vec<LimbPair>,
    occlusion_prone: Vec<usize>,
    n_joints: Option<usize>,
    position_lr: f64,
    unit: Unit,
    config: RefineConfig,
}

impl Refiner {
    /// Prepares `cameras`, given in `unit`. Without a `layout` there is no symmetry and no occlusion-prone joint.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if there is no camera or a setting lies outside its domain.
    pub fn new(
        cameras: &[Camera],
        unit: Unit,
        layout: Option<&Layout>,
        config: RefineConfig,
    ) -> Result<Self> {
        config.validate()?;
        if cameras.is_empty() {
            return Err(Error::invalid("cameras", "at least one camera", "none"));
        }
        let cameras: Vec<Camera> =
            cameras.iter().map(|c| c.clone().with_length_scale(unit.millimetres())).collect();
        let scaled: Result<Vec<Camera>> =
            cameras.iter().map(|c| c.scaled(config.resolution)).collect();
        let pairs = layout
            .filter(|_| config.symmetry_tier > 0)
            .map(|l| l.symmetric_pairs(config.symmetry_tier).collect());
        Ok(Self {
            views: scaled?.iter().map(View::new).collect(),
            position_lr: position_lr(&config, &cameras),
            pairs: pairs.unwrap_or_default(),
            occlusion_prone: layout.map(|l| l.occlusion_prone.clone()).unwrap_or_default(),
            n_joints: layout.map(|l| l.joints.len()),
            cameras,
            unit,
            config,
        })
    }

    /// The settings.
    #[must_use]
    pub fn config(&self) -> &RefineConfig {
        &self.config
    }

    /// Refines one frame. `parallel` shares the windows of the pose among threads; the result is the same.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if views or joints do not match, [`Error::Cancelled`] once `cancel` is set.
    pub fn refine(&self, frame: &Frame, parallel: bool, cancel: &AtomicBool) -> Result<Refinement> {
        self.check(frame)?;
        match (self.config.renderer, self.config.optimizer) {
            (Renderer::Raster | Renderer::ClosedForm, Optimizer::Adam) => {
                self.refine_paper(frame, parallel, cancel)
            }
        }
    }

    fn refine_paper(
        &self,
        frame: &Frame,
        parallel: bool,
        cancel: &AtomicBool,
    ) -> Result<Refinement> {
        let used = self.usable(&frame.detections);
        let init = self.initial_pose(frame, &used);
        let mut gaussians: Vec<Gaussian> = init
            .iter()
            .enumerate()
            .map(|(j, mean)| Gaussian::isotropic(*mean, self.sigma(j)))
            .collect();
        let shapes = gaussians.iter().map(|g| (g.mean, g.covariance())).collect();
        let mut objective = self.objective::<f32>(&self.at_resolution(&used), &shapes, parallel);
        let observed = (0..gaussians.len()).any(|j| objective.usable_views(j) > 0);
        let run = if observed {
            paper::optimise(&mut gaussians, &mut objective, &self.config, self.position_lr, cancel)?
        } else {
            Run { n_iter: 0, stop_reason: StopReason::NoObservations, history: Vec::new() }
        };
        let loss = objective.evaluate(&gaussians, &vec![true; self.views.len()]);
        let status = (0..gaussians.len()).map(|j| status(&objective, j)).collect();
        Ok(self.refinement(frame, (&init, &gaussians), (loss, run), status))
    }

    /// Loss over all views and its gradient for any Gaussians `(N)`, in doubles, for study and tests.
    ///
    /// Means and log-scales (ln σ) are in the unit of the cameras, as is the gradient. The pseudo ground
    /// truth is shaped by the `targets` (mean and covariance per joint; `None`: the Gaussians themselves).
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if views or joints do not match.
    pub fn loss_and_gradient(
        &self,
        gaussians: &[Gaussian],
        detections: &Detections,
        targets: Option<Shapes>,
    ) -> Result<(Loss, Vec<GaussianGradient>)> {
        let means = gaussians.iter().map(|g| g.mean).collect();
        self.check(&Frame { detections: detections.clone(), init_pose: Some(means) })?;
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
        let mut objective = self.objective::<f64>(&at_resolution, &shapes, false);
        let loss = objective.evaluate(&gaussians, &vec![true; self.views.len()]);
        let mut gradient = objective.gradient().to_vec();
        gradient.iter_mut().for_each(|g| g.mean *= mm);
        Ok((loss, gradient))
    }

    fn objective<P: Pixel>(
        &self,
        detections: &Detections,
        shapes: &Shapes,
        parallel: bool,
    ) -> Objective<'_, P> {
        let targets = Targets {
            detections,
            gaussians: shapes,
            dilation: self.config.dilation,
            encoding: self.config.encoding,
            renderer: self.config.renderer,
        };
        Objective::new(&self.views, &targets, parallel)
            .with_symmetry(self.pairs.iter().copied(), self.config.symmetry_weight)
    }

    fn check(&self, frame: &Frame) -> Result<()> {
        let (m, n) = (frame.detections.n_views(), frame.detections.n_joints());
        if m != self.cameras.len() {
            let expected = format!("one view per camera ({})", self.cameras.len());
            return Err(Error::invalid("detections", expected, format!("{m} views")));
        }
        if let Some(joints) = self.n_joints.filter(|joints| *joints != n) {
            let expected = format!("the layout's {joints} joints");
            return Err(Error::invalid("detections", expected, format!("{n} joints")));
        }
        match &frame.init_pose {
            Some(pose) if pose.len() != n => {
                let expected = format!("{n} joints, as the detections have");
                Err(Error::invalid("init_pose", expected, format!("{} joints", pose.len())))
            }
            _ => Ok(()),
        }
    }

    /// Detections as ideal pixels, without those below the least confidence.
    fn usable(&self, detections: &Detections) -> Detections {
        let kept = detections.above(self.config.min_confidence);
        if self.config.undistort { kept.undistorted(&self.cameras) } else { kept }
    }

    /// Pixels of the rendering resolution: u' = (u + ½) s − ½.
    fn at_resolution(&self, detections: &Detections) -> Detections {
        let s = self.config.resolution;
        detections.map(|_, p| Some(p.map(|u| (u + 0.5) * s - 0.5)))
    }

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

    fn sigma(&self, joint: usize) -> f64 {
        match self.config.occlusion_sigma {
            Some(sigma) if self.occlusion_prone.contains(&joint) => sigma,
            _ => self.config.sigma,
        }
    }

    fn refinement(
        &self,
        frame: &Frame,
        (init, gaussians): (&[Vector3<f64>], &[Gaussian]),
        (loss, run): (Loss, Run),
        joint_status: Vec<JointStatus>,
    ) -> Refinement {
        let mm = self.unit.millimetres();
        let covariance = |g: &Gaussian| {
            if g.mean.x.is_nan() { Matrix3::repeat(f64::NAN) } else { g.covariance() / (mm * mm) }
        };
        Refinement {
            pose: gaussians.iter().map(|g| g.mean / mm).collect(),
            covariance: gaussians.iter().map(covariance).collect(),
            init_pose: init.iter().map(|p| p / mm).collect(),
            reprojection_error: self.reprojection_error(&frame.detections, gaussians),
            joint_status,
            loss,
            loss_history: run.history,
            n_iter: run.n_iter,
            stop_reason: run.stop_reason,
        }
    }

    /// ‖detection − reprojection‖ `(M, N)` in the image as it was given.
    fn reprojection_error(&self, detections: &Detections, gaussians: &[Gaussian]) -> Vec<f64> {
        let n = gaussians.len();
        let one = |k: usize| {
            let (camera, mean) = (&self.cameras[k / n], &gaussians[k % n].mean);
            let (pixel, _) = detections.get(k / n, k % n)?;
            let project =
                if self.config.undistort { Camera::project } else { Camera::project_ideal };
            Some((project(camera, mean)? - pixel).norm())
        };
        (0..self.cameras.len() * n).map(|k| one(k).unwrap_or(f64::NAN)).collect()
    }
}

fn status(objective: &Objective<'_, f32>, joint: usize) -> JointStatus {
    match (objective.usable_views(joint), objective.meeting_views(joint)) {
        (0, _) => JointStatus::Unobserved,
        (_, 0 | 1) => JointStatus::Weak,
        _ => JointStatus::Ok,
    }
}

fn position_lr(config: &RefineConfig, cameras: &[Camera]) -> f64 {
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

//! `refine` for one frame: from detections in pixels to a pose in the unit of the cameras.

use std::sync::atomic::AtomicBool;

use nalgebra::{Matrix3, Vector3};

use super::adam::position_lr;
use super::config::{Optimizer, RefineConfig};
use super::result::Refinement;
use crate::annealed::swaps::{Chain, chains};
use crate::camera::Camera;
use crate::detections::Detections;
use crate::error::{Error, Result};
use crate::layout::Layout;
use crate::projection::View;
use crate::symmetry::LimbPair;
use crate::unit::Unit;

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
    /// Covariance `(N)`, unit², of an initial pose that does not come from these detections: it then counts as
    /// knowledge and not as a mere start.
    pub init_covariance: Option<Vec<Matrix3<f64>>>,
    /// Whether the initial pose is that of the frame before: it then decides between places that have as many votes.
    pub past: bool,
}

/// Cameras, layout and settings prepared once for any number of frames. Everything inside is in mm.
#[derive(Debug, Clone)]
pub struct Refiner {
    /// At full resolution.
    pub(super) cameras: Vec<Camera>,
    /// At the rendering resolution.
    pub(super) views: Vec<View>,
    pub(super) pairs: Vec<LimbPair>,
    pub(super) chains: Vec<Chain>,
    pub(super) occlusion_prone: Vec<usize>,
    pub(super) n_joints: Option<usize>,
    pub(super) position_lr: f64,
    pub(super) unit: Unit,
    pub(super) config: RefineConfig,
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
        if let Some(w) = config.view_weights.as_ref().filter(|w| w.len() != cameras.len()) {
            let expected = format!("one weight per camera ({})", cameras.len());
            return Err(Error::invalid("config.view_weights", expected, w.len().to_string()));
        }
        let cameras: Vec<Camera> =
            cameras.iter().map(|c| c.clone().with_length_scale(unit.millimetres())).collect();
        let scaled: Result<Vec<Camera>> =
            cameras.iter().map(|c| c.scaled(config.resolution)).collect();
        let scaled = scaled.map_err(|error| error.of_argument("config.resolution"));
        let pairs = layout
            .filter(|_| config.symmetry_tier > 0)
            .map(|l| l.symmetric_pairs(config.symmetry_tier).collect());
        Ok(Self {
            views: scaled?.iter().map(View::new).collect(),
            position_lr: position_lr(&config, &cameras),
            pairs: pairs.unwrap_or_default(),
            chains: layout.filter(|_| config.find_swaps).map(chains).unwrap_or_default(),
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
        match self.config.optimizer {
            Optimizer::Adam => self.refine_adam(frame, parallel, cancel),
            Optimizer::GaussNewton => Ok(self.refine_annealed(frame)),
        }
    }

    pub(super) fn check(&self, frame: &Frame) -> Result<()> {
        let (m, n) = (frame.detections.n_views(), frame.detections.n_joints());
        if m != self.cameras.len() {
            let expected = format!("one view per camera ({})", self.cameras.len());
            return Err(Error::invalid("detections", expected, format!("{m} views")));
        }
        if let Some(joints) = self.n_joints.filter(|joints| *joints != n) {
            let expected = format!("the layout's {joints} joints");
            return Err(Error::invalid("detections", expected, format!("{n} joints")));
        }
        let lengths = [
            ("init_pose", frame.init_pose.as_ref().map(Vec::len)),
            ("init_sigma", frame.init_covariance.as_ref().map(Vec::len)),
            ("config.joint_sigmas", self.config.joint_sigmas.as_ref().map(Vec::len)),
        ];
        if let Some((name, length)) = lengths.iter().find(|(_, l)| l.is_some_and(|l| l != n)) {
            let expected = format!("{n} joints, as the detections have");
            return Err(Error::invalid(*name, expected, format!("{} joints", length.unwrap_or(0))));
        }
        match &frame.init_covariance {
            Some(_) if frame.init_pose.is_none() => {
                Err(Error::invalid("init_sigma", "an init_pose beside it", "none"))
            }
            Some(_) if self.config.optimizer == Optimizer::Adam => {
                let expected = "optimizer 'gauss_newton' with it";
                Err(Error::invalid("init_sigma", expected, self.config.optimizer.name()))
            }
            _ => Ok(()),
        }
    }

    /// Detections as ideal pixels, without those below the least confidence.
    pub(super) fn usable(&self, detections: &Detections) -> Detections {
        let kept = detections.above(self.config.min_confidence);
        if self.config.undistort { kept.undistorted(&self.cameras) } else { kept }
    }

    /// Standard deviation of joint `joint`'s splat, mm.
    pub(super) fn sigma(&self, joint: usize) -> f64 {
        if let Some(sigmas) = &self.config.joint_sigmas {
            return sigmas[joint];
        }
        match self.config.occlusion_sigma {
            Some(sigma) if self.occlusion_prone.contains(&joint) => sigma,
            _ => self.config.sigma,
        }
    }

    /// ‖detection − reprojection‖ `(M, N)` in the image as it was given; `used_for(view, joint)` says to which joint a
    /// detection belongs.
    pub(super) fn reprojection_error(
        &self,
        detections: &Detections,
        points: &[Vector3<f64>],
        used_for: impl Fn(usize, usize) -> usize,
    ) -> Vec<f64> {
        let n = points.len();
        let one = |k: usize| {
            let (camera, mean) = (&self.cameras[k / n], &points[used_for(k / n, k % n)]);
            let (pixel, _) = detections.get(k / n, k % n)?;
            let project =
                if self.config.undistort { Camera::project } else { Camera::project_ideal };
            Some((project(camera, mean)? - pixel).norm())
        };
        (0..self.cameras.len() * n).map(|k| one(k).unwrap_or(f64::NAN)).collect()
    }
}

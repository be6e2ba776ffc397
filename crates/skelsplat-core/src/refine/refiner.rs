//! `refine` for one frame: from detections in pixels to a pose in the unit of the cameras.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use nalgebra::{Matrix3, Vector3};

use super::bias::JointBias;
use super::config::{Method, RefineConfig};
use super::frame::Frame;
use super::results::Refinement;
use crate::annealed::rays::Rays;
use crate::annealed::swaps::{Chain, chains};
use crate::annealed::{Alone, Annealed, AnnealedFrame, AnnealedSettings, Before, Bones, Prior};
use crate::bones::Length;
use crate::bones::expected::Expected;
use crate::camera::Camera;
use crate::detections::Detections;
use crate::error::{Error, Result};
use crate::gaussian::Gaussian;
use crate::layout::{Layout, LayoutSpec};
use crate::outcome::{ErrorBars, JointStatus, Outcome};
use crate::paper::{self, LossAndGradient, PaperSettings, Renderer, Shapes};
use crate::projection::View;
use crate::symmetry::LimbPair;
use crate::threads;
use crate::unit::Unit;

/// Cameras, layout and settings prepared once for any number of frames. Everything inside is in mm,
/// or, for bodies of another size than people, in mm of a body of a person's size.
#[derive(Debug, Clone)]
pub struct Refiner {
    /// At full resolution, in mm.
    pub(crate) cameras: Vec<Camera>,
    /// At the rendering resolution.
    views: Vec<View>,
    pairs: Vec<LimbPair>,
    /// Joints that a detector may swap together.
    pub(crate) chains: Vec<Chain>,
    /// Expected lengths of bones.
    pub(crate) expected: Expected,
    /// Empty where none is given.
    layout: LayoutSpec,
    /// Standard deviations of the joints' systematic errors, in the unit of the cameras; empty if
    /// their number is unknown.
    joint_bias: Arc<[f64]>,
    /// What the rig's own error adds to it, in the cameras' unit.
    rig_sigma: f64,
    /// Settings of the rendering loss: those of `paper`, or for `annealed` its closed form.
    paper: PaperSettings,
    unit: Unit,
    /// The body's size in multiples of a person's.
    pub(crate) size: f64,
    config: RefineConfig,
}

impl Refiner {
    /// Prepares `cameras`, given in `unit`. Without a `layout` there is no symmetry and no
    /// occlusion-prone joint.
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
        let (paper, view_weights, find_swaps, expected) = match &config.method {
            Method::Paper(settings) => (settings.clone(), None, false, Expected::default()),
            Method::Annealed(settings) => (
                PaperSettings { renderer: Renderer::ClosedForm, ..PaperSettings::default() },
                settings.view_weights.as_ref(),
                settings.find_swaps,
                expected(layout, settings)?,
            ),
        };
        if let Some(w) = view_weights.filter(|w| w.len() != cameras.len()) {
            let expected = format!("one weight per camera ({})", cameras.len());
            return Err(Error::invalid("config.view_weights", expected, w.len().to_string()));
        }
        let cameras = scaled(cameras, unit.millimetres());
        let smaller: Result<Vec<Camera>> =
            cameras.iter().map(|c| c.scaled(paper.resolution)).collect();
        let smaller = smaller.map_err(|error| error.of_argument("config.resolution"));
        let bias = config.joint_bias_mm.per_joint(layout, layout.map_or(0, Layout::n_joints));
        Ok(Self {
            views: smaller?.iter().map(View::new).collect(),
            pairs: layout.map_or(Vec::new(), |l| l.symmetric_pairs(config.symmetry_tier).collect()),
            chains: layout.filter(|_| find_swaps).map(chains).unwrap_or_default(),
            expected,
            layout: layout.map_or_else(LayoutSpec::default, |layout| (**layout).clone()),
            joint_bias: in_unit(bias, unit),
            rig_sigma: 0.0,
            cameras,
            paper,
            unit,
            size: 1.0,
            config,
        })
    }

    /// With the standard deviation, per axis and in the cameras' unit, by which joints are off
    /// because the cameras' places are estimated.
    #[must_use]
    pub fn with_rig_sigma(mut self, sigma: f64) -> Self {
        self.rig_sigma = sigma;
        self.joint_bias = self.with_rig(&self.joint_bias);
        self
    }

    /// Standard deviations with that of the rig.
    fn with_rig(&self, bias: &[f64]) -> Arc<[f64]> {
        bias.iter().map(|sigma| sigma.hypot(self.rig_sigma)).collect()
    }

    /// The settings.
    pub fn config(&self) -> &RefineConfig {
        &self.config
    }

    /// The unit of the cameras and of all poses.
    pub fn unit(&self) -> Unit {
        self.unit
    }

    /// The same for bodies that are `size` times as large as people: settings and constants in mm
    /// are those of a body of a person's size.
    pub(crate) fn at_size(&self, size: f64) -> Self {
        let mut out = self.clone();
        let scale = self.size / size;
        out.cameras = scaled(&self.cameras, scale);
        for bone in &mut out.expected.given {
            bone.length =
                Length { mean: bone.length.mean * scale, sigma: bone.length.sigma * scale };
        }
        out.size = size;
        out
    }

    /// Lengths inside per unit of the cameras: mm, or those of a body of a person's size.
    pub(crate) fn millimetres(&self) -> f64 {
        self.unit.millimetres() / self.size
    }

    /// Refines one frame.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if views or joints do not match.
    pub fn refine(&self, frame: &Frame) -> Result<Refinement> {
        self.refine_under(frame, false, &AtomicBool::new(false))
    }

    /// Refines one frame, whose windows are distributed over threads if `parallel`; the result is
    /// the same.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if views or joints do not match, [`Error::Cancelled`] once `cancel`
    /// is set.
    pub fn refine_under(
        &self,
        frame: &Frame,
        parallel: bool,
        cancel: &AtomicBool,
    ) -> Result<Refinement> {
        self.check(frame)?;
        let used = self.usable(&frame.detections);
        let (outcome, bars) = match &self.config.method {
            Method::Annealed(_) => {
                let found = self.annealed(&used, self.before(frame)).solve();
                (found.outcome, found.bars)
            }
            Method::Paper(_) => {
                let (outcome, status) = self.by_paper(frame, &used, parallel, cancel)?;
                let bars = self.annealed(&used, None).error_bars(&outcome.points, &status);
                (outcome, bars)
            }
        };
        Ok(self.result(&frame.detections, outcome, &bars))
    }

    /// The frame solved alone, with the rays that it used.
    pub(crate) fn alone(&self, frame: &Frame) -> Result<Alone> {
        self.check(frame)?;
        let used = self.usable(&frame.detections);
        let frame =
            AnnealedFrame { in_recording: true, ..self.annealed(&used, self.before(frame)) };
        let Annealed { outcome, bars, rays } = frame.solve();
        Ok(Alone { rays, used_for: outcome.used_for, points: outcome.points, bars })
    }

    /// The class of each of `n` joints: left and right joints err alike.
    pub(crate) fn classes(&self, n: usize) -> Vec<usize> {
        let mut classes: Vec<usize> = (0..n).collect();
        self.layout.left_right.iter().for_each(|[l, r]| classes[*r] = classes[*l]);
        classes
    }

    /// The rays of usable detections.
    pub(crate) fn rays(&self, detections: &Detections) -> Result<Rays> {
        self.check_detections(detections)?;
        Ok(Rays::new(&self.usable(detections), &self.cameras, &[]))
    }

    /// Joints at both ends of every bone.
    pub(crate) fn bones(&self) -> &[[usize; 2]] {
        &self.layout.limbs
    }

    /// The result for these `detections`.
    pub(crate) fn result(
        &self,
        detections: &Detections,
        outcome: Outcome,
        bars: &ErrorBars,
    ) -> Refinement {
        let errors = self.reprojection_error(detections, &outcome);
        let bias = self.joint_bias(outcome.points.len());
        Refinement::new(outcome, bars, errors, bias, self.millimetres())
    }

    /// Standard deviations of the systematic errors of `n` joints, in the unit of the cameras.
    pub(crate) fn joint_bias(&self, n: usize) -> Arc<[f64]> {
        match self.joint_bias.len() == n {
            true => Arc::clone(&self.joint_bias),
            false => {
                let bias = self.config.joint_bias_mm.per_joint(None, n);
                self.with_rig(&in_unit(bias, self.unit))
            }
        }
    }

    /// Loss over all views and its gradient for any Gaussians `(N)`, in doubles, for study and
    /// tests: the paper's with the paper's settings, else its closed form.
    ///
    /// Means and log-scales (ln σ) are in the unit of the cameras, as is the gradient. The pseudo
    /// ground truth is shaped by the `targets` (mean and covariance per joint; `None`: the
    /// Gaussians themselves).
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if views or joints do not match, [`Error::OutOfMemory`] if the
    /// splats' windows are too large, [`Error::Cancelled`] once `cancel` is set.
    pub fn loss_and_gradient(
        &self,
        gaussians: &[Gaussian],
        detections: &Detections,
        targets: Option<Shapes>,
        cancel: &AtomicBool,
    ) -> Result<LossAndGradient> {
        let means = gaussians.iter().map(|g| g.mean).collect();
        self.check(&Frame { init_pose: Some(means), ..detections.clone().into() })?;
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
        let used = self.usable(detections);
        let frame = self.paper(&used, false, cancel).loss_and_gradient(&gaussians, &shapes);
        frame.map(|mut found| {
            found.gradient.iter_mut().for_each(|g| g.mean *= mm);
            found
        })
    }

    fn check_detections(&self, detections: &Detections) -> Result<()> {
        let (m, n) = (detections.n_views(), detections.n_joints());
        if m != self.cameras.len() {
            let expected = format!("one view per camera ({})", self.cameras.len());
            return Err(Error::invalid("detections", expected, format!("{m} views")));
        }
        let joints = self.layout.joints.len();
        if joints > 0 && joints != n {
            let expected = format!("the layout's {joints} joints");
            return Err(Error::invalid("detections", expected, format!("{n} joints")));
        }
        Ok(())
    }

    /// Rejects a frame of other sizes than the cameras and the layout.
    pub(crate) fn check(&self, frame: &Frame) -> Result<()> {
        self.check_detections(&frame.detections)?;
        let n = frame.detections.n_joints();
        let biases = match &self.config.joint_bias_mm {
            JointBias::Each(each) => Some(each.len()),
            _ => None,
        };
        let lengths = [
            ("init_pose", frame.init_pose.as_ref().map(Vec::len)),
            ("init_sigma", frame.init_covariance.as_ref().map(Vec::len)),
            ("config.joint_sigmas_mm", self.config.joint_sigmas_mm.as_ref().map(Vec::len)),
            ("config.joint_bias_mm", biases),
        ];
        if let Some((name, length)) = lengths.iter().find(|(_, l)| l.is_some_and(|l| l != n)) {
            let expected = format!("{n} joints, as in the detections");
            return Err(Error::invalid(*name, expected, format!("{} joints", length.unwrap_or(0))));
        }
        match (&frame.init_covariance, &self.config.method) {
            (Some(_), _) if frame.init_pose.is_none() => {
                Err(Error::invalid("init_sigma", "an init_pose as well", "none"))
            }
            (Some(_), Method::Paper(_)) => {
                Err(Error::invalid("init_sigma", "the method 'annealed'", "'paper'"))
            }
            _ => Ok(()),
        }
    }

    /// Detections as ideal pixels, without those below the least confidence.
    fn usable(&self, detections: &Detections) -> Detections {
        let kept = detections.above(self.config.min_confidence);
        if self.config.undistort { kept.undistorted(&self.cameras) } else { kept }
    }

    /// Standard deviations of the joints' splats `(N)`, mm.
    pub(crate) fn sigmas(&self, n_joints: usize) -> Vec<f64> {
        if let Some(sigmas) = &self.config.joint_sigmas_mm {
            return sigmas.clone();
        }
        let sigma = |j: usize| match self.config.occlusion_sigma_mm {
            Some(sigma) if self.layout.occlusion_prone.contains(&j) => sigma,
            _ => self.config.sigma_mm(),
        };
        (0..n_joints).map(sigma).collect()
    }

    fn annealed<'a>(&'a self, used: &'a Detections, before: Option<Before>) -> AnnealedFrame<'a> {
        let sigmas = self.sigmas(used.n_joints());
        let (symmetry, noise) = (self.config.symmetry_sigma_mm, self.config.detection_sigma_px);
        let (annealing, weights) = match &self.config.method {
            Method::Annealed(own) => {
                (own.annealing(sigmas, symmetry, noise), own.view_weights.as_deref())
            }
            Method::Paper(_) => {
                (AnnealedSettings::default().annealing(sigmas, symmetry, noise), None)
            }
        };
        AnnealedFrame {
            cameras: &self.cameras,
            detections: used,
            view_weights: weights.unwrap_or_default(),
            pairs: &self.pairs,
            chains: &self.chains,
            expected: &self.expected,
            annealing,
            before,
            in_recording: false,
        }
    }

    fn paper<'a>(
        &'a self,
        used: &'a Detections,
        parallel: bool,
        cancel: &'a AtomicBool,
    ) -> paper::PaperFrame<'a> {
        paper::PaperFrame {
            cameras: &self.cameras,
            views: &self.views,
            detections: used,
            pairs: &self.pairs,
            settings: &self.paper,
            parallel,
            cancel,
        }
    }

    /// Runs in the caller's thread pool, else in that of the process; never in rayon's global pool,
    /// which does not survive a fork.
    fn by_paper(
        &self,
        frame: &Frame,
        used: &Detections,
        parallel: bool,
        cancel: &AtomicBool,
    ) -> Result<(Outcome, Vec<JointStatus>)> {
        let pose = self.initial_pose(frame);
        let sigmas = self.sigmas(used.n_joints());
        let solve =
            |parallel: bool| self.paper(used, parallel, cancel).solve(pose.as_deref(), &sigmas);
        if parallel && rayon::current_thread_index().is_none() {
            return threads::install(None, solve);
        }
        solve(parallel)
    }

    /// The initial pose in mm; `None` for a joint without one.
    fn initial_pose(&self, frame: &Frame) -> Option<Vec<Option<Vector3<f64>>>> {
        let mm = self.millimetres();
        let known = |p: &Vector3<f64>| p.iter().all(|v| v.is_finite()).then_some(p * mm);
        frame.init_pose.as_ref().map(|pose| pose.iter().map(known).collect())
    }

    /// The initial pose and, with covariances, the prior.
    fn before(&self, frame: &Frame) -> Option<Before> {
        let pose = self.initial_pose(frame)?;
        let mm = self.millimetres();
        let prior = |(p, c): (&Option<Vector3<f64>>, &Matrix3<f64>)| {
            let widest = c.diagonal().max();
            let spread = if widest.is_finite() { mm * widest.sqrt() } else { 0.0 };
            match (p, (c * (mm * mm)).cholesky()) {
                (Some(mean), Some(factor)) => {
                    Prior { mean: *mean, precision: factor.inverse(), spread }
                }
                _ => Prior { mean: Vector3::zeros(), precision: Matrix3::zeros(), spread },
            }
        };
        let covariances = frame.init_covariance.as_ref();
        let priors = covariances.map(|all| pose.iter().zip(all).map(prior).collect());
        Some(Before { pose, priors })
    }

    /// ‖detection − reprojection‖ `(M, N)` in the original image.
    fn reprojection_error(&self, detections: &Detections, outcome: &Outcome) -> Vec<f64> {
        let n = outcome.points.len();
        let project = if self.config.undistort { Camera::project } else { Camera::project_ideal };
        let distance = |(k, joint): (usize, &usize)| {
            let (pixel, _) = detections.get(k / n, k % n)?;
            Some((project(&self.cameras[k / n], &outcome.points[*joint])? - pixel).norm())
        };
        outcome.used_for.iter().enumerate().map(|k| distance(k).unwrap_or(f64::NAN)).collect()
    }
}

/// Cameras in a world that is so many times as large.
fn scaled(cameras: &[Camera], factor: f64) -> Vec<Camera> {
    cameras.iter().map(|camera| camera.clone().with_length_scale(factor)).collect()
}

/// The lengths of bones that these settings expect.
fn expected(layout: Option<&Layout>, settings: &AnnealedSettings) -> Result<Expected> {
    let (lengths, sigmas) = (&settings.bone_lengths_mm, &settings.bone_sigmas_mm);
    if settings.bones == Bones::Free {
        return match lengths.is_some() || sigmas.is_some() {
            true => {
                Err(Error::invalid("config.bones", "'population' with given lengths", "'free'"))
            }
            false => Ok(Expected::default()),
        };
    }
    Expected::new(layout, lengths.as_deref(), sigmas.as_deref())
}

/// Lengths in mm, converted to `unit`.
fn in_unit(lengths: Vec<f64>, unit: Unit) -> Arc<[f64]> {
    lengths.into_iter().map(|mm| mm / unit.millimetres()).collect()
}

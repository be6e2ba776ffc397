//! `refine`, for one frame or many.

use std::iter::repeat;
use std::sync::{Arc, Mutex};

use nalgebra::{Matrix3, Vector3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use skelsplat_core::study::gaussian::is_symmetric;
use skelsplat_core::study::outcome::Loss;
use skelsplat_core::study::sequence::{Window, sample, window_size, windows};
use skelsplat_core::study::unit::implausible_extent as core_extent;
use skelsplat_core::{
    Frame, Known, Live, Method, Progress, Refinements, Refiner, Sequence, follow, learn_sequence,
    refine_batch, refine_sequence, refine_windows,
};

use crate::args::{Array, Confidence, InitPose, InitSigma, Out, Poses, place};
use crate::camera::Cameras;
use crate::config::RefineConfig;
use crate::detections::Frames;
use crate::errors::{Result, refuse};
use crate::layout::Layout;
use crate::watch;

/// Smallest standard deviation of an initial pose: the inverse of its square is well within the
/// range of a double.
const FINEST: f64 = 1e-15;

/// The core's refiner for these arguments.
pub(crate) fn refiner(
    cameras: &Cameras,
    layout: Option<Layout>,
    config: Option<RefineConfig>,
) -> Result<Refiner> {
    let config = config.map_or_else(Default::default, |config| config.0);
    let layout = layout.map(|layout| layout.0);
    let refiner = Refiner::new(&cameras.cameras, cameras.unit, layout.as_ref(), config)?;
    Ok(refiner.with_rig_sigma(cameras.joint_sigma))
}

/// Cameras, layout and settings, prepared for any number of frames.
///
/// Raises
/// ------
/// InvalidInputError
///     No camera, an unknown layout, or settings that do not match the cameras.
#[pyclass(frozen, module = "skelsplat._skelsplat", name = "Refiner")]
#[derive(Clone)]
pub(crate) struct PyRefiner(pub(crate) Arc<Refiner>);

#[pymethods]
impl PyRefiner {
    #[new]
    #[pyo3(signature = (cameras, *, layout=None, config=None))]
    fn new(cameras: Cameras, layout: Option<Layout>, config: Option<RefineConfig>) -> Result<Self> {
        Ok(Self(Arc::new(refiner(&cameras, layout, config)?)))
    }

    /// Return the fields of ``skelsplat.Refinement``; ``joint_status`` as codes into
    /// ``JOINT_STATUS``.
    #[pyo3(signature = (init_pose, detections, *, confidence=None, init_sigma=None, progress=None))]
    fn refine<'py>(
        &self,
        py: Python<'py>,
        init_pose: Option<InitPose>,
        detections: Frames,
        confidence: Option<Confidence>,
        init_sigma: Option<InitSigma>,
        progress: Option<Bound<'py, PyAny>>,
    ) -> Result<Bound<'py, PyDict>> {
        let mut frames = detections.with(confidence)?;
        let poses = initial_poses(init_pose, &frames)?;
        let covariances = initial_covariances(init_sigma, &frames)?;
        let starts = poses.into_iter().zip(covariances);
        let jobs = frames.take()?.into_iter().zip(starts).map(|(detections, start)| Frame {
            init_pose: start.0,
            init_covariance: start.1,
            ..detections.into()
        });
        let (jobs, refiner): (Vec<Frame>, _) = (jobs.collect(), Arc::clone(&self.0));
        let (short, total) = (self.is_short(&frames), jobs.len());
        let work = move |progress: &Progress| refine_batch(&refiner, &jobs, progress);
        let done = match total {
            1 => watch::run(py, short, work)?,
            _ => watch::watched(py, total, progress.as_ref(), work)?,
        };
        results(py, &frames, done)
    }

    /// Return the fields of ``skelsplat.SequenceRefinement``; the status as codes.
    #[pyo3(signature = (init_pose, detections, fps, *, confidence=None, progress=None))]
    fn refine_sequence<'py>(
        &self,
        py: Python<'py>,
        init_pose: Option<InitPose>,
        detections: Frames,
        fps: f64,
        confidence: Option<Confidence>,
        progress: Option<Bound<'py, PyAny>>,
    ) -> Result<Bound<'py, PyDict>> {
        let mut frames = detections.with(confidence)?.recording()?;
        let jobs = started(init_pose, &mut frames)?;
        let (refiner, total) = (Arc::clone(&self.0), jobs.len());
        let work = move |progress: &Progress| refine_sequence(&refiner, &jobs, fps, progress);
        let done = watch::watched(py, total, progress.as_ref(), work)?;
        over_time(py, &frames, done)
    }

    /// Return what a sample shows about its recording; ``stretches``: lengths of its parts.
    #[pyo3(signature = (init_pose, detections, fps, stretches))]
    fn learn_sequence(
        &self,
        py: Python<'_>,
        init_pose: Option<InitPose>,
        detections: Frames,
        fps: f64,
        stretches: Vec<usize>,
    ) -> Result<PyKnown> {
        let mut frames = detections.recording()?;
        let jobs = started(init_pose, &mut frames)?;
        let refiner = Arc::clone(&self.0);
        let known = watch::watched(py, 0, None, move |progress: &Progress| {
            let mut rest = jobs.as_slice();
            let parts = stretches.iter().map_while(|n| rest.split_off(..*n)).collect::<Vec<_>>();
            learn_sequence(&refiner, &parts, fps, progress)
        })?;
        Ok(PyKnown(Arc::new(known)))
    }

    /// Return the fields of ``skelsplat.SequenceRefinement`` of some windows, as
    /// ``sequence_windows``.
    #[pyo3(signature = (init_pose, detections, known, windows, *, progress=None))]
    fn refine_windows<'py>(
        &self,
        py: Python<'py>,
        init_pose: Option<InitPose>,
        detections: Frames,
        known: &PyKnown,
        windows: Vec<[usize; 4]>,
        progress: Option<Bound<'py, PyAny>>,
    ) -> Result<Bound<'py, PyDict>> {
        let mut frames = detections.recording()?;
        let jobs = started(init_pose, &mut frames)?;
        let known = Arc::clone(&known.0);
        let window = |[a, b, c, d]: &[usize; 4]| Window { all: *a..*d, own: *b..*c };
        let windows: Vec<Window> = windows.iter().map(window).collect();
        let (refiner, total) = (Arc::clone(&self.0), windows.iter().map(|w| w.own.len()).sum());
        let done = watch::watched(py, total, progress.as_ref(), move |progress: &Progress| {
            refine_windows(&refiner, &jobs, &windows, &known, progress)
        })?;
        frames.count = total;
        over_time(py, &frames, done)
    }

    /// Return the fields of the frame that follows ``past`` (N, 3), and the past of the next frame.
    #[pyo3(signature = (past, detections, *, confidence=None))]
    fn follow<'py>(
        &self,
        py: Python<'py>,
        past: Option<InitPose>,
        detections: Frames,
        confidence: Option<Confidence>,
    ) -> Result<(Bound<'py, PyDict>, Out<f64>)> {
        let frames = detections.with(confidence)?;
        let given = frames.only()?;
        let (past, refiner) = (past.map(|past| past.0.points()), Arc::clone(&self.0));
        let (done, past) = watch::run(py, self.is_short(&frames), move |progress| {
            follow(&refiner, past, given, progress)
        })?;
        let past = Out::points(&past, vec![frames.n_joints, 3]);
        Ok((results(py, &frames, done.into())?, past))
    }
}

/// What a sample of a recording shows about all of it.
#[pyclass(frozen, module = "skelsplat._skelsplat", name = "Known")]
pub(crate) struct PyKnown(Arc<Known>);

/// The frames of a live loop at a known rate, with the state between them.
///
/// Raises
/// ------
/// InvalidInputError
///     ``fps`` is not positive, or the method is ``paper``.
#[pyclass(frozen, module = "skelsplat._skelsplat", name = "Live")]
pub(crate) struct PyLive {
    refiner: PyRefiner,
    live: Arc<Mutex<Live>>,
}

#[pymethods]
impl PyLive {
    #[new]
    #[pyo3(signature = (refiner, fps, *, lag=0))]
    fn new(refiner: &PyRefiner, fps: f64, lag: usize) -> Result<Self> {
        let live = Live::new(&refiner.0, fps, lag)?;
        Ok(Self { refiner: refiner.clone(), live: Arc::new(Mutex::new(live)) })
    }

    /// Return the fields of ``skelsplat.Refinement``; ``joint_status`` as codes.
    #[pyo3(signature = (detections, *, confidence=None))]
    fn step<'py>(
        &self,
        py: Python<'py>,
        detections: Frames,
        confidence: Option<Confidence>,
    ) -> Result<Bound<'py, PyDict>> {
        let frames = detections.with(confidence)?;
        let given = frames.only()?;
        let (refiner, live) = (Arc::clone(&self.refiner.0), Arc::clone(&self.live));
        let done = watch::run(py, self.refiner.is_short(&frames), move |progress| {
            watch::locked(&live).step(&refiner, given, progress)
        })?;
        results(py, &frames, done.into())
    }

    /// Forget all frames.
    fn reset(&self) {
        watch::locked(&self.live).reset();
    }
}

impl PyRefiner {
    /// Whether one of these frames takes at most a few milliseconds.
    fn is_short(&self, frames: &Frames) -> bool {
        let config = self.0.config();
        let steps = match &config.method {
            Method::Annealed(_) => 1,
            Method::Paper(_) if config.draws_pixels() => return false,
            Method::Paper(settings) => settings.max_steps,
        };
        watch::is_short(steps, frames.n_views, frames.n_joints)
    }
}

/// The frames of a recording with their initial poses.
fn started(init_pose: Option<InitPose>, frames: &mut Frames) -> Result<Vec<Frame>> {
    let poses = initial_poses(init_pose, frames)?;
    let jobs = frames.take()?.into_iter().zip(poses);
    Ok(jobs.map(|(detections, init_pose)| Frame { init_pose, ..detections.into() }).collect())
}

/// Return the windows (W, 4) of a recording and the frames (S, 2) from which is learnt.
///
/// A window: where the frames it looks at begin, where its own begin and end, and where the former
/// end.
#[pyfunction]
pub(crate) fn sequence_windows(n_frames: usize, fps: f64) -> (Vec<[usize; 4]>, Vec<[usize; 2]>) {
    let windows = windows(n_frames, window_size(fps));
    let parts = sample(&windows).iter().map(|part| [part.start, part.end]).collect();
    let row = |w: &Window| [w.all.start, w.own.start, w.own.end, w.all.end];
    (windows.iter().map(row).collect(), parts)
}

/// Return the largest number of frames of a window, and how many it looks at on either side.
#[pyfunction]
pub(crate) fn sequence_window_size(fps: f64) -> [usize; 2] {
    window_size(fps)
}

/// Return detections (T, M, N, 2|3) as float64, checked, with confidences slightly above 1 clipped.
#[pyfunction]
pub(crate) fn checked_detections(
    detections: Frames,
    confidence: Option<Confidence>,
    n_views: usize,
) -> Result<Out<f64>> {
    let frames = detections.with(confidence)?.recording()?;
    frames.expect_views(n_views)?;
    Ok(frames.numbers())
}

/// The initial pose of every frame, `None` where it is to be triangulated.
fn initial_poses(
    given: Option<InitPose>,
    frames: &Frames,
) -> Result<Vec<Option<Vec<Vector3<f64>>>>> {
    let Some(InitPose(array)) = given else { return Ok(vec![None; frames.count]) };
    let shape = frames.shape(&[frames.n_joints, 3]);
    let points = array.of(&shape, ", as in the detections")?.points();
    Ok(points.chunks(frames.n_joints).map(|p| Some(p.to_vec())).collect())
}

/// Covariances of the initial pose of every frame, from standard deviations or covariances.
fn initial_covariances(
    given: Option<InitSigma>,
    frames: &Frames,
) -> Result<Vec<Option<Vec<Matrix3<f64>>>>> {
    let (t, n) = (frames.count, frames.n_joints);
    let Some(InitSigma(array)) = given else { return Ok(vec![None; t]) };
    let covariances = match *array.shape.as_slice() {
        [] => vec![isotropic(&array)?[0]; n],
        [k] if k == n => isotropic(&array)?,
        [k, 3, 3] if k == n => array.matrices(),
        [f, k, 3, 3] if frames.batch && f == t && k == n => array.matrices(),
        _ => {
            let frames = if frames.batch { format!(" or ({t}, {n}, 3, 3)") } else { String::new() };
            let expected = format!("() for a number, ({n},), ({n}, 3, 3){frames}");
            return Err(array.misshapen(&expected));
        }
    };
    let valid = |c: &Matrix3<f64>| {
        let finite = c.iter().all(|v| v.is_finite());
        let wide = || c.cholesky().is_some_and(|root| root.l_dirty().diagonal().min() >= FINEST);
        c.iter().any(|v| v.is_nan()) || (finite && is_symmetric(c) && wide())
    };
    if let Some(k) = covariances.iter().position(|c| !valid(c)) {
        let shape = if covariances.len() == n { vec![n] } else { vec![t, n] };
        let name = place("init_sigma", &shape, k, "");
        let expected = "a symmetric positive definite covariance, or NaN for none";
        return refuse(name, expected, "another matrix");
    }
    Ok(covariances.chunks(n).cycle().take(t).map(|of_frame| Some(of_frame.to_vec())).collect())
}

/// Isotropic covariances of these standard deviations.
fn isotropic(sigmas: &Array) -> Result<Vec<Matrix3<f64>>> {
    let is_sigma = |s: &f64| s.is_nan() || (*s > 0.0 && s.is_finite());
    if let Some(j) = sigmas.values.iter().position(|s| !is_sigma(s)) {
        let expected = "a positive finite standard deviation, or NaN for none";
        return Err(sigmas.refused(j, expected, sigmas.values[j].to_string()));
    }
    if let Some(j) = sigmas.values.iter().position(|s| *s < FINEST) {
        let expected = format!("standard deviations of at least {FINEST:e}");
        return Err(sigmas.refused(j, &expected, format!("{:e}", sigmas.values[j])));
    }
    Ok(sigmas.values.iter().map(|sigma| Matrix3::from_diagonal_element(sigma * sigma)).collect())
}

/// The arrays of `Refinement`, with the leading T if there was one.
pub(crate) fn results<'py>(
    py: Python<'py>,
    frames: &Frames,
    done: Refinements,
) -> Result<Bound<'py, PyDict>> {
    let (m, n) = (frames.n_views, frames.n_joints);
    let steps = done.loss_history.iter().map(Vec::len).max().unwrap_or(0);
    // NaN after the last step of a frame
    let history = |told: &Vec<Loss>| {
        let told: Vec<f64> = told.iter().map(|l| l.total).collect();
        told.into_iter().chain(repeat(f64::NAN)).take(steps)
    };
    let loss = |term: fn(&Loss) -> f64| frames.out(done.loss.iter().map(term).collect(), &[]);
    let out = PyDict::new(py);
    out.set_item("loss", loss(|l| l.total))?;
    out.set_item("loss_render", loss(|l| l.render))?;
    out.set_item("loss_symmetry", loss(|l| l.symmetry))?;
    let history = done.loss_history.iter().flat_map(history).collect();
    out.set_item("loss_history", frames.out(history, &[steps]))?;
    let status = done.joint_status.iter().map(|s| *s as u8).collect();
    out.set_item("joint_status", frames.out(status, &[n]))?;
    let n_iter = done.n_iter.iter().map(|n| *n as i64).collect();
    out.set_item("n_iter", frames.out(n_iter, &[]))?;
    let reasons: Vec<&str> = done.stop_reason.iter().map(|reason| reason.name()).collect();
    out.set_item("stop_reason", reasons)?;
    // The same in all frames
    let bias = if done.is_empty() { vec![0.0; n] } else { done.joint_bias.to_vec() };
    out.set_item("joint_bias", Out(bias, vec![n]))?;
    // Without a copy
    out.set_item("pose", frames.out(done.pose, &[n, 3]))?;
    out.set_item("init_pose", frames.out(done.init_pose, &[n, 3]))?;
    out.set_item("covariance", frames.out(done.covariance, &[n, 3, 3]))?;
    out.set_item("uncertainty", frames.out(done.uncertainty, &[n, 3, 3]))?;
    out.set_item("view_weights", frames.out(done.view_weights, &[m, n]))?;
    out.set_item("reprojection_error", frames.out(done.reprojection_error, &[m, n]))?;
    out.set_item("swapped", frames.out(done.swapped, &[m, n]))?;
    out.set_item("noise", frames.out(done.noise, &[]))?;
    Ok(out)
}

/// The arrays of `SequenceRefinement`.
pub(crate) fn over_time<'py>(
    py: Python<'py>,
    frames: &Frames,
    done: Sequence,
) -> Result<Bound<'py, PyDict>> {
    let (n, bones) = (frames.n_joints, done.bones.len());
    let out = results(py, frames, done.frames)?;
    out.set_item("velocity", frames.out(done.velocity, &[n, 3]))?;
    out.set_item("velocity_uncertainty", frames.out(done.velocity_covariance, &[n, 3, 3]))?;
    out.set_item("view_noise", Out(done.view_noise, vec![frames.n_views]))?;
    let (mean, sigma) = done.lengths.iter().map(|l| (l.mean, l.sigma)).unzip();
    let ends = done.bones.iter().flatten().map(|j| *j as i64).collect();
    out.set_item("bones", Out(ends, vec![bones, 2]))?;
    out.set_item("bone_lengths", Out(mean, vec![bones]))?;
    out.set_item("bone_length_sigma", Out(sigma, vec![bones]))?;
    Ok(out)
}

/// Return the facts for a warning if the skeletons (T, N, 3) are larger than 10 m or smaller than
/// 22 cm.
///
/// Without a layout the lower limit is 10 cm, if the cameras are less than 5 cm apart; a layout
/// that is not human has none, and its upper limit is 20 m. None if the size is plausible.
#[pyfunction]
#[pyo3(signature = (poses, cameras, *, layout=None))]
pub(crate) fn implausible_extent<'py>(
    py: Python<'py>,
    poses: Poses,
    cameras: Cameras,
    layout: Option<Layout>,
) -> PyResult<Option<Bound<'py, PyDict>>> {
    let (n, layout) = (poses.0.shape[1].max(1), layout.map(|layout| layout.0));
    let poses: Vec<Vec<Vector3<f64>>> = poses.0.points().chunks(n).map(<[_]>::to_vec).collect();
    let found = core_extent(&poses, &cameras.cameras, cameras.unit, layout.as_ref());
    let Some(found) = found else { return Ok(None) };
    let out = PyDict::new(py);
    out.set_item("extent", found.extent)?;
    out.set_item("taller", found.taller)?;
    out.set_item("limit_mm", found.limit_mm)?;
    out.set_item("unit", cameras.unit.name())?;
    Ok(Some(out))
}

//! `refine`, for one frame or many.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use skelsplat_core::study::outcome::JointStatus;
use skelsplat_core::study::unit::{Unit, implausible_extent as core_extent};
use skelsplat_core::{Frame, Method, Progress, Refinement, Refiner, refine_batch};

use crate::args::{Array, Cameras, Frames, array_out, layout};
use crate::config::config;
use crate::errors::{OrRaise, invalid};
use crate::watch::{self, watched};

/// Statuses in the order of the codes that `refine` returns.
pub(crate) const JOINT_STATUS: [JointStatus; 3] =
    [JointStatus::Ok, JointStatus::Weak, JointStatus::Unobserved];

/// Least standard deviation of a start: the inverse of its square is still far from the end of a double.
const FINEST: f64 = 1e-15;

/// Cameras, layout and settings, prepared once for any number of frames.
///
/// Raises
/// ------
/// InvalidInputError
///     No camera, an unknown layout, settings that do not fit the cameras.
#[pyclass(frozen, module = "skelsplat._skelsplat", name = "Refiner")]
pub(crate) struct PyRefiner(Arc<Refiner>);

#[pymethods]
impl PyRefiner {
    #[new]
    #[pyo3(signature = (cameras, *, layout=None, config=None))]
    fn new(
        py: Python<'_>,
        cameras: &Bound<'_, PyAny>,
        layout: Option<&Bound<'_, PyAny>>,
        config: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let (layout, config) = (self::layout(layout)?, self::config(config)?);
        let cameras = Cameras::new(cameras)?;
        let refiner = Refiner::new(&cameras.cameras, cameras.unit, layout.as_ref(), config);
        refiner.map(|refiner| Self(Arc::new(refiner))).or_raise(py)
    }

    /// Return the fields of ``skelsplat.Refinement``; ``joint_status`` as codes into ``JOINT_STATUS``.
    ///
    /// ``past`` says that ``init_pose`` is the pose of the frame before.
    #[pyo3(signature = (init_pose, detections, *, confidence=None, init_sigma=None, past=false, progress=None))]
    #[allow(clippy::too_many_arguments, reason = "one per keyword")]
    fn refine<'py>(
        &self,
        py: Python<'py>,
        init_pose: Option<&Bound<'py, PyAny>>,
        detections: &Bound<'py, PyAny>,
        confidence: Option<&Bound<'py, PyAny>>,
        init_sigma: Option<&Bound<'py, PyAny>>,
        past: bool,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let mut frames = Frames::new(detections, confidence)?;
        let poses = initial_poses(init_pose, &frames)?;
        let covariances = initial_covariances(init_sigma, &frames)?;
        let jobs: Vec<Frame> = std::mem::take(&mut frames.frames)
            .into_iter()
            .zip(poses)
            .zip(covariances)
            .map(|((detections, init_pose), init_covariance)| Frame {
                detections,
                init_pose,
                init_covariance,
                past,
            })
            .collect();
        let done = match jobs.as_slice() {
            [_] => self.one(py, &frames, jobs)?,
            _ => self.many(py, jobs, progress)?,
        };
        results(py, &frames, &done)
    }
}

impl PyRefiner {
    fn one(&self, py: Python<'_>, frames: &Frames, jobs: Vec<Frame>) -> PyResult<Vec<Refinement>> {
        let config = self.0.config();
        let steps = match &config.method {
            Method::Annealed(_) => Some(1),
            Method::Paper(_) if config.draws_pixels() => None,
            Method::Paper(settings) => Some(settings.max_steps),
        };
        let short = steps.is_some_and(|n| watch::is_short(n, frames.n_views, frames.n_joints));
        let refiner = Arc::clone(&self.0);
        watch::run(py, short, move |progress| refine_batch(&refiner, &jobs, progress))
    }

    fn many(
        &self,
        py: Python<'_>,
        jobs: Vec<Frame>,
        report: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Vec<Refinement>> {
        let (progress, total) = (Arc::new(Progress::default()), jobs.len());
        let tell = || match report.filter(|r| !r.is_none()) {
            Some(report) => report.call1((progress.done(), total)).map(|_| ()),
            None => Ok(()),
        };
        let refiner = Arc::clone(&self.0);
        watched(py, &progress, tell, move |progress| refine_batch(&refiner, &jobs, progress))
    }
}

/// The initial pose of every frame, `None` where it is to be triangulated.
fn initial_poses(
    init_pose: Option<&Bound<'_, PyAny>>,
    frames: &Frames,
) -> PyResult<Vec<Option<Vec<Vector3<f64>>>>> {
    let Some(given) = init_pose.filter(|p| !p.is_none()) else {
        return Ok(vec![None; frames.count]);
    };
    let n = frames.n_joints;
    let shape: Vec<Option<usize>> = frames.shape(&[n, 3]).into_iter().map(Some).collect();
    let expected = match frames.batch {
        true => format!("({}, {n}, 3), as the detections", frames.count),
        false => format!("({n}, 3), as the detections"),
    };
    let poses = Array::of_shape("init_pose", given, &shape, &expected)?;
    let points = poses.bounded(given.py(), "init_pose", ", or NaN for none")?.points();
    Ok(points.chunks(n.max(1)).map(|p| Some(p.to_vec())).collect())
}

/// Covariances of the initial pose of every frame, from standard deviations or covariances.
fn initial_covariances(
    init_sigma: Option<&Bound<'_, PyAny>>,
    frames: &Frames,
) -> PyResult<Vec<Option<Vec<Matrix3<f64>>>>> {
    let (t, n) = (frames.count, frames.n_joints);
    let Some(given) = init_sigma.filter(|s| !s.is_none()) else { return Ok(vec![None; t]) };
    let py = given.py();
    let array = Array::new("init_sigma", given)?.bounded(py, "init_sigma", ", or NaN for none")?;
    let is_sigma = |s: &f64| s.is_nan() || (*s > 0.0 && s.is_finite());
    if array.shape.len() < 2
        && let Some((j, sigma)) = array.values().iter().enumerate().find(|(_, s)| !is_sigma(s))
    {
        let name = if array.shape.is_empty() { String::new() } else { format!("[{j}]") };
        let expected = "a positive finite standard deviation, or NaN for none";
        return Err(invalid(py, &format!("init_sigma{name}"), expected, sigma.to_string()));
    }
    let fine = |s: &f64| *s > 0.0 && *s < FINEST;
    if array.shape.len() < 2
        && let Some(sigma) = array.values().iter().find(|s| fine(s))
    {
        let expected = format!("standard deviations of at least {FINEST:e}");
        return Err(invalid(py, "init_sigma", &expected, format!("{sigma:e}")));
    }
    let isotropic = |sigma: &f64| Matrix3::from_diagonal_element(sigma * sigma);
    let covariances: Vec<Matrix3<f64>> = match array.shape.as_slice() {
        [] => vec![isotropic(&array.values()[0]); n],
        [k] if *k == n => array.values().iter().map(isotropic).collect(),
        [k, 3, 3] if *k == n => array.matrices(),
        [f, k, 3, 3] if frames.batch && *f == t && *k == n => array.matrices(),
        _ => {
            let frames = if frames.batch { format!(" or ({t}, {n}, 3, 3)") } else { String::new() };
            let expected = format!("() for a number, ({n},), ({n}, 3, 3){frames}");
            return Err(array
                .expect(py, "init_sigma", &expected, false)
                .err()
                .unwrap_or_else(|| invalid(py, "init_sigma", &expected, "another shape")));
        }
    };
    let valid = |c: &Matrix3<f64>| {
        let symmetric = (c - c.transpose()).amax() <= 1e-6 * c.amax();
        let finite = c.iter().all(|v| v.is_finite());
        c.iter().any(|v| v.is_nan()) || (finite && symmetric && c.cholesky().is_some())
    };
    if let Some(k) = covariances.iter().position(|c| !valid(c)) {
        let at =
            if covariances.len() == n { format!("{k}") } else { format!("{}, {}", k / n, k % n) };
        let expected = "a symmetric positive definite covariance, or NaN for none";
        return Err(invalid(py, &format!("init_sigma[{at}]"), expected, "one that is not"));
    }
    Ok((0..t)
        .map(|f| {
            let of_frame = if covariances.len() == n { 0..n } else { f * n..(f + 1) * n };
            Some(covariances[of_frame].to_vec())
        })
        .collect())
}

/// The arrays of `Refinement`, with the leading T if there was one.
fn results<'py>(
    py: Python<'py>,
    frames: &Frames,
    done: &[Refinement],
) -> PyResult<Bound<'py, PyDict>> {
    let (m, n) = (frames.n_views, frames.n_joints);
    let scalars = frames.shape(&[]);
    let points = |f: fn(&Refinement) -> &[Vector3<f64>]| {
        let values = gathered(done, 3 * n, |r, out| {
            f(r).iter().for_each(|p| out.extend_from_slice(p.as_slice()));
        });
        array_out(py, values, &frames.shape(&[n, 3]))
    };
    // Symmetric: columns are rows.
    let matrices = |f: fn(&Refinement) -> &[Matrix3<f64>]| {
        let values = gathered(done, 9 * n, |r, out| {
            f(r).iter().for_each(|c| out.extend_from_slice(c.as_slice()));
        });
        array_out(py, values, &frames.shape(&[n, 3, 3]))
    };
    let by_view = |f: fn(&Refinement) -> &[f64]| {
        let values = gathered(done, m * n, |r, out| out.extend_from_slice(f(r)));
        array_out(py, values, &frames.shape(&[m, n]))
    };
    let each = |f: fn(&Refinement) -> f64| array_out(py, done.iter().map(f).collect(), &scalars);
    let out = PyDict::new(py);
    out.set_item("pose", points(|r| &r.pose)?)?;
    out.set_item("init_pose", points(|r| &r.init_pose)?)?;
    out.set_item("covariance", matrices(|r| &r.covariance)?)?;
    out.set_item("uncertainty", matrices(|r| &r.uncertainty)?)?;
    out.set_item("view_weights", by_view(|r| &r.view_weights)?)?;
    out.set_item("reprojection_error", by_view(|r| &r.reprojection_error)?)?;
    let swapped = gathered(done, m * n, |r, out| out.extend_from_slice(&r.swapped));
    out.set_item("swapped", array_out(py, swapped, &frames.shape(&[m, n]))?)?;
    out.set_item("noise", each(|r| r.noise)?)?;
    let codes = done.iter().flat_map(|r| r.joint_status.iter().map(|s| *s as u8)).collect();
    out.set_item("joint_status", array_out(py, codes, &frames.shape(&[n]))?)?;
    out.set_item("loss", each(|r| r.loss.total)?)?;
    out.set_item("loss_render", each(|r| r.loss.render)?)?;
    out.set_item("loss_symmetry", each(|r| r.loss.symmetry)?)?;
    let steps = done.iter().map(|r| r.n_iter as i64).collect();
    out.set_item("n_iter", array_out(py, steps, &scalars)?)?;
    let reasons: Vec<&str> = done.iter().map(|r| r.stop_reason.name()).collect();
    out.set_item("stop_reason", reasons)?;
    out.set_item("loss_history", history(py, frames, done)?)?;
    Ok(out)
}

/// `size` values of every frame, side by side.
fn gathered<T>(
    done: &[Refinement],
    size: usize,
    take: impl Fn(&Refinement, &mut Vec<T>),
) -> Vec<T> {
    let mut values = Vec::with_capacity(done.len() * size);
    done.iter().for_each(|r| take(r, &mut values));
    values
}

/// Total loss per step, `(..., steps)`, NaN after the last step of a frame; no steps unless asked for.
fn history<'py>(
    py: Python<'py>,
    frames: &Frames,
    done: &[Refinement],
) -> PyResult<crate::geometry::Doubles<'py>> {
    let steps = done.iter().map(|r| r.loss_history.len()).max().unwrap_or(0);
    let padded = |r: &Refinement| -> Vec<f64> {
        let told = r.loss_history.iter().map(|l| l.total);
        told.chain(std::iter::repeat(f64::NAN)).take(steps).collect()
    };
    array_out(py, done.iter().flat_map(padded).collect(), &frames.shape(&[steps]))
}

/// Return a sentence if the skeletons (T, N, 3) are taller than 10 m or shorter than 10 cm, else None.
///
/// With a layout of one's own the limits are 20 m and 1 mm.
#[pyfunction]
#[pyo3(signature = (poses, unit, *, layout=None))]
pub(crate) fn implausible_extent(
    py: Python<'_>,
    poses: &Bound<'_, PyAny>,
    unit: &str,
    layout: Option<&Bound<'_, PyAny>>,
) -> PyResult<Option<String>> {
    let unit = Unit::by_name(unit).or_raise(py)?;
    let layout = self::layout(layout)?;
    let array = Array::of_shape("poses", poses, &[None, None, Some(3)], "(T, N, 3)")?;
    let n = array.shape[1];
    let poses: Vec<Vec<Vector3<f64>>> =
        array.points().chunks(n.max(1)).map(<[_]>::to_vec).collect();
    Ok(core_extent(&poses, unit, layout.as_ref()))
}

//! Images and the loss with its gradient, for study and tests.

use nalgebra::{Matrix3, Vector2, Vector3, Vector4};
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use skelsplat_core::study::paper::render::{self as core, Images};
use skelsplat_core::study::paper::splat::Splat;
use skelsplat_core::study::paper::{Encoding, PaperSettings};
use skelsplat_core::study::projection::View;
use skelsplat_core::{Control, Gaussian, Refiner};

use crate::args::{Array, Cameras, Frames, array_out, points_out, type_name};
use crate::camera::Camera;
use crate::errors::{OrRaise, invalid};
use crate::geometry::gaussians;
use crate::watch;

/// Pixels that are drawn within a tenth of a second.
const SHORT_PIXELS: u64 = 50_000_000;

/// Largest logarithm of a standard deviation: e⁵⁰ mm is 500 light years.
const FARTHEST_LOG_SCALE: f64 = 50.0;
/// Below this the square of a quaternion's norm can be lost.
const ZERO_QUATERNION: f64 = 1e-100;

type Image<'py> = Bound<'py, PyArrayDyn<f32>>;

fn images_out<'py>(py: Python<'py>, images: Images) -> PyResult<Image<'py>> {
    let [w, h] = images.size.map(|s| s as usize);
    array_out(py, images.values, &[images.channels, h, w])
}

/// Whether even splats that cover the whole image are drawn within a tenth of a second.
fn is_short(encoding: Encoding, n_joints: usize, size: [u32; 2]) -> bool {
    let drawn = n_joints.max(encoding.channels(n_joints)) as u64;
    drawn.saturating_mul(u64::from(size[0]) * u64::from(size[1])) <= SHORT_PIXELS
}

fn view(camera: &Bound<'_, PyAny>) -> PyResult<View> {
    match camera.cast::<Camera>() {
        Ok(camera) => Ok(View::new(&camera.get().0)),
        Err(_) => Err(invalid(camera.py(), "camera", "a Camera", type_name(camera))),
    }
}

/// Splat of each Gaussian in `view` with its depth.
fn splats(
    view: &View,
    means: &[Vector3<f64>],
    covariances: &[Matrix3<f64>],
) -> Vec<Option<(Splat, f64)>> {
    let dilation = PaperSettings::default().dilation;
    let one = |(mean, covariance): (&Vector3<f64>, &Matrix3<f64>)| {
        let p = view.project(mean, covariance, dilation)?;
        Some((Splat::new(p.mean, &p.covariance, view.size)?, p.in_camera.z))
    };
    means.iter().zip(covariances).map(one).collect()
}

/// Render Gaussians (N, 3), (N, 3, 3) as float32 images.
///
/// (N, H, W) for ``"one_hot"``, (3, H, W) for ``"rgb"``, (1, H, W) for ``"single"``; ideal pixels.
/// Images that do not fit into memory raise ``MemoryError``.
#[pyfunction]
#[pyo3(signature = (means, covariances, camera, *, encoding="one_hot"))]
pub(crate) fn render<'py>(
    py: Python<'py>,
    means: &Bound<'py, PyAny>,
    covariances: &Bound<'py, PyAny>,
    camera: &Bound<'py, PyAny>,
    encoding: &str,
) -> PyResult<Image<'py>> {
    let encoding = Encoding::by_name(encoding).or_raise(py)?;
    let (means, covariances) = gaussians(means, covariances)?;
    let view = view(camera)?;
    let short = is_short(encoding, means.len(), view.size);
    let images = watch::run(py, short, move |progress| {
        let splats = splats(&view, &means, &covariances);
        core::render(&splats, encoding, view.size, progress.cancelled())
    })?;
    images_out(py, images)
}

/// Draw the heat maps of detections (N, 2|3), ideal pixels, with the shapes of the given Gaussians.
///
/// Same shape of result as ``render``; the channel of a missing detection is zero.
#[pyfunction]
#[pyo3(signature = (detections, means, covariances, camera, *, encoding="one_hot"))]
pub(crate) fn pseudo_ground_truth<'py>(
    py: Python<'py>,
    detections: &Bound<'py, PyAny>,
    means: &Bound<'py, PyAny>,
    covariances: &Bound<'py, PyAny>,
    camera: &Bound<'py, PyAny>,
    encoding: &str,
) -> PyResult<Image<'py>> {
    let encoding = Encoding::by_name(encoding).or_raise(py)?;
    let (means, covariances) = gaussians(means, covariances)?;
    let view = view(camera)?;
    let array = Array::new("detections", detections)?;
    let n = means.len();
    let ok = matches!(array.shape.as_slice(), [m, 2 | 3] if *m == n);
    let array =
        array.expect(py, "detections", &format!("({n}, 2) or ({n}, 3), one per mean"), ok)?;
    let array = array.bounded(py, "detections", ", or NaN where missing")?;
    let (values, channels) = (array.values().to_vec(), array.shape[1]);
    let short = is_short(encoding, n, view.size);
    let images = watch::run(py, short, move |progress| {
        let shapes = splats(&view, &means, &covariances).into_iter();
        let each = values.chunks_exact(channels).zip(shapes);
        let heats: Vec<_> = each.map(|(d, shape)| heat(d, shape?.0, view.size)).collect();
        core::pseudo_ground_truth(&heats, encoding, view.size, progress.cancelled())
    })?;
    images_out(py, images)
}

/// The shape of a projected Gaussian at detection `d` = (u, v[, confidence]), if it is there.
fn heat(d: &[f64], shape: Splat, size: [u32; 2]) -> Option<Splat> {
    let there = d[0].is_finite() && d[1].is_finite() && d.get(2).is_none_or(|c| *c > 0.0);
    let covariance = shape.conic.try_inverse().filter(|_| there)?;
    Splat::new(Vector2::new(d[0], d[1]), &covariance, size)
}

/// Fields of ``skelsplat.LossAndGradient``.
#[pyfunction]
#[pyo3(signature = (means, log_scales, quaternions, detections, cameras, *, layout=None, config=None, target_means=None, target_covariances=None))]
#[allow(clippy::too_many_arguments, reason = "the settled interface, all but five by keyword")]
pub(crate) fn loss_and_gradient<'py>(
    py: Python<'py>,
    means: &Bound<'py, PyAny>,
    log_scales: &Bound<'py, PyAny>,
    quaternions: &Bound<'py, PyAny>,
    detections: &Bound<'py, PyAny>,
    cameras: &Bound<'py, PyAny>,
    layout: Option<&Bound<'py, PyAny>>,
    config: Option<&Bound<'py, PyAny>>,
    target_means: Option<&Bound<'py, PyAny>>,
    target_covariances: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyDict>> {
    let gaussians = parameters(means, log_scales, quaternions)?;
    let targets = match (target_means, target_covariances) {
        (Some(m), Some(c)) => {
            let (m, c) = self::gaussians(m, c)?;
            Some(m.into_iter().zip(c).collect())
        }
        (None, None) => None,
        _ => {
            let expected = "both target_means and target_covariances, or neither";
            return Err(invalid(py, "target_means", expected, "only one of them"));
        }
    };
    let (frames, cameras) = (Frames::new(detections, None)?, Cameras::new(cameras)?);
    if frames.batch {
        return Err(invalid(py, "detections", "one frame (M, N, 2|3)", "several frames"));
    }
    let refiner = Refiner::new(
        &cameras.cameras,
        cameras.unit,
        crate::args::layout(layout)?.as_ref(),
        crate::config::config(config)?,
    )
    .or_raise(py)?;
    let n = gaussians.len();
    let found = watch::run(py, false, move |progress| {
        let control = Control { cancel: progress.cancelled(), ..Control::default() };
        refiner.loss_and_gradient(&gaussians, &frames.frames[0], targets, control)
    })?;
    let (loss, gradient) = (found.loss, found.gradient);
    let out = PyDict::new(py);
    out.set_item("loss", loss.total)?;
    out.set_item("render", loss.render)?;
    out.set_item("symmetry", loss.symmetry)?;
    let d_means: Vec<_> = gradient.iter().map(|g| g.mean).collect();
    let d_log_scales: Vec<_> = gradient.iter().map(|g| g.log_scales).collect();
    let d_quaternions = gradient.iter().flat_map(|g| <[f64; 4]>::from(g.quaternion)).collect();
    out.set_item("d_means", points_out(py, &d_means, &[n, 3])?)?;
    out.set_item("d_log_scales", points_out(py, &d_log_scales, &[n, 3])?)?;
    out.set_item("d_quaternions", array_out(py, d_quaternions, &[n, 4])?)?;
    Ok(out)
}

fn parameters(
    means: &Bound<'_, PyAny>,
    log_scales: &Bound<'_, PyAny>,
    quaternions: &Bound<'_, PyAny>,
) -> PyResult<Vec<Gaussian>> {
    let py = means.py();
    let means = Array::of_shape("means", means, &[None, Some(3)], "(N, 3)")?;
    let means = means.bounded(py, "means", "")?;
    let n = means.shape[0];
    let shape = |k| [Some(n), Some(k)];
    let scales =
        Array::of_shape("log_scales", log_scales, &shape(3), &format!("({n}, 3), one per mean"))?;
    let turns =
        Array::of_shape("quaternions", quaternions, &shape(4), &format!("({n}, 4), one per mean"))?;
    let turns = turns.bounded(py, "quaternions", "")?;
    let is_far = |s: &f64| s.is_finite() && s.abs() > FARTHEST_LOG_SCALE;
    if let Some(k) = scales.values().iter().position(is_far) {
        let name = format!("log_scales[{}, {}]", k / 3, k % 3);
        let expected = format!("a value within ±{FARTHEST_LOG_SCALE}");
        return Err(invalid(py, &name, &expected, scales.values()[k].to_string()));
    }
    let is_zero = |q: &[f64]| q.iter().all(|v| v.abs() < ZERO_QUATERNION);
    if let Some(j) = turns.values().chunks_exact(4).position(is_zero) {
        let name = format!("quaternions[{j}]");
        return Err(invalid(py, &name, "a quaternion (w, x, y, z) that is not zero", "zeros"));
    }
    let rest = scales.points().into_iter().zip(turns.values().chunks_exact(4));
    let join = |(mean, (log_scales, q)): (_, (_, &[f64]))| Gaussian {
        mean,
        log_scales,
        quaternion: Vector4::from_column_slice(q),
    };
    Ok(means.points().into_iter().zip(rest).map(join).collect())
}

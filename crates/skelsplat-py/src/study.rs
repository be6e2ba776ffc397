//! Gaussians, their images, and the loss with its gradient, for study and tests.

use std::sync::atomic::AtomicBool;

use nalgebra::{Matrix3, Vector2, Vector3, Vector4};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use skelsplat_core::Result as CoreResult;
use skelsplat_core::study::annealed::Rays;
use skelsplat_core::study::annealed::evidence::evidence_at;
use skelsplat_core::study::annealed::places::against_bones;
use skelsplat_core::study::annealed::solver::solution_at;
use skelsplat_core::study::annealed::views::factors;
use skelsplat_core::study::bones::{Bone, Length};
use skelsplat_core::study::gaussian::{Gaussian, GaussianGradient, check_covariances};
use skelsplat_core::study::paper::Encoding;
use skelsplat_core::study::paper::render::{self as core, DepthSplat, Images};
use skelsplat_core::study::projection::View;
use skelsplat_core::study::rig::Placed;
use skelsplat_core::study::rig::adjust::equations as rig_step;
use skelsplat_core::study::sequence::noise::{DetectionNoise, Kernel};
use skelsplat_core::study::sequence::{equations, solver::Common};
use skelsplat_core::{Frame, PaperSettings};

use crate::args::{
    Array, Covariances, InitPose, Keypoints, LogScales, Means, Out, Poses, Quaternions,
    TargetCovariances, TargetMeans,
};
use crate::camera::{Camera, Cameras};
use crate::config::RefineConfig;
use crate::detections::Frames;
use crate::errors::{Result, refuse};
use crate::geometry::in_every_view;
use crate::layout::Layout;
use crate::refine::refiner;
use crate::watch;

/// Number of pixels that are rendered within a tenth of a second.
const SHORT_PIXELS: u64 = 50_000_000;

const ONE_PER_MEAN: &str = ", one per mean";

/// Mean and covariance of each joint.
type Shapes = Vec<(Vector3<f64>, Matrix3<f64>)>;

/// Gaussians with these means `(N, 3)` and covariances `(N, 3, 3)`.
fn shapes(means: &Array, covariances: Array) -> Result<Shapes> {
    let array = covariances.of(&[means.shape[0], 3, 3], ONE_PER_MEAN)?;
    let covariances = array.matrices();
    check_covariances(array.name, &covariances)?;
    Ok(means.points().into_iter().zip(covariances).collect())
}

/// Gaussians with these means `(N, 3)`, logarithms of scales `(N, 3)` and quaternions `(N, 4)`.
fn gaussians(means: &Array, scales: Array, turns: Array) -> Result<Vec<Gaussian>> {
    let n = means.shape[0];
    let (scales, turns) = (scales.of(&[n, 3], ONE_PER_MEAN)?, turns.of(&[n, 4], ONE_PER_MEAN)?);
    let rest = scales.points().into_iter().zip(turns.values.chunks_exact(4));
    let join = |(mean, (log_scales, q)): (_, (_, &[f64]))| Gaussian {
        mean,
        log_scales,
        quaternion: Vector4::from_column_slice(q),
    };
    let gaussians: Vec<_> = means.points().into_iter().zip(rest).map(join).collect();
    Gaussian::check(&gaussians)?;
    Ok(gaussians)
}

/// Project Gaussians (N, 3), (N, 3, 3) to ideal pixels: means (M, N, 2), covariances (M, N, 2, 2).
///
/// Σ² = J W Σ Wᵀ Jᵀ + h·I (paper §3, supplement A); NaN behind a camera.
#[pyfunction]
pub(crate) fn project_gaussians(
    py: Python<'_>,
    means: Means,
    covariances: Covariances,
    cameras: Cameras,
) -> Result<(Out<f64>, Out<f64>)> {
    let shapes = shapes(&means.0, covariances.0)?;
    let (m, n, dilation) = (cameras.cameras.len(), shapes.len(), PaperSettings::default().dilation);
    let projected = move |view: &View, (mean, covariance): &(Vector3<f64>, Matrix3<f64>)| {
        let p = view.project(mean, covariance, dilation);
        p.map_or([f64::NAN; 6], |p| {
            let (u, s) = (p.mean, p.covariance);
            [u.x, u.y, s[(0, 0)], s[(0, 1)], s[(1, 0)], s[(1, 1)]]
        })
    };
    let views = cameras.cameras.iter().map(View::new).collect();
    let found = in_every_view(py, views, shapes, projected)?;
    let pixels = found.iter().flat_map(|p| [p[0], p[1]]).collect();
    let spreads = found.iter().flat_map(|p| [p[2], p[3], p[4], p[5]]).collect();
    Ok((Out(pixels, vec![m, n, 2]), Out(spreads, vec![m, n, 2, 2])))
}

/// Applies `draw` to the splat of each Gaussian in the camera, with its depth.
fn images(
    py: Python<'_>,
    shapes: Shapes,
    camera: &Camera,
    encoding: Encoding,
    draw: impl FnOnce(&[DepthSplat], [u32; 2], &AtomicBool) -> CoreResult<Images> + Send + 'static,
) -> Result<Out<f32>> {
    let view = View::new(&camera.0);
    // At this size even splats that cover the whole image are rendered within a tenth of a second.
    let drawn = shapes.len().max(encoding.channels(shapes.len())) as u64;
    let pixels = u64::from(view.size[0]) * u64::from(view.size[1]);
    let short = drawn.saturating_mul(pixels) <= SHORT_PIXELS;
    let dilation = PaperSettings::default().dilation;
    let images = watch::run(py, short, move |progress| {
        draw(&core::splats(&view, &shapes, dilation), view.size, progress.cancelled())
    })?;
    let [w, h] = images.size.map(|s| s as usize);
    Ok(Out(images.values, vec![images.channels, h, w]))
}

/// Render Gaussians (N, 3), (N, 3, 3) as float32 images.
///
/// (N, H, W) for ``"one_hot"``, (3, H, W) for ``"rgb"``, (1, H, W) for ``"single"``; ideal pixels.
/// Raises ``MemoryError`` if the images do not fit into memory.
#[pyfunction]
#[pyo3(signature = (means, covariances, camera, *, encoding="one_hot"))]
pub(crate) fn render(
    py: Python<'_>,
    means: Means,
    covariances: Covariances,
    camera: Camera,
    encoding: &str,
) -> Result<Out<f32>> {
    let encoding = Encoding::by_name(encoding)?;
    let shapes = shapes(&means.0, covariances.0)?;
    images(py, shapes, &camera, encoding, move |splats, size, cancelled| {
        core::render(splats, encoding, size, cancelled)
    })
}

/// Render heat maps of detections (N, 2|3), ideal pixels, with the shapes of the given Gaussians.
///
/// The result has the same shape as that of ``render``; the channel of a missing detection is zero.
#[pyfunction]
#[pyo3(signature = (detections, means, covariances, camera, *, encoding="one_hot"))]
pub(crate) fn pseudo_ground_truth(
    py: Python<'_>,
    detections: Keypoints,
    means: Means,
    covariances: Covariances,
    camera: Camera,
    encoding: &str,
) -> Result<Out<f32>> {
    let encoding = Encoding::by_name(encoding)?;
    let shapes = shapes(&means.0, covariances.0)?;
    let (n, given) = (shapes.len(), detections.0);
    let ok = given.shape == [n, 2] || given.shape == [n, 3];
    let given = given.shaped(ok, &format!("({n}, 2) or ({n}, 3), one per mean"))?;
    // Missing: a confidence of 0 or a pixel that is not finite.
    let pixel = |d: &[f64]| {
        let there = d[0].is_finite() && d[1].is_finite() && d.get(2).is_none_or(|c| *c > 0.0);
        there.then(|| Vector2::new(d[0], d[1]))
    };
    let pixels: Vec<_> = given.values.chunks_exact(given.shape[1]).map(pixel).collect();
    images(py, shapes, &camera, encoding, move |splats, size, cancelled| {
        let heats = core::heats(splats, &pixels, size);
        core::pseudo_ground_truth(&heats, encoding, size, cancelled)
    })
}

/// Return the fields of ``skelsplat.LossAndGradient``.
#[pyfunction]
#[pyo3(signature = (
    means, log_scales, quaternions, detections, cameras, *, layout=None, config=None,
    target_means=None, target_covariances=None
))]
#[allow(clippy::too_many_arguments, reason = "the settled interface, all but five by keyword")]
pub(crate) fn loss_and_gradient<'py>(
    py: Python<'py>,
    means: Means,
    log_scales: LogScales,
    quaternions: Quaternions,
    detections: Frames,
    cameras: Cameras,
    layout: Option<Layout>,
    config: Option<RefineConfig>,
    target_means: Option<TargetMeans>,
    target_covariances: Option<TargetCovariances>,
) -> Result<Bound<'py, PyDict>> {
    let gaussians = gaussians(&means.0, log_scales.0, quaternions.0)?;
    let targets = match (target_means, target_covariances) {
        (Some(means), Some(covariances)) => Some(shapes(&means.0, covariances.0)?),
        (None, None) => None,
        _ => {
            let expected = "both target_means and target_covariances, or neither";
            return refuse("target_means", expected, "only one of them");
        }
    };
    let given = detections.only()?;
    let refiner = refiner(&cameras, layout, config)?;
    let n = gaussians.len();
    let found = watch::run(py, false, move |progress| {
        refiner.loss_and_gradient(&gaussians, &given, targets, progress.cancelled())
    })?;
    let rows = |of: fn(&GaussianGradient) -> Vector3<f64>| {
        Out::points(&found.gradient.iter().map(of).collect::<Vec<_>>(), vec![n, 3])
    };
    let turns = found.gradient.iter().flat_map(|g| <[f64; 4]>::from(g.quaternion)).collect();
    let out = PyDict::new(py);
    out.set_item("loss", found.loss.total)?;
    out.set_item("render", found.loss.render)?;
    out.set_item("symmetry", found.loss.symmetry)?;
    out.set_item("d_means", rows(|g| g.mean))?;
    out.set_item("d_log_scales", rows(|g| g.log_scales))?;
    out.set_item("d_quaternions", Out(turns, vec![n, 4]))?;
    Ok(out)
}

/// Return H (3NT, 3NT), gradient (N, T, 3) and density of the acceleration (N, T) of a step in
/// time; noise (N, M) and its factors (M, T) that the poses show.
///
/// It is that of ``refine_sequence`` at ``poses`` (T, N, 3). ``lengths``: mean and σ of every limb,
/// mm; ``joints``: variance of a detection (mm²) and kernel (mm) of every joint. Densities are
/// mm²/s³.
#[pyfunction]
#[pyo3(signature = (poses, detections, cameras, *, fps, lengths, joints, layout=None, config=None))]
#[allow(clippy::too_many_arguments, reason = "what a step depends on")]
pub(crate) fn sequence_equations(
    poses: Poses,
    detections: Frames,
    cameras: Cameras,
    fps: f64,
    lengths: Vec<[f64; 2]>,
    joints: Vec<[f64; 2]>,
    layout: Option<Layout>,
    config: Option<RefineConfig>,
) -> Result<Vec<Out<f64>>> {
    let (t, m, n) = (poses.0.shape[0], cameras.cameras.len(), poses.0.shape[1]);
    let refiner = refiner(&cameras, layout, config)?;
    let frames: Vec<Frame> = detections.detections()?.into_iter().map(Frame::from).collect();
    let given = poses.0.points();
    let points = (0..n * t).map(|k| given[k % t * n + k / t]).collect();
    let common = Common {
        fps,
        bones: Vec::new(),
        lengths: lengths
            .iter()
            .map(|[mean, sigma]| Length { mean: *mean, sigma: *sigma })
            .collect(),
        process_noise: Vec::new(),
        noise: DetectionNoise {
            confidence: vec![1.0; m],
            variance: joints.iter().flat_map(|j| vec![j[0]; m]).collect(),
            kernel: Kernel { sigma: joints.iter().map(|j| j[1]).collect(), ..Kernel::default() },
            ..DetectionNoise::default()
        },
        reach: 1.0,
    };
    let (hessian, pulls, q, noise, factors) = equations(&refiner, &frames, points, common, 1.0)?;
    let gradient: Vec<Vector3<f64>> = pulls.iter().map(|pull| -pull).collect();
    let of_step = [Out(hessian, vec![3 * n * t; 2]), Out::points(&gradient, vec![n, t, 3])];
    let shown = [Out(q, vec![n, t]), Out(noise.variance, vec![n, m]), Out(factors, vec![m, t])];
    Ok(of_step.into_iter().chain(shown).collect())
}

/// Return S (8 M, 8 M), s (8 M,) and the cost of the equations of ``adjust_cameras``, joints
/// eliminated.
///
/// ``points`` (T, N, 3), mm, under kernels of ``sigma`` mm; ``clocks`` of the cameras, in frames.
/// Every camera has turn, shift, logarithm of the focal length and clock, in this order.
#[pyfunction]
#[pyo3(signature = (points, detections, cameras, *, clocks, sigma))]
pub(crate) fn rig_equations(
    points: Poses,
    detections: Frames,
    cameras: Cameras,
    clocks: Vec<f64>,
    sigma: f64,
) -> Result<(Out<f64>, Out<f64>, f64)> {
    let placed = cameras.cameras.into_iter().zip(clocks);
    let placed: Vec<Placed> = placed.map(|(camera, clock)| Placed { camera, clock }).collect();
    let q = 8 * placed.len();
    let found = rig_step(&placed, &detections.detections()?, points.0.points(), sigma)?;
    let matrix = found.matrix.transpose().as_slice().to_vec();
    let gradient = found.gradient.as_slice().to_vec();
    Ok((Out(matrix, vec![q, q]), Out(gradient, vec![q]), found.cost))
}

/// The evidence for a pose in mm and its bones (joint, joint, length, σ), the share of wrong
/// detections, and factors on the views' weights.
#[pyfunction]
#[pyo3(signature = (pose, detections, cameras, *, noise, widest, bones))]
pub(crate) fn frame_evidence(
    pose: InitPose,
    detections: Frames,
    cameras: Cameras,
    noise: f64,
    widest: f64,
    bones: Vec<(usize, usize, f64, f64)>,
) -> Result<(f64, f64, Option<Vec<f64>>)> {
    let rays = Rays::new(&detections.only()?, &cameras.cameras, &[]);
    let variance = rays.mean_weight() * noise * noise;
    let points = pose.0.points();
    let found = evidence_at(&rays, &points, variance, &[], widest);
    let bone = |(a, b, mean, sigma)| Bone { joints: [a, b], length: Length { mean, sigma } };
    let solution = solution_at(&rays, &points, noise);
    let against = against_bones(bones.into_iter().map(bone), &solution, widest);
    Ok((found.log - against, found.wrong, factors(&rays, &solution)))
}

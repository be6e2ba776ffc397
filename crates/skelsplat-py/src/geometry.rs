//! Projection and initial poses.

use nalgebra::Vector3;
use pyo3::prelude::*;
use skelsplat_core::study::memory;
use skelsplat_core::study::triangulate::Triangulated;
use skelsplat_core::{self as core, Camera, Detections, TriangulationMethod};

use crate::args::{Confidence, Monocular, Out, Points};
use crate::camera::Cameras;
use crate::detections::Frames;
use crate::errors::Result;
use crate::watch;

/// Number of projections that take at most a few milliseconds.
const SHORT_PROJECTIONS: usize = 50_000;

/// Project world points (…, 3) to pixels (M, …, 2), lens distortion included; NaN behind a camera.
///
/// The view axis comes first: a sequence (T, N, 3) gives (M, T, N, 2), while ``refine`` takes (T,
/// M, N, 2); ``project(poses, cameras).swapaxes(0, 1)`` converts.
#[pyfunction]
pub(crate) fn project(py: Python<'_>, points: Points, cameras: Cameras) -> Result<Out<f64>> {
    let Points(array) = points;
    let lead = &array.shape[..array.shape.len() - 1];
    let shape = [&[cameras.cameras.len()], lead, &[2]].concat();
    let project = |c: &Camera, p: &Vector3<f64>| c.project(p).map_or([f64::NAN; 2], Into::into);
    let pixels = in_every_view(py, cameras.cameras, array.points(), project)?;
    Ok(Out(pixels.into_flattened(), shape))
}

/// `each(view, item)` for all items in the first view, then in the next.
pub(crate) fn in_every_view<V: Send + 'static, T: Send + 'static, const K: usize>(
    py: Python<'_>,
    views: Vec<V>,
    items: Vec<T>,
    each: impl Fn(&V, &T) -> [f64; K] + Send + 'static,
) -> Result<Vec<[f64; K]>> {
    let short = views.len().saturating_mul(items.len()) <= SHORT_PROJECTIONS;
    watch::run(py, short, move |progress| {
        let bytes = (views.len() * size_of::<[f64; K]>()) as u128 * items.len() as u128;
        let what = || format!("projections: {} points in {} views", items.len(), views.len());
        memory::check(bytes, what)?;
        let mut out = Vec::with_capacity(views.len() * items.len());
        for view in &views {
            for block in items.chunks(SHORT_PROJECTIONS) {
                progress.check()?;
                out.extend(block.iter().map(|item| each(view, item)));
            }
        }
        Ok(out)
    })
}

/// Triangulated points, and the rejected detections if requested.
#[derive(IntoPyObject)]
pub(crate) enum TriangulatedArrays {
    Points(Out<f64>),
    Both(Out<f64>, Out<bool>),
}

/// Triangulate detections ([T,] M, N, 2|3) to points ([T,] N, 3); NaN with fewer than two views.
///
/// ``"robust"``, the default, starts at the point nearest to all rays of a joint and narrows a
/// Welsch kernel to the frame's noise, so that wrong detections lose their influence. If the views
/// that agree at the end are not a majority, the points between pairs of rays are also tried, each
/// scored by all views. A joint is recovered with up to half of its views wrong if the wrong ones
/// do not agree with each other, and with all but two wrong if only those two agree. If only two
/// views see a joint and they disagree, both are used. Detections with a weight k < ¼ (more than
/// 2.4 σ from the joint) are rejected.
///
/// ``"dlt"`` is confidence-weighted algebraic triangulation. ``"ransac"`` applies it to the largest
/// set of views that agree: of at most 10 pairs of views, the pair with most detections within 20
/// px of its projected point defines the set; if no two views agree, all are used. Every method
/// removes lens distortion first.
///
/// Parameters
/// ----------
/// detections : ([T,] M, N, 2 | 3)
///     Pixels and, in a third channel, confidences; NaN or a confidence of 0 where missing.
/// cameras : CameraRig or sequence of Camera
///     The M cameras; points are in their unit. A plain sequence is in mm. The unit matters only
///     for ``"robust"``, which has a kernel width in mm.
/// method : {"robust", "dlt", "ransac"}
/// confidence : ([T,] M, N), optional
///     Confidences, if detections have no third channel.
/// return_rejected : bool
///     Also return which detections were rejected, ([T,] M, N) bool. ``"dlt"`` rejects none;
///     missing detections do not count as rejected.
///
/// Raises
/// ------
/// InvalidInputError
///     Shapes that do not match, an unknown method, or a confidence outside [0, 1].
#[pyfunction]
#[pyo3(signature = (
    detections, cameras, *, method="robust", confidence=None, return_rejected=false
))]
pub(crate) fn triangulate(
    py: Python<'_>,
    detections: Frames,
    cameras: Cameras,
    method: &str,
    confidence: Option<Confidence>,
    return_rejected: bool,
) -> Result<TriangulatedArrays> {
    let method = TriangulationMethod::by_name(method)?;
    let frames = detections.with(confidence)?;
    frames.expect_views(cameras.cameras.len())?;
    let (given, Cameras { cameras, unit, .. }) = (frames.detections()?, cameras);
    let short = watch::is_short(given.len(), frames.n_views, frames.n_joints);
    let found: Vec<Triangulated> = watch::run(py, short, move |progress| {
        let solve =
            |d| progress.check().and_then(|()| core::triangulate(d, &cameras, unit, method));
        given.iter().map(solve).collect()
    })?;
    let (points, rejected): (Vec<_>, Vec<_>) =
        found.into_iter().map(|t| (t.points, t.rejected)).unzip();
    let points = Out::points(&points.concat(), frames.shape(&[frames.n_joints, 3]));
    let rejected = frames.out(rejected.concat(), &[frames.n_views, frames.n_joints]);
    Ok(if return_rejected {
        TriangulatedArrays::Both(points, rejected)
    } else {
        TriangulatedArrays::Points(points)
    })
}

/// Fuse monocular 3D poses ([T,] V, N, 3) in world coordinates into one pose ([T,] N, 3).
///
/// X_j = Σ_i w_ij X_ij with w_ij ∝ 1 / (mean reprojection error of X_ij over the views that detect
/// j). A pose that is NaN at a joint is ignored there.
#[pyfunction]
pub(crate) fn fuse_monocular(
    py: Python<'_>,
    poses: Monocular,
    detections: Frames,
    cameras: Cameras,
) -> Result<Out<f64>> {
    let (frames, cameras) = (detections, cameras.cameras);
    frames.expect_views(cameras.len())?;
    let (t, n) = (frames.count, frames.n_joints);
    let views = poses.0.shape.iter().rev().nth(2).copied().unwrap_or(0);
    let ok = views > 0 && poses.0.shape == frames.shape(&[views, n, 3]);
    let array = poses.0.shaped(ok, &format!("([T,] views, {n}, 3), as in the detections"))?;
    let (points, given) = (array.points(), frames.detections()?);
    let short = points.len().saturating_mul(cameras.len()) <= SHORT_PROJECTIONS;
    let fused: Vec<Vec<Vector3<f64>>> = watch::run(py, short, move |progress| {
        let fuse = |(d, poses): (&Detections, &[Vector3<f64>])| {
            progress.check()?;
            let poses: Vec<Vec<Vector3<f64>>> = poses.chunks(n).map(<[_]>::to_vec).collect();
            Ok(core::fuse_monocular(&poses, &d.undistorted(&cameras), &cameras))
        };
        given.iter().zip(points.chunks((points.len() / t.max(1)).max(1))).map(fuse).collect()
    })?;
    Ok(Out::points(&fused.concat(), frames.shape(&[n, 3])))
}

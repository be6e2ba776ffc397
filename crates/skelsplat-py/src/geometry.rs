//! Projection and initial poses.

use nalgebra::{Matrix3, Vector3};
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use skelsplat_core::study::memory;
use skelsplat_core::study::paper::PaperSettings;
use skelsplat_core::study::projection::View;
use skelsplat_core::study::triangulate::{Triangulated, fuse_monocular as fuse};
use skelsplat_core::{Camera, Detections, TriangulationMethod, triangulate as by_method};

use crate::args::{Array, Cameras, Frames, array_out, points_out};
use crate::errors::{OrRaise, invalid};
use crate::watch;

/// Points in cameras that are projected within a few milliseconds.
const SHORT_PROJECTIONS: usize = 50_000;

/// Means and covariances, one each per joint.
type MeansAndCovariances = (Vec<Vector3<f64>>, Vec<Matrix3<f64>>);

/// A double array of any shape.
pub(crate) type Doubles<'py> = Bound<'py, PyArrayDyn<f64>>;

/// Project world points (…, 3) to pixels (M, …, 2), lens distortion included; NaN behind a camera.
///
/// The view comes first: a sequence (T, N, 3) gives (M, T, N, 2), while ``refine`` takes (T, M, N, 2), so
/// write ``project(poses, cameras).swapaxes(0, 1)``.
#[pyfunction]
pub(crate) fn project<'py>(
    py: Python<'py>,
    points: &Bound<'py, PyAny>,
    cameras: &Bound<'py, PyAny>,
) -> PyResult<Doubles<'py>> {
    let array = Array::new("points", points)?;
    let ok = array.shape.last() == Some(&3);
    let array = array.expect(py, "points", "(..., 3)", ok)?.bounded(py, "points", "")?;
    let (points, cameras) = (array.points(), Cameras::new(cameras)?.cameras);
    let mut shape = vec![cameras.len()];
    shape.extend(&array.shape);
    *shape.last_mut().unwrap_or(&mut 0) = 2;
    let one = |c: &Camera, p: &Vector3<f64>| c.project(p).map_or([f64::NAN; 2], Into::into);
    let pixels = in_every_view(py, cameras, points, one)?;
    array_out(py, pixels.into_flattened(), &shape)
}

/// `each(view, item)` for all items in the first view, then in the next.
pub(crate) fn in_every_view<V: Send + 'static, T: Send + 'static, const K: usize>(
    py: Python<'_>,
    views: Vec<V>,
    items: Vec<T>,
    each: impl Fn(&V, &T) -> [f64; K] + Send + 'static,
) -> PyResult<Vec<[f64; K]>> {
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

/// Triangulate detections ([T,] M, N, 2|3) to points ([T,] N, 3); NaN with fewer than two views.
///
/// ``"robust"``, the default, starts at the point nearest to all rays of a joint and lets a Welsch kernel
/// narrow to the frame's noise, so that wrong detections lose their pull. Where the views that agree in the
/// end are no majority, points between two rays are judged by all. A joint is right with up to half of its
/// views wrong if those do not agree among themselves, and with all but two wrong if those two agree and
/// nothing else does. Two views that disagree cannot be told apart: both are used. Detections with k < ¼ (2.4
/// σ from the joint) are rejected.
///
/// ``"dlt"`` is confidence-weighted algebraic triangulation. ``"ransac"`` is the same over the largest set of
/// views that agree: of at most 10 pairs of views the one whose point projects within 20 px of most
/// detections decides; where no two views agree, all are used. Every method removes lens distortion first.
///
/// Parameters
/// ----------
/// detections : ([T,] M, N, 2 | 3)
///     Pixels and, in a third channel, confidences; NaN or a confidence of 0 where missing.
/// cameras : CameraRig or sequence of Camera
///     The M cameras; points are in their unit. A plain sequence is in mm. The kernel of ``"robust"`` has a
///     width in mm, so that it has to know the unit; the other methods do not look at it.
/// method : {"robust", "dlt", "ransac"}
/// confidence : ([T,] M, N), optional
///     Instead of a third channel.
/// return_rejected : bool
///     Also return which detections the method left out, ([T,] M, N) bool. ``"dlt"`` rejects none; a missing
///     detection is not rejected.
///
/// Raises
/// ------
/// InvalidInputError
///     Shapes that do not fit, an unknown method, a confidence outside [0, 1].
#[pyfunction]
#[pyo3(signature = (detections, cameras, *, method="robust", confidence=None, return_rejected=false))]
pub(crate) fn triangulate<'py>(
    py: Python<'py>,
    detections: &Bound<'py, PyAny>,
    cameras: &Bound<'py, PyAny>,
    method: &str,
    confidence: Option<&Bound<'py, PyAny>>,
    return_rejected: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let method = TriangulationMethod::by_name(method).or_raise(py)?;
    let mut frames = Frames::new(detections, confidence)?;
    let Cameras { cameras, unit } = Cameras::new(cameras)?;
    frames.expect_views(py, cameras.len())?;
    let given = std::mem::take(&mut frames.frames);
    let short = watch::is_short(given.len(), frames.n_views, frames.n_joints);
    let found: Vec<Triangulated> = watch::run(py, short, move |progress| {
        let one = |d| progress.check().and_then(|()| by_method(d, &cameras, unit, method));
        given.iter().map(one).collect()
    })?;
    let (points, rejected): (Vec<_>, Vec<_>) =
        found.into_iter().map(|t| (t.points, t.rejected)).unzip();
    let points = points_out(py, &points.concat(), &frames.shape(&[frames.n_joints, 3]))?;
    if !return_rejected {
        return Ok(points.into_any());
    }
    let shape = frames.shape(&[frames.n_views, frames.n_joints]);
    let rejected = array_out(py, rejected.concat(), &shape)?;
    Ok((points, rejected).into_pyobject(py)?.into_any())
}

/// Fuse monocular 3D poses ([T,] V, N, 3) given in the world to one pose ([T,] N, 3).
///
/// X_j = Σ_i w_ij X_ij with w_ij ∝ 1 / (mean reprojection error of X_ij over the views that detect j). A pose
/// that is NaN at a joint has no weight there.
#[pyfunction]
pub(crate) fn fuse_monocular<'py>(
    py: Python<'py>,
    poses: &Bound<'py, PyAny>,
    detections: &Bound<'py, PyAny>,
    cameras: &Bound<'py, PyAny>,
) -> PyResult<Doubles<'py>> {
    let (mut frames, cameras) = (Frames::new(detections, None)?, Cameras::new(cameras)?.cameras);
    frames.expect_views(py, cameras.len())?;
    let (t, n) = (frames.frames.len(), frames.n_joints);
    let array = Array::new("poses", poses)?;
    let tail = [n, 3];
    let axes = if frames.batch { 4 } else { 3 };
    let ok = array.shape.len() == axes
        && array.shape.ends_with(&tail)
        && (!frames.batch || array.shape[0] == t)
        && array.shape[axes - 3] > 0;
    let array =
        array.expect(py, "poses", &format!("([T,] views, {n}, 3) as the detections"), ok)?;
    let array = array.bounded(py, "poses", "")?;
    let points = array.points();
    let per_frame = points.len() / t.max(1);
    let given = std::mem::take(&mut frames.frames);
    let short = points.len().saturating_mul(cameras.len()) <= SHORT_PROJECTIONS;
    let fused: Vec<Vec<Vector3<f64>>> = watch::run(py, short, move |progress| {
        let one = |(t, d): (usize, &Detections)| {
            progress.check()?;
            let poses: Vec<Vec<Vector3<f64>>> =
                points[t * per_frame..(t + 1) * per_frame].chunks(n).map(<[_]>::to_vec).collect();
            Ok(fuse(&poses, &d.undistorted(&cameras), &cameras))
        };
        given.iter().enumerate().map(one).collect()
    })?;
    let fused = fused.concat();
    points_out(py, &fused, &frames.shape(&[n, 3]))
}

/// Project Gaussians (N, 3), (N, 3, 3) to means (M, N, 2) and covariances (M, N, 2, 2), ideal pixels.
///
/// Σ² = J W Σ Wᵀ Jᵀ + h·I (paper §3, supplement A); NaN behind a camera.
#[pyfunction]
pub(crate) fn project_gaussians<'py>(
    py: Python<'py>,
    means: &Bound<'py, PyAny>,
    covariances: &Bound<'py, PyAny>,
    cameras: &Bound<'py, PyAny>,
) -> PyResult<(Doubles<'py>, Doubles<'py>)> {
    let (means, covariances) = gaussians(means, covariances)?;
    let cameras = Cameras::new(cameras)?.cameras;
    let (m, n) = (cameras.len(), means.len());
    let dilation = PaperSettings::default().dilation;
    let one = move |view: &View, (mean, covariance): &(Vector3<f64>, Matrix3<f64>)| {
        let p = view.project(mean, covariance, dilation);
        p.map_or([f64::NAN; 6], |p| {
            let (u, s) = (p.mean, p.covariance);
            [u.x, u.y, s[(0, 0)], s[(0, 1)], s[(1, 0)], s[(1, 1)]]
        })
    };
    let views = cameras.iter().map(View::new).collect();
    let found = in_every_view(py, views, means.into_iter().zip(covariances).collect(), one)?;
    let pixels = found.iter().flat_map(|p| [p[0], p[1]]).collect();
    let shapes = found.iter().flat_map(|p| [p[2], p[3], p[4], p[5]]).collect();
    Ok((array_out(py, pixels, &[m, n, 2])?, array_out(py, shapes, &[m, n, 2, 2])?))
}

/// Means `(N, 3)` and covariances `(N, 3, 3)`.
pub(crate) fn gaussians(
    means: &Bound<'_, PyAny>,
    covariances: &Bound<'_, PyAny>,
) -> PyResult<MeansAndCovariances> {
    let py = covariances.py();
    let means = Array::of_shape("means", means, &[None, Some(3)], "(N, 3)")?;
    let means = means.bounded(py, "means", "")?;
    let n = means.shape[0];
    let shape = [Some(n), Some(3), Some(3)];
    let expected = format!("({n}, 3, 3), one per mean");
    let covariances = Array::of_shape("covariances", covariances, &shape, &expected)?;
    let covariances = covariances.bounded(py, "covariances", "")?.matrices();
    let asymmetric = |c: &Matrix3<f64>| {
        c.iter().all(|v| v.is_finite()) && (c - c.transpose()).amax() > 1e-6 * c.amax()
    };
    if let Some(j) = covariances.iter().position(asymmetric) {
        let name = format!("covariances[{j}]");
        return Err(invalid(py, &name, "a symmetric matrix", "one that is not"));
    }
    let least = |c: &Matrix3<f64>| c.symmetric_eigenvalues().min();
    let negative = |c: &Matrix3<f64>| {
        c.iter().all(|v| v.is_finite()) && least(c) < -1e-9 * c.amax().max(f64::MIN_POSITIVE)
    };
    if let Some(j) = covariances.iter().position(negative) {
        let name = format!("covariances[{j}]");
        let actual = format!("a variance of {:.3e}", least(&covariances[j]));
        return Err(invalid(py, &name, "no negative variance", actual));
    }
    Ok((means.points(), covariances))
}

//! Triangulation with a method given by name.

use crate::annealed::consensus::REJECTED;
use crate::annealed::{Annealed, AnnealedFrame, Annealing};
use crate::bones::expected::Expected;
use crate::camera::Camera;
use crate::detections::Detections;
use crate::error::{Error, Result};
use crate::names::named;
use crate::triangulate::{Triangulated, dlt, ransac};
use crate::unit::Unit;

/// A triangulation method.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum TriangulationMethod {
    /// Confidence-weighted algebraic triangulation, [`dlt()`].
    Dlt,
    /// The same over the largest set of views that agree, [`ransac()`].
    Ransac,
    /// Annealed splatting of every joint, [`robust()`].
    Robust,
}

named!("method" TriangulationMethod { Robust: "robust", Dlt: "dlt", Ransac: "ransac" });

/// Triangulates `(M, N)` detections in pixels of the image, lens distortion included, to `N` world
/// points in the `unit` of the cameras. NaN where a joint has no finite answer: see [`dlt()`].
///
/// # Errors
/// [`Error::InvalidInput`] if the number of cameras differs from the detections' number of views.
pub fn triangulate(
    detections: &Detections,
    cameras: &[Camera],
    unit: Unit,
    method: TriangulationMethod,
) -> Result<Triangulated> {
    if detections.n_views() != cameras.len() {
        let expected = format!("one camera for each of the {} views", detections.n_views());
        return Err(Error::invalid("cameras", expected, cameras.len().to_string()));
    }
    let ideal = detections.undistorted(cameras);
    Ok(match method {
        TriangulationMethod::Dlt => {
            let rejected = vec![false; ideal.n_views() * ideal.n_joints()];
            Triangulated { points: dlt(&ideal, cameras), rejected }
        }
        TriangulationMethod::Ransac => ransac(&ideal, cameras),
        TriangulationMethod::Robust => {
            let mm = unit.millimetres();
            let scaled: Vec<Camera> =
                cameras.iter().map(|c| c.clone().with_length_scale(mm)).collect();
            let found = robust(&ideal, &scaled);
            Triangulated { points: found.points.iter().map(|p| p / mm).collect(), ..found }
        }
    })
}

/// Triangulates each joint from ideal pixels, as a frame of which nothing else is known; NaN as
/// [`dlt()`], with fewer than two views or parallel rays.
pub fn robust(detections: &Detections, cameras: &[Camera]) -> Triangulated {
    let frame = AnnealedFrame {
        cameras,
        detections,
        view_weights: &[],
        pairs: &[],
        chains: &[],
        expected: &Expected::default(),
        annealing: Annealing::of_joints(detections.n_joints()),
        before: None,
        in_recording: false,
    };
    let Annealed { outcome, bars, .. } = frame.solve();
    let (m, n) = (cameras.len(), detections.n_joints());
    let rejected = (0..m * n).map(|k| bars.believed[k % n * m + k / n] < REJECTED).collect();
    Triangulated { rejected, points: outcome.points }
}

//! Triangulation with a method given by name.

use crate::annealed::robust;
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

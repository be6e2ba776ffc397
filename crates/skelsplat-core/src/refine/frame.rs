//! What a call refines.

use nalgebra::{Matrix3, Vector3};

use crate::detections::Detections;

/// One frame: detections, and an initial pose `(N)` in the unit of the cameras (`None`:
/// triangulated; a NaN joint is triangulated too).
#[derive(Debug, Clone)]
pub struct Frame {
    /// Detection of each joint in each view.
    pub detections: Detections,
    /// Initial pose.
    pub init_pose: Option<Vec<Vector3<f64>>>,
    /// Covariance `(N)`, unit², of an initial pose that is independent of these detections: the
    /// pose is then used as a prior, not only as a starting point.
    pub init_covariance: Option<Vec<Matrix3<f64>>>,
}

impl From<Detections> for Frame {
    /// A frame without an initial pose.
    fn from(detections: Detections) -> Self {
        Self { detections, init_pose: None, init_covariance: None }
    }
}

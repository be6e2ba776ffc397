//! Initial poses: 3D joints from the detections of several views, by algebra.

pub mod dlt;
pub mod fusion;
pub mod ransac;

use nalgebra::Vector3;

pub use dlt::dlt;
pub use fusion::fuse_monocular;
pub use ransac::ransac;

/// Triangulated joints, and the detections that they do without.
#[derive(Debug, Clone, PartialEq)]
pub struct Triangulated {
    /// `N` world points; NaN where a joint has no finite answer.
    pub points: Vec<Vector3<f64>>,
    /// Whether the method left a detection out, row-major `(M, N)`; `false` where nothing is detected.
    pub rejected: Vec<bool>,
}

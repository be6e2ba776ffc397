//! Initial poses: algebraic triangulation of joints from the detections of several views.

pub mod dlt;
pub mod fusion;
pub mod ransac;

use nalgebra::Vector3;

pub use dlt::dlt;
pub use fusion::fuse_monocular;
pub use ransac::ransac;

/// Triangulated joints, and the rejected detections.
#[derive(Debug, Clone, PartialEq)]
pub struct Triangulated {
    /// `N` world points; NaN where a joint has no finite answer.
    pub points: Vec<Vector3<f64>>,
    /// Whether the method rejected a detection, row-major `(M, N)`; `false` where missing.
    pub rejected: Vec<bool>,
}

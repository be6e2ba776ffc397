//! Triangulation of joints one by one, without a layout.

use super::consensus::REJECTED;
use super::frame::AnnealedFrame;
use super::problem::Annealing;
use crate::bones::expected::Expected;
use crate::camera::Camera;
use crate::detections::Detections;
use crate::triangulate::Triangulated;

/// Triangulates each joint from ideal pixels, as a frame of which nothing else is known; NaN as
/// [`crate::triangulate::dlt()`], with fewer than two views or parallel rays.
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
    };
    let super::Annealed { outcome, bars, .. } = frame.solve();
    let (m, n) = (cameras.len(), detections.n_joints());
    let rejected = (0..m * n).map(|k| bars.believed[k % n * m + k / n] < REJECTED).collect();
    Triangulated { rejected, points: outcome.points }
}

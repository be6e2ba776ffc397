//! Where a search begins: at the points nearest to the rays, at a prior or, for what the detections
//! do not determine, at a given pose.

use nalgebra::Vector3;

use super::depth::may_be_fixed;
use super::problem::Prior;
use super::rays::{Ray, Rays, nearest, there};

/// cos 15°: two rays farther from parallel determine a depth whatever the noise.
const NARROW: f64 = 0.966;

/// Prior knowledge of a pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Before {
    /// The initial pose `(N)`, mm; `None` for a joint without one.
    pub pose: Vec<Option<Vector3<f64>>>,
    /// Priors `(N)`, if the pose is independent of these detections; otherwise it is a
    /// starting point, and decides between explanations that are about as likely.
    pub priors: Option<Vec<Prior>>,
}

/// Whether `x` is in front of a camera that detects it.
fn in_front(rays: &[Ray], x: &Vector3<f64>) -> bool {
    there(rays).any(|ray| ray.offset(x).range > 0.0)
}

/// Whether all rays are within 15° of the first.
pub(super) fn is_narrow(rays: &[Ray]) -> bool {
    let mut rays = there(rays);
    let first = rays.next().map_or_else(Vector3::zeros, |ray| ray.direction);
    rays.all(|ray| ray.direction.dot(&first) > NARROW)
}

/// The point nearest to all rays of joint `j`; NaN if they do not determine it or its depth, or put
/// it behind every camera.
pub fn nearest_to_all(rays: &Rays, j: usize) -> Vector3<f64> {
    let rays = rays.of_joint(j);
    let is_seen = |x: &Vector3<f64>| {
        in_front(rays, x) && (!is_narrow(rays) || may_be_fixed(rays, x, f64::INFINITY))
    };
    let found = nearest(rays, |ray| ray.weight).filter(is_seen);
    found.unwrap_or_else(|| Vector3::repeat(f64::NAN))
}

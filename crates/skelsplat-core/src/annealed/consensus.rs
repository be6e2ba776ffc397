//! Which rays agree on a point, and where two of them meet.

use nalgebra::Vector3;

use super::depth::have_parallax;
use super::rays::{Ray, midpoint, nearest_with_spread};

/// Weight k below which a detection is rejected: |e| above 2.4 σ.
pub const REJECTED: f64 = 0.25;
/// The same as |e|²/σ²: −4 ln k.
const REACH: f64 = 4.0 * std::f64::consts::LN_2 * 2.0;

/// Whether a detection is not rejected at `x`, in front of its camera, under a kernel of standard
/// deviation `sigma`.
#[inline]
pub(super) fn agrees(ray: &Ray, x: &Vector3<f64>, sigma: f64) -> bool {
    let offset = ray.offset(x);
    offset.range > 0.0 && offset.across.norm_squared() <= REACH * sigma * sigma
}

/// `x` after two weighted steps: x itself has converged under the kernel, so its rivals have to
/// converge as well.
pub(super) fn settled(rays: &[Ray], x: Vector3<f64>, sigma: f64) -> Vector3<f64> {
    let step = |x: Vector3<f64>| {
        let weight = |ray: &Ray| ray.weight * ray.offset(&x).weight(sigma);
        nearest_with_spread(rays, weight).map_or(x, |(x, _)| x)
    };
    step(step(x))
}

/// The midpoint of two rays where they pass each other in front of both cameras, if they do so
/// within 2σ and are not too nearly parallel to determine it.
pub(super) fn meeting_point(a: &Ray, b: &Ray, sigma: f64) -> Option<Vector3<f64>> {
    if !have_parallax(a, b) {
        return None;
    }
    let x = midpoint(a, b)?;
    let meets = |ray: &Ray| {
        let offset = ray.offset(&x);
        offset.range > 0.0 && offset.across.norm() <= 2.0 * sigma
    };
    (meets(a) && meets(b)).then_some(x)
}

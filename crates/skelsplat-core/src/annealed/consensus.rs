//! Which rays agree on a point, and where two of them meet.

use nalgebra::Vector3;

use super::depth::have_parallax;
use super::rays::{Ray, meet, nearest};

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
        nearest(rays, weight).unwrap_or(x)
    };
    step(step(x))
}

/// Where two rays meet within 2σ, if they are not too nearly parallel to determine it.
pub(super) fn meeting_point(a: &Ray, b: &Ray, sigma: f64) -> Option<Vector3<f64>> {
    let near = |(x, apart): (Vector3<f64>, f64)| (0.5 * apart <= 2.0 * sigma).then_some(x);
    have_parallax(a, b).then(|| meet(a, b)).flatten().and_then(near)
}

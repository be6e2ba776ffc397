//! Which rays agree on a point, and where two of them meet.

use nalgebra::Vector3;

use super::across::FourViews;
use super::depth::have_parallax;
use super::lanes::{Four, ZERO, added};
use super::rays::{Ray, meet};
use crate::matrix3::ILL_CONDITIONED;

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
pub(super) fn settled(views: &[FourViews], x: Vector3<f64>, sigma: f64) -> Vector3<f64> {
    let quarter = Four::splat(-0.25 / (sigma * sigma));
    let step = |x: Vector3<f64>| x + step(views, &x, quarter);
    step(step(x))
}

/// A weighted step from `x`; none if the rays do not determine it. `quarter` is −1/4σ².
fn step(views: &[FourViews], x: &Vector3<f64>, quarter: Four) -> Vector3<f64> {
    let (mut weight, mut outer, mut pull) = (Four::ZERO, ZERO, [Four::ZERO; 3]);
    for four in views {
        let across = four.across(x);
        let w = four.rays.weight * across.trust(quarter);
        weight += w;
        outer.add_outer(w, &four.rays.direction);
        (0..3).for_each(|a| pull[a] -= w * across.e[a]);
    }
    let information = added(&outer).below(weight.reduce_add(), 1.0, 0.0);
    let (cofactors, scale) = (information.cofactors(), information.trace() / 3.0);
    let determinant = information.determinant(&cofactors);
    if determinant > ILL_CONDITIONED * scale * scale * scale {
        return Vector3::from(cofactors.times(&pull.map(Four::reduce_add))) / determinant;
    }
    Vector3::zeros()
}

/// Where two rays meet within 2σ, if they are not too nearly parallel to determine it.
pub(super) fn meeting_point(a: &Ray, b: &Ray, sigma: f64) -> Option<Vector3<f64>> {
    let near = |(x, apart): (Vector3<f64>, f64)| (0.5 * apart <= 2.0 * sigma).then_some(x);
    have_parallax(a, b).then(|| meet(a, b)).flatten().and_then(near)
}

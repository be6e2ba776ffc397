//! Points between two rays, scored by all rays of a joint.

use nalgebra::Vector3;

use super::depth::have_parallax;
use super::rays::{Ray, midpoint, nearest_point, there};

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
/// Rays paired with all others before testing whether the best point is good enough.
const ANCHORS: usize = 8;
/// Agreement at which the search ends, in rays of the largest weight: three that agree.
const ENOUGH: f64 = 2.5;

/// Σ c k of the rays at `x`, under a kernel of standard deviation `sigma`.
pub fn agreement(rays: &[Ray], x: &Vector3<f64>, sigma: f64) -> f64 {
    there(rays).map(|ray| ray.weight * ray.offset(x).weight(sigma)).sum()
}

/// The point between two rays on which the rays agree most, with its [`agreement`]; `None` if no
/// two meet.
///
/// Eight rays at a time are paired with all others, those farthest from `from` first, and the
/// search ends once three agree: linear in the number of views as long as a fixed share of them is
/// correct, and independent of the order of the views. All pairs are examined only where no three
/// agree.
pub fn best_pair(rays: &[Ray], from: &Vector3<f64>, sigma: f64) -> Option<(Vector3<f64>, f64)> {
    let enough = ENOUGH * rays.iter().map(|ray| ray.weight).fold(0.0, f64::max);
    let off = |ray: &Ray| ray.offset(from).across.norm_squared();
    let mut farthest: Vec<(f64, &Ray)> = there(rays).map(|ray| (off(ray), ray)).collect();
    farthest.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut best: Option<(Vector3<f64>, f64)> = None;
    for (a, (_, first)) in farthest.iter().enumerate() {
        for (_, second) in &farthest[a + 1..] {
            let Some(x) = meeting_point(first, second, sigma) else { continue };
            let agreed = agreement(rays, &x, sigma);
            if best.is_none_or(|(_, most)| agreed > most) {
                best = Some((x, agreed));
            }
        }
        if (a + 1) % ANCHORS == 0 && best.is_some_and(|(_, most)| most >= enough) {
            break;
        }
    }
    best
}

/// `x` after two weighted steps: x itself has converged under the kernel, so its rivals have to
/// converge as well.
pub(super) fn settled(rays: &[Ray], x: Vector3<f64>, sigma: f64) -> Vector3<f64> {
    let step = |x: Vector3<f64>| {
        let weight = |_: usize, ray: &Ray| ray.weight * ray.offset(&x).weight(sigma);
        nearest_point(rays, weight).unwrap_or(x)
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

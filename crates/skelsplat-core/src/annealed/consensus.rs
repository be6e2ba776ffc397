//! Where annealing ends without a majority: points on which two rays agree, judged by all.

use nalgebra::Vector3;

use super::depth::have_parallax;
use super::rays::{Ray, nearest_point};

/// k below which a detection counts as rejected: |e| above 2.4 σ.
pub const REJECTED: f64 = 0.25;
/// Rays that are paired with all others before it is asked whether the best point is good enough.
const ANCHORS: usize = 8;
/// Agreement that is good enough, in rays of the largest weight: three that agree.
const ENOUGH: f64 = 2.5;
/// A point is a rival of another if it has no more than this less agreement, in detections of the joint's mean weight.
const TIE: f64 = 0.5;

/// Σ c k of the rays at `x`, under a kernel of standard deviation `sigma`.
#[must_use]
pub fn agreement(rays: &[Ray], x: &Vector3<f64>, sigma: f64) -> f64 {
    let there = rays.iter().filter(|ray| ray.is_there());
    there.map(|ray| ray.weight * ray.offset(x).weight(sigma)).sum()
}

/// The point between two rays on which the rays agree most, with its [`agreement`]; `None` if no two meet.
///
/// Eight rays at a time are paired with all others, those farthest from `from` first, and the search ends once three agree:
/// linear in the number of views as long as a fixed share of them is right, and the same in whatever order the views
/// come. Only where no three agree all pairs are looked at.
#[must_use]
pub fn best_pair(rays: &[Ray], from: &Vector3<f64>, sigma: f64) -> Option<(Vector3<f64>, f64)> {
    let enough = ENOUGH * rays.iter().map(|ray| ray.weight).fold(0.0, f64::max);
    let mut there: Vec<(f64, &Ray)> = rays
        .iter()
        .filter(|ray| ray.is_there())
        .map(|ray| (ray.offset(from).across.norm_squared(), ray))
        .collect();
    there.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut best: Option<(Vector3<f64>, f64)> = None;
    for (a, (_, first)) in there.iter().enumerate() {
        for (_, second) in &there[a + 1..] {
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

/// The point on which the rays that are rejected at `x` agree as well as the others do at `x`, with its share of the
/// votes: two views that see one place and two that see another leave it open which is right.
#[must_use]
pub fn rival(rays: &[Ray], x: &Vector3<f64>, sigma: f64) -> Option<(Vector3<f64>, f64)> {
    let k = |ray: &Ray| ray.offset(x).weight(sigma);
    let against = |ray: &&Ray| ray.is_there() && k(ray) < REJECTED;
    if rays.iter().filter(against).count() < 2 {
        return None;
    }
    let rejected: Vec<Ray> = rays.iter().filter(against).copied().collect();
    let (y, agreed) = best_pair(&rejected, x, sigma)?;
    let (n, sum) = rays.iter().fold((0.0, 0.0), |(n, sum), ray| {
        (n + f64::from(u8::from(ray.is_there())), sum + ray.weight)
    });
    let here = agreement(rays, x, sigma);
    (agreed >= here - TIE * sum / n).then(|| (y, agreed / (here + agreed)))
}

/// The point between two rays where they pass each other in front of both cameras, if that is within 2σ and the rays are
/// not so nearly parallel that it could be anywhere along them.
fn meeting_point(a: &Ray, b: &Ray, sigma: f64) -> Option<Vector3<f64>> {
    if !have_parallax(a, b) {
        return None;
    }
    let x = nearest_point(&[*a, *b], |_, _| 1.0)?;
    let meets = |ray: &Ray| {
        let offset = ray.offset(&x);
        offset.range > 0.0 && offset.across.norm() <= 2.0 * sigma
    };
    (meets(a) && meets(b)).then_some(x)
}

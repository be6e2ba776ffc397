//! Where annealing ends without a majority: points on which two rays agree, judged by all.

use nalgebra::Vector3;

use super::rays::{Ray, nearest_point};

/// Rays that are paired with all others before it is asked whether the best point is good enough.
const ANCHORS: usize = 8;
/// Agreement that is good enough, in rays of the largest weight: three that agree.
const ENOUGH: f64 = 2.5;

/// Σ c k of the rays at `x`, under a kernel of standard deviation `sigma`.
#[must_use]
pub fn agreement(rays: &[Ray], x: &Vector3<f64>, sigma: f64) -> f64 {
    let there = rays.iter().filter(|ray| ray.is_there());
    there.map(|ray| ray.weight * ray.offset(x).weight(sigma)).sum()
}

/// The point between two rays on which the rays agree most, with its [`agreement`]; `None` if no two meet.
///
/// Eight rays at a time are paired with all others, and the search ends once three agree: linear in the number of views
/// as long as a fixed share of them is right. Only where no three agree all pairs are looked at.
#[must_use]
pub fn best_pair(rays: &[Ray], sigma: f64) -> Option<(Vector3<f64>, f64)> {
    let enough = ENOUGH * rays.iter().map(|ray| ray.weight).fold(0.0, f64::max);
    let mut best: Option<(Vector3<f64>, f64)> = None;
    let mut anchors = 0;
    for (a, first) in rays.iter().enumerate().filter(|(_, ray)| ray.is_there()) {
        for second in rays[a + 1..].iter().filter(|ray| ray.is_there()) {
            let Some(x) = meeting_point(first, second, sigma) else { continue };
            let agreed = agreement(rays, &x, sigma);
            if best.is_none_or(|(_, most)| agreed > most) {
                best = Some((x, agreed));
            }
        }
        anchors += 1;
        if anchors % ANCHORS == 0 && best.is_some_and(|(_, most)| most >= enough) {
            break;
        }
    }
    best
}

/// The point between two rays where they pass each other in front of both cameras, if that is within 2σ.
fn meeting_point(a: &Ray, b: &Ray, sigma: f64) -> Option<Vector3<f64>> {
    let x = nearest_point(&[*a, *b], |_, _| 1.0)?;
    let meets = |ray: &Ray| {
        let offset = ray.offset(&x);
        offset.range > 0.0 && offset.across.norm() <= 2.0 * sigma
    };
    (meets(a) && meets(b)).then_some(x)
}

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
/// A place is a rival of another if it has no more than this less agreement, in detections of the joint's mean weight,
pub const TIE: f64 = 0.5;
/// and this where the past decides between them: two views against two, however well they agree, not two against three.
pub const NEAR_TIE: f64 = 0.9;
/// Places nearer to each other than this multiple of the kernel are one.
const APART: f64 = 4.0;

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

/// Another place that as many views vote for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rival {
    /// Where it is.
    pub at: Vector3<f64>,
    /// Its share of the votes for all places.
    pub share: f64,
}

/// Places on which rays, of which at least one is rejected at `x`, agree as well as the others do at `x`: two views that see
/// one place and two that see another leave it open which is right. As well is `slack` less, see [`TIE`].
#[must_use]
pub fn rivals(rays: &[Ray], x: &Vector3<f64>, sigma: f64, slack: f64) -> Vec<Rival> {
    let against = |ray: &Ray| ray.offset(x).weight(sigma) < REJECTED;
    let there = || rays.iter().filter(|ray| ray.is_there());
    let (mut n, mut sum, mut rejected, mut most) = (0.0, 0.0, 0.0, 0.0_f64);
    for ray in there() {
        (n, sum, most) = (n + 1.0, sum + ray.weight, most.max(ray.weight));
        rejected += if against(ray) { ray.weight } else { 0.0 };
    }
    let here = agreement(rays, x, sigma);
    // Half a detection of two views' votes, a whole one of four's: the more vote, the more may fail by chance.
    let enough = here - (slack * sum / n).max(0.5 * TIE * here);
    // Few rays pass through two places: of those that agree on x two may agree on another as well.
    if rejected == 0.0 || rejected + 2.0 * most < enough {
        return Vec::new();
    }
    let mut places: Vec<Rival> = Vec::new();
    for (a, first) in rays.iter().enumerate().filter(|(_, ray)| ray.is_there()) {
        for second in rays[a + 1..].iter().filter(|ray| ray.is_there()) {
            if !against(first) && !against(second) {
                continue;
            }
            let Some(meeting) = meeting_point(first, second, sigma) else { continue };
            let at = settled(rays, meeting, sigma);
            let share = agreement(rays, &at, sigma);
            if share >= enough && (x - at).norm() > APART * sigma {
                places.push(Rival { at, share });
            }
        }
    }
    // The strongest first, so that it does not matter in which order the views come.
    places.sort_by(|a, b| b.share.total_cmp(&a.share));
    let mut found: Vec<Rival> = Vec::new();
    for place in places {
        if found.iter().all(|other| (other.at - place.at).norm() > APART * sigma) {
            found.push(place);
        }
    }
    let all = here + found.iter().map(|rival| rival.share).sum::<f64>();
    found.iter_mut().for_each(|rival| rival.share /= all);
    found
}

/// `x` after two weighted steps: x itself has come to rest under the kernel, and its rivals have to as well.
fn settled(rays: &[Ray], x: Vector3<f64>, sigma: f64) -> Vector3<f64> {
    let step = |x: Vector3<f64>| {
        let weight = |_: usize, ray: &Ray| ray.weight * ray.offset(&x).weight(sigma);
        nearest_point(rays, weight).unwrap_or(x)
    };
    step(step(x))
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

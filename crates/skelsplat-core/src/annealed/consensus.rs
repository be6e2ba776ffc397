//! Joints for which annealing ends without a majority: candidate points between two rays, scored by
//! all rays.

use nalgebra::Vector3;

use super::depth::have_parallax;
use super::rays::{Ray, midpoint, nearest_point, there};

/// Weight k below which a detection is rejected: |e| above 2.4 σ.
pub const REJECTED: f64 = 0.25;
/// Rays paired with all others before testing whether the best point is good enough.
const ANCHORS: usize = 8;
/// Agreement at which the search ends, in rays of the largest weight: three that agree.
const ENOUGH: f64 = 2.5;
/// A position is a rival of another if it has no more than this less agreement, in detections of
/// the joint's mean weight,
pub const TIE: f64 = 0.5;
/// and this where the past decides between them: two views against two, however well they agree,
/// not two against three.
pub const NEAR_TIE: f64 = 0.9;
/// Positions nearer to each other than this multiple of the kernel are the same.
const APART: f64 = 4.0;

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

/// Another position with as many votes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rival {
    /// Its position.
    pub at: Vector3<f64>,
    /// Its share of the votes for all positions.
    pub share: f64,
}

/// Positions on which rays, at least one of them rejected at `x`, agree as well as the others do at
/// `x`: if two views see one position and two see another, it is undecided which is correct.
/// `slack` is the tolerated difference, see [`TIE`].
pub fn rivals(rays: &[Ray], x: &Vector3<f64>, sigma: f64, slack: f64) -> Vec<Rival> {
    let against = |ray: &Ray| ray.offset(x).weight(sigma) < REJECTED;
    let (mut n, mut sum, mut rejected, mut most) = (0.0, 0.0, 0.0, 0.0_f64);
    for ray in there(rays) {
        (n, sum, most) = (n + 1.0, sum + ray.weight, most.max(ray.weight));
        rejected += if against(ray) { ray.weight } else { 0.0 };
    }
    let here = agreement(rays, x, sigma);
    // Half a detection for two votes, a whole one for four: the more votes, the more may fail by
    // chance.
    let enough = here - (slack * sum / n).max(0.5 * TIE * here);
    // Few rays pass through two positions: of those that agree on x, two may agree on another as
    // well.
    if rejected == 0.0 || rejected + 2.0 * most < enough {
        return Vec::new();
    }
    let mut places: Vec<Rival> = Vec::new();
    for (a, first) in rays.iter().enumerate().filter(|(_, ray)| ray.is_there()) {
        for second in there(&rays[a + 1..]) {
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
    // The strongest first, so that the order of the views does not matter.
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

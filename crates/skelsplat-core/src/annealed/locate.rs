//! The joints of a frame one by one: annealed splatting of each, and pairs of rays where that ends
//! without a majority.

use nalgebra::Vector3;

use super::consensus::{REJECTED, agreement, best_pair};
use super::depth::{have_parallax, may_be_fixed};
use super::evidence::evidence;
use super::noise::NoiseModel;
use super::rays::{Ray, Rays, nearest_with_spread, there};
use super::solver::{Annealing, Problem, Solution, Widening, solve};
use crate::camera::Camera;
use crate::detections::Detections;
use crate::statistics::median;
use crate::triangulate::Triangulated;

/// Number of views by which the agreeing ones have to outnumber the others to be a majority.
const MAJORITY: f64 = 0.25;
/// Agreement by which a pair's point has to exceed the annealed one's, in detections of the joint's
/// mean weight.
const MARGIN: f64 = 0.5;
/// The same with three views, of which any two outvote the third by chance.
const MARGIN_OF_THREE: f64 = 0.75;
/// Largest distance of a wrong detection, in multiples of the widest kernel.
const ANYWHERE: f64 = 1.0;
/// The same where no joint is seen by three views, so that it is impossible to tell which detection
/// is wrong.
const ANYWHERE_OF_PAIRS: f64 = 1.5;
/// cos 15°.
const NARROW: f64 = 0.966;
/// Rays this far from parallel, 15° for two, determine a depth whatever the noise.
const WIDE: f64 = 0.05;
/// Fraction of a large noise within which two views may agree by chance; closer agreement means
/// both show the same person.
const AGREES: f64 = 0.2;
/// Joints that two views have to share for that; five agree by chance in one of a hundred frames.
const LEAST_COMMON: usize = 6;
/// Minimum number of residuals for an estimate of the noise.
const LEAST_FREEDOM: f64 = 6.0;

/// Triangulates each joint from ideal pixels; NaN as [`crate::triangulate::dlt()`], with fewer than
/// two views or parallel rays.
///
/// A joint starts at the point nearest to all its rays and is annealed down to the noise of the
/// frame (see `annealed/mod.rs`). Where the views that agree at the end are not a majority, points
/// between two rays are also scored ([`best_pair`]). The cost is linear in the number of views as
/// long as a fixed share of them is correct. Where the noise is too large for the final kernel,
/// wider ones are tried ([`evidence`]).
pub fn robust(detections: &Detections, cameras: &[Camera]) -> Triangulated {
    let rays = Rays::new(detections, cameras, &[]);
    let solution = locate(&rays, &Annealing::of_joints(detections.n_joints())).solution;
    let (m, n) = (cameras.len(), detections.n_joints());
    let rejected = (0..m * n).map(|k| {
        let (ray, x) = (&rays.of_joint(k % n)[k / n], &solution.points[k % n]);
        ray.is_there() && ray.offset(x).weight(solution.sigma[k % n]) < REJECTED
    });
    Triangulated { rejected: rejected.collect(), points: solution.points }
}

/// Joints located from their detections alone.
#[derive(Debug, Clone)]
pub struct Located {
    /// Their positions.
    pub solution: Solution,
    /// Whether the kernels followed the noise.
    pub widening: Widening,
    /// [`Solution::noise`] under the configured kernels.
    pub narrow_noise: f64,
}

/// The joints of one frame without priors and symmetry.
///
/// The noise is estimated under a kernel, so a final kernel narrower than twice the noise
/// underestimates it. Where the estimate requires a wider one, the frame is solved again under
/// kernels that follow the noise; that solution is used if it makes the detections more likely
/// ([`evidence`]).
pub fn locate(rays: &Rays, annealing: &Annealing) -> Located {
    if !annealing.per_noise.is_finite() {
        return located(rays, annealing, Widening::NONE);
    }
    if annealing.noise != NoiseModel::Estimated {
        return located(rays, annealing, Widening::FREE);
    }
    let narrow = located(rays, annealing, Widening::NONE);
    if annealing.per_noise * narrow.narrow_noise < annealing.base {
        return narrow;
    }
    let mut wide = located(rays, annealing, Widening::FREE);
    let anywhere = anywhere(rays, annealing);
    if wide.narrow_noise > annealing.start || views_agree(rays, AGREES * wide.narrow_noise) {
        return narrow;
    }
    let now = evidence(rays, &wide.solution, None, anywhere);
    if now.log <= evidence(rays, &narrow.solution, None, anywhere).log {
        return narrow;
    }
    wide.widening.noise_share = (1.0 - now.wrong) * of_few(rays);
    Located { narrow_noise: narrow.narrow_noise, ..wide }
}

/// Whether any two views agree on the joints to a noise of `sigma`, mm: by the median distance of
/// their rays, which for normal noise is 0.6745 · √2 σ. Two views of the same person do, whatever
/// the others show.
fn views_agree(rays: &Rays, sigma: f64) -> bool {
    let m = rays.n_views();
    (0..m).flat_map(|a| (a + 1..m).map(move |b| (a, b))).any(|(a, b)| {
        let distance = |j: usize| {
            let (a, b) = (&rays.of_joint(j)[a], &rays.of_joint(j)[b]);
            let normal = a.direction.cross(&b.direction);
            (a.is_there() && b.is_there() && have_parallax(a, b))
                .then(|| (b.centre - a.centre).dot(&normal).abs() / normal.norm())
        };
        let distances: Vec<f64> = (0..rays.n_joints()).filter_map(distance).collect();
        distances.len() >= LEAST_COMMON && median(distances) < 0.6745 * 2.0_f64.sqrt() * sigma
    })
}

/// Assumed maximum distance of wrong detections of a frame, mm.
pub fn anywhere(rays: &Rays, annealing: &Annealing) -> f64 {
    annealing.start * if can_outvote(rays) { ANYWHERE } else { ANYWHERE_OF_PAIRS }
}

/// Whether three views see any joint, so that two of them can outvote the third.
fn can_outvote(rays: &Rays) -> bool {
    let views = |j: usize| there(rays.of_joint(j)).count();
    (0..rays.n_joints()).any(|j| views(j) > 2)
}

/// Factor on the squares of error bars for a noise estimated from few residuals: the variance of
/// Student's t. Two views leave one residual per joint, three views three.
fn of_few(rays: &Rays) -> f64 {
    let freedom = rays.n_joints() as f64;
    if can_outvote(rays) || freedom < LEAST_FREEDOM { 1.0 } else { freedom / (freedom - 2.0) }
}

fn located(rays: &Rays, annealing: &Annealing, widening: Widening) -> Located {
    let solution = under(rays, annealing, widening);
    Located { narrow_noise: solution.noise, solution, widening }
}

/// Anneals every joint from least squares down to its final kernel, or from a better position if
/// there is one.
fn under(rays: &Rays, annealing: &Annealing, widening: Widening) -> Solution {
    let problem = Problem { rays, pairs: &[], bones: &[], priors: None, annealing, widening };
    let n = rays.n_joints();
    let start: Vec<Vector3<f64>> = (0..n).map(|j| nearest_to_all(rays, j)).collect();
    let mut solution = solve(&problem, &start, &vec![f64::INFINITY; n]);
    if reconsider(rays, &mut solution) {
        let steps = solution.n_iter;
        solution = solve(&problem, &solution.points, &solution.sigma);
        solution.n_iter += steps;
    }
    for j in 0..n {
        let of_joint = rays.of_joint(j);
        let (x, sigma) = (&solution.points[j], solution.sigma[j]);
        // The remaining rays may be parallel because others contradict them: then all rays are
        // tested.
        let agrees = |ray: &Ray| ray.is_there() && ray.offset(x).weight(sigma) >= REJECTED;
        let two = of_joint.iter().filter(|ray| agrees(ray)).count() > 1;
        let sigma = if two { sigma } else { f64::INFINITY };
        if is_narrow(of_joint) && !may_be_fixed(of_joint, x, sigma) {
            solution.points[j] = Vector3::repeat(f64::NAN);
        }
    }
    solution
}

/// Whether all rays are within 15° of the first.
fn is_narrow(rays: &[Ray]) -> bool {
    let mut rays = there(rays);
    let first = rays.next().map_or_else(Vector3::zeros, |ray| ray.direction);
    rays.all(|ray| ray.direction.dot(&first) > NARROW)
}

/// The point nearest to all rays of joint `j`. If a detection that is far off puts it behind every
/// camera or leaves it without a depth, the point between two rays on which most agree. NaN if the
/// rays do not determine it or its depth.
pub fn nearest_to_all(rays: &Rays, j: usize) -> Vector3<f64> {
    let of_joint = rays.of_joint(j);
    let nan = Vector3::repeat(f64::NAN);
    let Some((x, spread)) = nearest_with_spread(of_joint, |_, ray| ray.weight) else { return nan };
    let in_front = of_joint.iter().any(|ray| ray.is_there() && ray.offset(&x).range > 0.0);
    if in_front && (spread > WIDE || may_be_fixed(of_joint, &x, f64::INFINITY)) {
        return x;
    }
    if there(of_joint).count() < 3 {
        return nan;
    }
    let pair = best_pair(of_joint, &x, Annealing::END).map(|(x, _)| x);
    pair.filter(|x| may_be_fixed(of_joint, x, Annealing::END)).unwrap_or(nan)
}

/// Moves joints without a majority to the point on which more detections agree; returns whether any
/// has moved.
fn reconsider(rays: &Rays, solution: &mut Solution) -> bool {
    let mut moved = false;
    for j in 0..rays.n_joints() {
        let of_joint = rays.of_joint(j);
        let views = there(of_joint).count() as f64;
        let support = solution.residuals[j].support;
        if views < 3.0 || support >= 0.5 * views + MAJORITY {
            continue;
        }
        let mean = of_joint.iter().map(|ray| ray.weight).sum::<f64>() / views;
        let sigma = solution.sigma[j];
        let margin = if views < 4.0 { MARGIN_OF_THREE } else { MARGIN };
        let enough = agreement(of_joint, &solution.points[j], sigma) + margin * mean;
        if let Some((x, _)) =
            best_pair(of_joint, &solution.points[j], sigma).filter(|(_, agreed)| *agreed > enough)
        {
            solution.points[j] = x;
            moved = true;
        }
    }
    moved
}

//! The joints of a frame one by one: annealed splatting of each, and pairs of rays where it ends without a majority.

use nalgebra::Vector3;

use super::consensus::{REJECTED, agreement, best_pair};
use super::depth::{have_parallax, may_be_fixed};
use super::evidence::evidence;
use super::noise::NoiseModel;
use super::rays::{Ray, Rays, nearest_with_spread};
use super::solver::{Annealing, Problem, Solution, Widening, solve};
use crate::camera::Camera;
use crate::detections::Detections;
use crate::triangulate::Triangulated;

/// Views by which the agreeing ones have to outnumber the others to be a majority.
const MAJORITY: f64 = 0.25;
/// Agreement by which a pair's point has to exceed the annealed one's, in detections of the joint's mean weight: with three
/// views, of which any two outvote the third by chance, and with more.
const MARGIN: [f64; 2] = [0.75, 0.5];
/// How far off a wrong detection may be, in multiples of the widest kernel: where no joint is seen by three views, so that
/// nothing says which detection is wrong, and otherwise.
const ANYWHERE: [f64; 2] = [1.5, 1.0];
/// cos 15°.
const NARROW: f64 = 0.966;
/// Rays that are this far from parallel, 15° for two, fix a depth whatever the noise.
const WIDE: f64 = 0.05;
/// Part of a large noise to which two views may agree: less is no chance, but the person whom both show.
const AGREES: f64 = 0.2;
/// Joints that two views have to share for that; five agree by chance in a frame of a hundred.
const LEAST_COMMON: usize = 6;
/// Residuals that say something of the noise.
const LEAST_FREEDOM: f64 = 6.0;

/// Triangulates each joint from ideal pixels; NaN as [`crate::triangulate::dlt()`], with fewer than two views or parallel rays.
///
/// A joint begins at the point nearest to all its rays and is annealed down to the noise of the frame (see
/// [`crate::annealed`]). Where the views that agree in the end are no majority, the points between two rays are judged
/// too ([`best_pair`]). The cost is linear in the number of views as long as a fixed share of them is right. Where the
/// noise is too large for the final kernel, wider ones are tried ([`evidence`]).
#[must_use]
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

/// Joints that are placed by their detections alone.
#[derive(Debug, Clone)]
pub struct Located {
    /// Where they are.
    pub solution: Solution,
    /// Whether the kernels followed the noise.
    pub widening: Widening,
    /// [`Solution::noise`] under the configured kernels.
    pub narrow_noise: f64,
}

/// The joints of one frame without priors and symmetry.
///
/// The noise is estimated under a kernel, so that a kernel that ends narrower than twice the noise sees less of it than
/// there is. Where the estimate asks for a wider one, the frame is solved again under kernels that follow the noise, which
/// count if the detections are then more likely ([`evidence`]).
#[must_use]
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

/// Whether any two views agree on the joints to a noise of `sigma`, mm: by the median distance of their rays, which for
/// normal noise is 0.6745 · √2 σ. Two views of one person do, whatever the others show.
fn views_agree(rays: &Rays, sigma: f64) -> bool {
    let mut distances = Vec::with_capacity(rays.n_joints());
    let m = rays.n_views();
    (0..m).flat_map(|a| (a + 1..m).map(move |b| (a, b))).any(|(a, b)| {
        distances.clear();
        for j in 0..rays.n_joints() {
            let (a, b) = (&rays.of_joint(j)[a], &rays.of_joint(j)[b]);
            if a.is_there() && b.is_there() && have_parallax(a, b) {
                let normal = a.direction.cross(&b.direction);
                distances.push((b.centre - a.centre).dot(&normal).abs() / normal.norm());
            }
        }
        distances.sort_by(f64::total_cmp);
        let enough = distances.len() >= LEAST_COMMON;
        enough && distances[distances.len() / 2] < 0.6745 * 2.0_f64.sqrt() * sigma
    })
}

/// How far off wrong detections of a frame are taken to be, mm.
#[must_use]
pub fn anywhere(rays: &Rays, annealing: &Annealing) -> f64 {
    annealing.start * ANYWHERE[usize::from(can_outvote(rays))]
}

/// Whether three views see any joint, so that two of them can say that the third is wrong.
fn can_outvote(rays: &Rays) -> bool {
    let views = |j: usize| rays.of_joint(j).iter().filter(|ray| ray.is_there()).count();
    (0..rays.n_joints()).any(|j| views(j) > 2)
}

/// What it adds to the squares of error bars that the noise is known from few residuals: the variance of Student's t.
/// Two views leave one residual of a joint, three views three.
fn of_few(rays: &Rays) -> f64 {
    let freedom = rays.n_joints() as f64;
    if can_outvote(rays) || freedom < LEAST_FREEDOM { 1.0 } else { freedom / (freedom - 2.0) }
}

fn located(rays: &Rays, annealing: &Annealing, widening: Widening) -> Located {
    let solution = under(rays, annealing, widening);
    Located { narrow_noise: solution.noise, solution, widening }
}

/// Every joint from least squares down to its final kernel, and from a better place if there is one.
fn under(rays: &Rays, annealing: &Annealing, widening: Widening) -> Solution {
    let problem = Problem { rays, pairs: &[], priors: None, annealing, widening };
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
        // Rays that contradict each other are not parallel for that: then all of them are asked.
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
    let mut there = rays.iter().filter(|ray| ray.is_there());
    let first = there.next().map_or_else(Vector3::zeros, |ray| ray.direction);
    there.all(|ray| ray.direction.dot(&first) > NARROW)
}

/// The point nearest to all rays of joint `j`. A detection that is far off can leave that behind every camera, or without a
/// depth: then it is the point between two rays on which most agree. NaN if the rays leave it or its depth open.
#[must_use]
pub fn nearest_to_all(rays: &Rays, j: usize) -> Vector3<f64> {
    let of_joint = rays.of_joint(j);
    let nan = Vector3::repeat(f64::NAN);
    let Some((x, spread)) = nearest_with_spread(of_joint, |_, ray| ray.weight) else { return nan };
    let in_front = of_joint.iter().any(|ray| ray.is_there() && ray.offset(&x).range > 0.0);
    if in_front && (spread > WIDE || may_be_fixed(of_joint, &x, f64::INFINITY)) {
        return x;
    }
    if of_joint.iter().filter(|ray| ray.is_there()).count() < 3 {
        return nan;
    }
    let pair = best_pair(of_joint, &x, Annealing::END).map(|(x, _)| x);
    pair.filter(|x| may_be_fixed(of_joint, x, Annealing::END)).unwrap_or(nan)
}

/// Moves joints without a majority to the point on which more detections agree; whether any has moved.
fn reconsider(rays: &Rays, solution: &mut Solution) -> bool {
    let mut moved = false;
    for j in 0..rays.n_joints() {
        let of_joint = rays.of_joint(j);
        let views = of_joint.iter().filter(|ray| ray.is_there()).count() as f64;
        let support = solution.residuals[j].support;
        if views < 3.0 || support >= 0.5 * views + MAJORITY {
            continue;
        }
        let mean = of_joint.iter().map(|ray| ray.weight).sum::<f64>() / views;
        let sigma = solution.sigma[j];
        let margin = if views < 4.0 { MARGIN[0] } else { MARGIN[1] };
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

//! Robust triangulation: annealed splatting of every joint on its own, and pairs of rays where it ends without a majority.

use nalgebra::Vector3;

use super::Triangulated;
use crate::annealed::consensus::{REJECTED, agreement, best_pair};
use crate::annealed::depth::may_be_fixed;
use crate::annealed::evidence::evidence;
use crate::annealed::rays::nearest_point;
use crate::annealed::{Annealing, NoiseModel, Problem, Rays, Solution, solve};
use crate::camera::Camera;
use crate::detections::Detections;

/// Views by which the agreeing ones have to outnumber the others to be a majority.
const MAJORITY: f64 = 0.25;
/// Agreement by which a pair's point has to exceed the annealed one's, in detections of the joint's mean weight: with three
/// views, of which any two outvote the third by chance, and with more.
const MARGIN: [f64; 2] = [0.75, 0.5];

/// Triangulates each joint from ideal pixels; NaN as [`super::dlt()`], with fewer than two views or parallel rays.
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

/// Joints that are placed by their detections alone, and the factor by which their kernels may exceed the configured ones.
#[derive(Debug, Clone)]
pub struct Located {
    /// Where they are.
    pub solution: Solution,
    /// [`Problem::widening`].
    pub widening: f64,
}

/// The widest that the final kernels become, in multiples of [`Annealing::start`].
const WIDEST: f64 = 4.0;

/// The joints of one frame without priors and symmetry.
///
/// The noise is estimated under a kernel, so that a kernel that ends narrower than twice the noise sees less of it than
/// there is. Where the estimate asks for a wider one the ends are doubled as long as the detections are more likely so.
#[must_use]
pub fn locate(rays: &Rays, annealing: &Annealing) -> Located {
    let follows = annealing.per_noise.is_finite();
    let known = annealing.noise != NoiseModel::Estimated;
    let widening = if known && follows { f64::INFINITY } else { 1.0 };
    let mut best = Located { solution: under(rays, annealing, widening), widening };
    if known || !follows {
        return best;
    }
    let mut likely = None;
    while annealing.per_noise * best.solution.noise >= annealing.base * best.widening
        && annealing.base * best.widening < WIDEST * annealing.start
    {
        let widening = 2.0 * best.widening;
        let wider = under(rays, annealing, widening);
        let before = likely.unwrap_or_else(|| evidence(rays, &best.solution, annealing.start));
        let now = evidence(rays, &wider, annealing.start);
        if now <= before {
            break;
        }
        (best, likely) = (Located { solution: wider, widening }, Some(now));
    }
    best
}

/// [`locate`] with kernels that may exceed the configured ones by the factor `widening`.
fn under(rays: &Rays, annealing: &Annealing, widening: f64) -> Solution {
    let problem = Problem { rays, pairs: &[], priors: None, annealing, widening };
    let start = (0..rays.n_joints()).map(|j| start(rays, j)).collect();
    let mut solution = solve(&problem, start, vec![f64::INFINITY; rays.n_joints()]);
    if reconsider(rays, &mut solution) {
        let steps = solution.n_iter;
        solution = solve(&problem, solution.points, solution.sigma);
        solution.n_iter += steps;
    }
    solution
}

/// The point nearest to all rays of joint `j`; NaN if they leave it or its depth open, or it lies behind every camera.
#[must_use]
pub fn start(rays: &Rays, j: usize) -> Vector3<f64> {
    let of_joint = rays.of_joint(j);
    nearest_point(of_joint, |_, ray| ray.weight)
        .filter(|x| of_joint.iter().any(|ray| ray.is_there() && ray.offset(x).range > 0.0))
        .filter(|x| may_be_fixed(of_joint, x))
        .unwrap_or_else(|| Vector3::repeat(f64::NAN))
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
        if let Some((x, _)) = best_pair(of_joint, &solution.points[j], sigma)
            .filter(|(_, agreed)| *agreed > enough)
        {
            solution.points[j] = x;
            moved = true;
        }
    }
    moved
}

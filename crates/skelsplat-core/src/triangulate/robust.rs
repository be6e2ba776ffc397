//! Robust triangulation: annealed splatting of every joint on its own, and pairs of rays where it ends without a majority.

use nalgebra::Vector3;

use super::Triangulated;
use crate::annealed::consensus::{agreement, best_pair};
use crate::annealed::rays::nearest_point;
use crate::annealed::{Annealing, Problem, Rays, Solution, solve};
use crate::camera::Camera;
use crate::detections::Detections;

/// k below which a detection counts as rejected: |e| above 2.4 σ.
pub const REJECTED: f64 = 0.25;
/// Views by which the agreeing ones have to outnumber the others to be a majority.
const MAJORITY: f64 = 0.25;
/// Agreement by which a pair's point has to exceed the annealed one's, in detections of the joint's mean weight: with three
/// views, of which any two outvote the third by chance, and with more.
const MARGIN: [f64; 2] = [0.75, 0.5];

/// Triangulates each joint from ideal pixels; NaN as [`super::dlt()`], with fewer than two views or parallel rays.
///
/// A joint begins at the point nearest to all its rays and is annealed down to the noise of the frame (see
/// [`crate::annealed`]). Where the views that agree in the end are no majority, the points between two rays are judged
/// too ([`best_pair`]). The cost is linear in the number of views as long as a fixed share of them is right.
#[must_use]
pub fn robust(detections: &Detections, cameras: &[Camera]) -> Triangulated {
    let rays = Rays::new(detections, cameras, &[]);
    let solution = locate(&rays, &Annealing::of_joints(detections.n_joints()));
    let (m, n) = (cameras.len(), detections.n_joints());
    let rejected = (0..m * n).map(|k| {
        let (ray, x) = (&rays.of_joint(k % n)[k / n], &solution.points[k % n]);
        ray.is_there() && ray.offset(x).weight(solution.sigma[k % n]) < REJECTED
    });
    Triangulated { rejected: rejected.collect(), points: solution.points }
}

/// The joints of one frame without priors and symmetry.
#[must_use]
pub fn locate(rays: &Rays, annealing: &Annealing) -> Solution {
    let problem = Problem { rays, pairs: &[], priors: None, annealing };
    let start = (0..rays.n_joints()).map(|j| start(rays, j)).collect();
    let mut solution = solve(&problem, start, vec![f64::INFINITY; rays.n_joints()]);
    if reconsider(rays, &mut solution) {
        let steps = solution.n_iter;
        solution = solve(&problem, solution.points, solution.sigma);
        solution.n_iter += steps;
    }
    solution
}

/// The point nearest to all rays of joint `j`; NaN if they leave it open or it lies behind every camera.
#[must_use]
pub fn start(rays: &Rays, j: usize) -> Vector3<f64> {
    let of_joint = rays.of_joint(j);
    nearest_point(of_joint, |_, ray| ray.weight)
        .filter(|x| of_joint.iter().any(|ray| ray.is_there() && ray.offset(x).range > 0.0))
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
        if let Some((x, _)) = best_pair(of_joint, sigma).filter(|(_, agreed)| *agreed > enough) {
            solution.points[j] = x;
            moved = true;
        }
    }
    moved
}

//! The default method for one frame: annealed splatting by Gauss–Newton.

use nalgebra::{Matrix3, Vector3};

use super::objective::Loss;
use super::refiner::{Frame, Refiner};
use super::result::{JointStatus, Refinement, StopReason};
use super::starts::{Given, Start};
use crate::annealed::consensus::{REJECTED, TIE, agreement, rivals};
use crate::annealed::depth::is_fixed;
use crate::annealed::evidence::evidence;
use crate::annealed::swaps;
use crate::annealed::{
    Annealing, NoiseModel, Prior, Problem, Ray, Rays, Solution, Widening, solve,
};
use crate::detections::Detections;
use crate::symmetry::{LimbPair, symmetry};
use crate::triangulate::robust::{anywhere, locate};
use crate::uncertainty::posterior;

/// What follows from residuals alone, in the unit of the cameras.
pub(super) struct ErrorBars {
    pub(super) uncertainty: Vec<Matrix3<f64>>,
    pub(super) view_weights: Vec<f64>,
    pub(super) noise: f64,
    pub(super) status: Vec<JointStatus>,
}

/// A solution for one assignment of left and right.
struct Found {
    rays: Rays,
    init: Vec<Vector3<f64>>,
    solution: Solution,
    widening: Widening,
}

/// Rounds of looking for exchanged sides.
const SWAP_ROUNDS: usize = 3;
/// Detections of mean weight that an exchange has to explain more after the pose was solved again.
const SWAP_GAIN: f64 = 1.0;
/// Logarithm of the odds that an exchange has to reach where the noise is large: there are a few dozen to choose from.
const SWAP_EVIDENCE: f64 = 10.0;

impl Found {
    /// Whether a joint that `other` locates has no position here.
    fn loses_against(&self, other: &Self) -> bool {
        let (here, there) = (&self.solution.points, &other.solution.points);
        here.iter().zip(there).any(|(x, y)| x.x.is_nan() && y.x.is_finite())
    }

    /// Whether an exchange is worth it: in detections that are explained, and where the noise is large, so that chance
    /// explains some, in the likelihood of all.
    fn explains_more(&self, before: &Self, given: &Given<'_>) -> bool {
        let likely = |found: &Self| {
            let anywhere = anywhere(&found.rays, &given.annealing);
            evidence(&found.rays, &found.solution, given.priors, anywhere).log
        };
        self.explained() > before.explained() + SWAP_GAIN
            && (!before.widening.follows_noise || likely(self) > likely(before) + SWAP_EVIDENCE)
    }

    /// Detections of mean weight that are explained, under the same kernel for all solutions that are compared.
    fn explained(&self) -> f64 {
        let joints = self.solution.points.iter().enumerate().filter(|(_, x)| x.x.is_finite());
        let sum: f64 =
            joints.map(|(j, x)| agreement(self.rays.of_joint(j), x, Annealing::END)).sum();
        sum / self.rays.mean_weight()
    }
}

impl Refiner {
    pub(super) fn refine_annealed(&self, frame: &Frame) -> Refinement {
        let used = self.usable(&frame.detections);
        let rays = Rays::new(&used, &self.cameras, self.view_weights());
        let annealing = self.annealing(used.n_joints());
        let priors = self.priors(frame);
        let (given, mut found) = match &priors {
            None => {
                let given = Given { priors: None, annealing, widening: Widening::NONE };
                let found = self.find(frame, rays, &given);
                (given, found)
            }
            Some(priors) => self.find_with(priors, frame, &rays, &annealing),
        };
        let mut swapped = vec![false; used.n_views() * used.n_joints()];
        for _ in 0..SWAP_ROUNDS {
            let swaps =
                swaps::find(&found.rays, &self.chains, &found.solution, &given.annealing.end);
            if swaps.is_empty() {
                break;
            }
            let rays = self.exchanged(&found.rays, &swaps);
            let other = self.find(frame, rays, &given);
            if other.loses_against(&found) || !other.explains_more(&found, &given) {
                break;
            }
            found = other;
            self.mark(&swaps, &mut swapped, used.n_joints());
        }
        let problem = self.problem(&found.rays, &given, found.widening);
        let bars = self.bars(&problem, &mut found.solution, &swapped);
        self.annealed_result(frame, &problem, &found, (swapped, bars))
    }

    /// The pose with priors, whose noise is estimated without them: one that is wrong must not pass for noise of the
    /// detections. Where that asked for wider kernels, the priors have their say on whether it is noise.
    fn find_with<'a>(
        &self,
        priors: &'a [Prior],
        frame: &Frame,
        rays: &Rays,
        annealing: &Annealing,
    ) -> (Given<'a>, Found) {
        let alone = locate(rays, annealing);
        let located = alone.solution.points.iter().any(|x| x.x.is_finite());
        let under = |noise: f64, widening: Widening| {
            let noise = match annealing.noise {
                NoiseModel::Estimated if located => NoiseModel::Millimetres(noise),
                NoiseModel::Estimated => NoiseModel::Pixels(NoiseModel::PRIOR_PX),
                given => given,
            };
            let annealing = Annealing { noise, ..annealing.clone() };
            let given = Given { priors: Some(priors), annealing, widening };
            let found = self.find(frame, rays.clone(), &given);
            (given, found)
        };
        let wide = under(alone.solution.noise, alone.widening);
        if annealing.noise != NoiseModel::Estimated || !alone.widening.follows_noise {
            return wide;
        }
        let narrow = under(alone.narrow_noise, Widening::NONE);
        let likely = |(_, found): &(Given<'_>, Found)| {
            evidence(rays, &found.solution, Some(priors), anywhere(rays, annealing)).log
        };
        if likely(&wide) > likely(&narrow) { wide } else { narrow }
    }

    fn problem<'a>(
        &'a self,
        rays: &'a Rays,
        given: &'a Given<'a>,
        widening: Widening,
    ) -> Problem<'a> {
        let Given { priors, annealing, .. } = given;
        Problem { rays, pairs: &self.pairs, priors: *priors, annealing, widening }
    }

    fn find(&self, frame: &Frame, rays: Rays, given: &Given<'_>) -> Found {
        let Start { init, points, sigma, widening } = self.annealed_start(frame, &rays, given);
        let solution = solve(&self.problem(&rays, given, widening), points, sigma);
        Found { rays, init, solution, widening }
    }

    /// The rays with the chains of `swaps` exchanged.
    fn exchanged(&self, rays: &Rays, swaps: &[(usize, usize)]) -> Rays {
        let mut out = rays.clone();
        for (view, chain) in swaps {
            for [l, r] in &self.chains[*chain] {
                out.swap(*view, *l, *r);
            }
        }
        out
    }

    fn mark(&self, swaps: &[(usize, usize)], swapped: &mut [bool], n_joints: usize) {
        for (view, chain) in swaps {
            for j in self.chains[*chain].iter().flatten() {
                swapped[view * n_joints + j] ^= true;
            }
        }
    }

    /// For detection `(view, joint)` as it was given, the joint that it was used for.
    fn used_for(&self, swapped: &[bool], view: usize, joint: usize, n_joints: usize) -> usize {
        if !swapped[view * n_joints + joint] {
            return joint;
        }
        let pairs = self.chains.iter().flatten();
        let mut partners = pairs.filter_map(|[l, r]| match joint {
            j if j == *l => Some(*r),
            j if j == *r => Some(*l),
            _ => None,
        });
        partners.next().unwrap_or(joint)
    }

    fn view_weights(&self) -> &[f64] {
        self.config.view_weights.as_deref().unwrap_or_default()
    }

    fn annealing(&self, n_joints: usize) -> Annealing {
        let config = &self.config;
        Annealing {
            start: config.sigma_start,
            end: (0..n_joints).map(|j| self.sigma(j)).collect(),
            per_noise: config.sigma_per_noise.unwrap_or(f64::INFINITY),
            base: config.sigma,
            factor: config.sigma_decay,
            symmetry_sigma: config.symmetry_sigma,
            max_steps: config.max_steps,
            tolerance: config.step_tolerance,
            noise: config.detection_sigma.map_or(NoiseModel::Estimated, NoiseModel::Pixels),
        }
    }

    /// The posterior at `points`, mm, that another method has found.
    pub(super) fn error_bars(&self, used: &Detections, points: &[Vector3<f64>]) -> ErrorBars {
        let rays = Rays::new(used, &self.cameras, self.view_weights());
        let annealing = Annealing { max_steps: 0, ..self.annealing(points.len()) };
        let given = Given { priors: None, annealing, widening: Widening::NONE };
        let problem = self.problem(&rays, &given, Widening::NONE);
        let mut solution = solve(&problem, points.to_vec(), given.annealing.end.clone());
        let swapped = vec![false; used.n_views() * used.n_joints()];
        let bars = self.bars(&problem, &mut solution, &swapped);
        // Its splats reach further than these kernels: what they reject still has a say on the depth.
        let all = vec![1.0; used.n_views()];
        let has_depth = |j: usize| is_fixed(rays.of_joint(j), j, &solution, &all);
        let status = (0..points.len()).map(|j| match has_depth(j) {
            true => JointStatus::Ok,
            false => JointStatus::Weak,
        });
        ErrorBars { status: status.collect(), ..bars }
    }

    fn bars(&self, problem: &Problem<'_>, solution: &mut Solution, swapped: &[bool]) -> ErrorBars {
        let mm = self.unit.millimetres();
        let rays = problem.rays;
        let (m, n) = (rays.n_views(), rays.n_joints());
        let k = believed(rays, solution);
        let of_joint = |j: usize| (rays.of_joint(j), &k[j * m..(j + 1) * m]);
        let is_deep = |j: usize| is_fixed(of_joint(j).0, j, solution, of_joint(j).1);
        let deep: Vec<bool> = (0..n).map(is_deep).collect();
        let mut covariances = posterior(problem, solution, &deep, &k);
        let mut status: Vec<JointStatus> = (0..n)
            .map(|j| match of_joint(j) {
                (rays, _) if !rays.iter().any(Ray::is_there) => JointStatus::Unobserved,
                (_, k) if k.iter().filter(|k| **k >= REJECTED).count() < 2 => JointStatus::Weak,
                _ if !deep[j] => JointStatus::Weak,
                _ => JointStatus::Ok,
            })
            .collect();
        for j in (0..n).filter(|j| of_joint(*j).1.iter().any(|k| *k < REJECTED)) {
            let x = &solution.points[j];
            for rival in rivals(rays.of_joint(j), x, solution.sigma[j], TIE) {
                // The second moment about x of places that are right with these probabilities.
                let off = rival.at - x;
                covariances[j] += off * off.transpose() * rival.share;
                status[j] = JointStatus::Weak;
            }
        }
        let weight = |at: usize| {
            let (i, j) = (at / n, self.used_for(swapped, at / n, at % n, n));
            k[j * m + i]
        };
        ErrorBars {
            uncertainty: covariances.iter().map(|c| c / (mm * mm)).collect(),
            view_weights: (0..m * n).map(weight).collect(),
            noise: solution.noise / mm,
            status,
        }
    }

    fn annealed_result(
        &self,
        frame: &Frame,
        problem: &Problem<'_>,
        found: &Found,
        (swapped, bars): (Vec<bool>, ErrorBars),
    ) -> Refinement {
        let mm = self.unit.millimetres();
        let (rays, solution) = (problem.rays, &found.solution);
        let n = rays.n_joints();
        let used_for = |i: usize, j: usize| self.used_for(&swapped, i, j, n);
        let errors = self.reprojection_error(&frame.detections, &solution.points, used_for);
        let splat = |(x, sigma): (&Vector3<f64>, &f64)| {
            let variance = if x.x.is_nan() { f64::NAN } else { (sigma / mm).powi(2) };
            Matrix3::from_diagonal_element(variance)
        };
        let joint_status = bars.status;
        let known = |j: usize| solution.points[j].x.is_finite();
        let mut seen =
            joint_status.iter().enumerate().filter(|(_, s)| **s != JointStatus::Unobserved);
        let observed = seen.any(|(j, _)| known(j));
        Refinement {
            pose: solution.points.iter().map(|p| p / mm).collect(),
            covariance: solution.points.iter().zip(&solution.sigma).map(splat).collect(),
            uncertainty: bars.uncertainty,
            reprojection_error: errors,
            swapped,
            view_weights: bars.view_weights,
            noise: bars.noise,
            init_pose: found.init.iter().map(|p| p / mm).collect(),
            joint_status,
            loss: loss(problem, solution),
            loss_history: Vec::new(),
            n_iter: solution.n_iter,
            stop_reason: match (observed, solution.converged) {
                (false, _) => StopReason::NoObservations,
                (true, true) => StopReason::Converged,
                (true, false) => StopReason::MaxSteps,
            },
        }
    }
}

/// k of every ray `(N, M)` at the solution; NaN where there is none.
fn believed(rays: &Rays, solution: &Solution) -> Vec<f64> {
    let mut out = Vec::with_capacity(rays.n_joints() * rays.n_views());
    for (j, x) in solution.points.iter().enumerate() {
        let k = |ray: &Ray| match ray.is_there() {
            true => ray.offset(x).weight(solution.sigma[j]),
            false => f64::NAN,
        };
        out.extend(rays.of_joint(j).iter().map(k));
    }
    out
}

/// The terms of F (see [`crate::annealed`]): data and symmetry.
fn loss(problem: &Problem<'_>, solution: &Solution) -> Loss {
    let mut render = 0.0;
    for (j, x) in solution.points.iter().enumerate().filter(|(_, x)| x.x.is_finite()) {
        let scale = 2.0 * solution.sigma[j].powi(2) / solution.variance;
        for ray in problem.rays.of_joint(j).iter().filter(|ray| ray.is_there()) {
            render += ray.weight * scale * (1.0 - ray.offset(x).weight(solution.sigma[j]));
        }
    }
    let known = |(l, r): &&LimbPair| l.iter().chain(r).all(|j| solution.points[*j].x.is_finite());
    let pairs: Vec<LimbPair> = problem.pairs.iter().filter(known).copied().collect();
    let symmetry = symmetry(|j| solution.points[j], &pairs, |_, _| ());
    Loss { total: render, render, symmetry }
}

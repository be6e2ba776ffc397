//! The default method for one frame: annealed splatting by Gauss–Newton.

use nalgebra::{Matrix3, Vector3};

use super::objective::Loss;
use super::refiner::{Frame, Refiner};
use super::result::{JointStatus, Refinement, StopReason};
use crate::annealed::consensus::{NEAR_TIE, REJECTED, TIE, agreement, rivals};
use crate::annealed::depth::is_fixed;
use crate::annealed::evidence::evidence;
use crate::annealed::swaps;
use crate::annealed::{Annealing, NoiseModel, Prior, Problem, Rays, Solution, Widening, solve};
use crate::detections::Detections;
use crate::symmetry::{LimbPair, symmetry};
use crate::triangulate::robust::{Located, anywhere, locate, start};
use crate::uncertainty::posterior;

/// What follows from residuals alone, in the unit of the cameras.
pub(super) struct ErrorBars {
    pub(super) uncertainty: Vec<Matrix3<f64>>,
    pub(super) view_weights: Vec<f64>,
    pub(super) noise: f64,
    /// Whether the rays fix the depth of each joint and no other place has as many votes.
    pub(super) fixed: Vec<bool>,
}

/// Where a search begins.
struct Start {
    init: Vec<Vector3<f64>>,
    points: Vec<Vector3<f64>>,
    sigma: Vec<f64>,
    widening: Widening,
}

/// What holds for all assignments of left and right of one frame.
struct Given<'a> {
    priors: Option<&'a [Prior]>,
    annealing: Annealing,
    /// [`Problem::widening`] where there are priors.
    widening: Widening,
}

/// Standard deviations of a prior that the first kernel covers.
const PRIOR_REACH: f64 = 2.0;

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
            && (before.widening.factor <= 1.0 || likely(self) > likely(before) + SWAP_EVIDENCE)
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
        if annealing.noise != NoiseModel::Estimated || alone.widening.factor <= 1.0 {
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

    /// The initial pose, where to begin and with which kernels, mm.
    ///
    /// Where two views see a joint the detections place it, whatever the start; a start that is no more than that places
    /// the others. A prior is where the search begins, under a kernel that covers its spread.
    fn annealed_start(&self, frame: &Frame, rays: &Rays, given: &Given<'_>) -> Start {
        let Some(pose) = &frame.init_pose else {
            let found = locate(rays, &given.annealing);
            let Solution { points, sigma, .. } = found.solution;
            return Start { init: points.clone(), points, sigma, widening: found.widening };
        };
        let mm = self.unit.millimetres();
        let known = |p: &Vector3<f64>| p.iter().all(|v| v.is_finite()).then_some(p * mm);
        let pose: Vec<Option<Vector3<f64>>> = pose.iter().map(known).collect();
        match &frame.init_covariance {
            Some(covariances) => self.start_at_prior(&pose, covariances, rays, given),
            None => start_beside(&pose, frame.past, rays, &given.annealing),
        }
    }

    fn start_at_prior(
        &self,
        pose: &[Option<Vector3<f64>>],
        covariances: &[Matrix3<f64>],
        rays: &Rays,
        given: &Given<'_>,
    ) -> Start {
        let (n, annealing, mm) = (pose.len(), &given.annealing, self.unit.millimetres());
        let reach = |j: usize| {
            let widest = covariances[j].diagonal().max();
            if widest.is_finite() { PRIOR_REACH * mm * widest.sqrt() } else { 0.0 }
        };
        let init: Vec<_> = (0..n).map(|j| pose[j].unwrap_or_else(|| start(rays, j))).collect();
        let mut points = init.clone();
        if (0..n).any(|j| reach(j) > annealing.start) {
            // Wider than any kernel: the detections know better where to begin.
            let found = locate(rays, annealing).solution.points;
            for j in (0..n).filter(|j| reach(*j) > annealing.start && found[*j].x.is_finite()) {
                points[j] = found[j];
            }
        }
        Start { init, points, sigma: vec![annealing.start; n], widening: given.widening }
    }

    /// The precision of the initial pose, mm⁻²; none for a joint that the initial pose does not have.
    fn priors(&self, frame: &Frame) -> Option<Vec<Prior>> {
        let (pose, covariance) = (frame.init_pose.as_ref()?, frame.init_covariance.as_ref()?);
        let mm = self.unit.millimetres();
        let prior = |(p, c): (&Vector3<f64>, &Matrix3<f64>)| match (c * (mm * mm)).cholesky() {
            Some(factor) if p.iter().all(|v| v.is_finite()) => {
                Prior { mean: p * mm, precision: factor.inverse() }
            }
            _ => Prior { mean: Vector3::zeros(), precision: Matrix3::zeros() },
        };
        Some(pose.iter().zip(covariance).map(prior).collect())
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
        self.bars(&problem, &mut solution, &swapped)
    }

    fn bars(&self, problem: &Problem<'_>, solution: &mut Solution, swapped: &[bool]) -> ErrorBars {
        let mm = self.unit.millimetres();
        let rays = problem.rays;
        let (m, n) = (rays.n_views(), rays.n_joints());
        let deep: Vec<bool> = (0..n).map(|j| is_fixed(rays.of_joint(j), j, solution)).collect();
        let mut covariances = posterior(problem, solution, &deep);
        let mut fixed = deep;
        for j in 0..n {
            let x = &solution.points[j];
            for rival in rivals(rays.of_joint(j), x, solution.sigma[j], TIE) {
                // The second moment about x of places that are right with these probabilities.
                let off = rival.at - x;
                covariances[j] += off * off.transpose() * rival.share;
                fixed[j] = false;
            }
        }
        let weight = |k: usize| {
            let (i, j) = (k / n, self.used_for(swapped, k / n, k % n, n));
            let (ray, x) = (&rays.of_joint(j)[i], &solution.points[j]);
            if ray.is_there() { ray.offset(x).weight(solution.sigma[j]) } else { f64::NAN }
        };
        ErrorBars {
            uncertainty: covariances.iter().map(|c| c / (mm * mm)).collect(),
            view_weights: (0..m * n).map(weight).collect(),
            noise: solution.noise / mm,
            fixed,
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
        let joint_status = joint_status(rays, solution, &bars.fixed);
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

/// Where to begin with an initial pose `(N)` that is no prior: the detections place what they can. Of two places that have
/// as many votes the `past` decides.
fn start_beside(
    pose: &[Option<Vector3<f64>>],
    past: bool,
    rays: &Rays,
    annealing: &Annealing,
) -> Start {
    let Located { solution: found, widening, .. } = locate(rays, annealing);
    let init = pose.iter().zip(&found.points).map(|(p, x)| p.unwrap_or(*x)).collect();
    let (mut points, mut sigma) = (found.points, found.sigma);
    for (j, p) in pose.iter().enumerate().filter_map(|(j, p)| Some((j, (*p)?))) {
        if points[j].x.is_nan() {
            (points[j], sigma[j]) = (p, f64::INFINITY);
        }
        if !past {
            continue;
        }
        for rival in rivals(rays.of_joint(j), &points[j].clone(), sigma[j], NEAR_TIE) {
            if (rival.at - p).norm() < (points[j] - p).norm() {
                points[j] = rival.at;
            }
        }
    }
    Start { init, points, sigma, widening }
}

fn joint_status(rays: &Rays, solution: &Solution, fixed: &[bool]) -> Vec<JointStatus> {
    let one = |j: usize| {
        let (x, sigma) = (&solution.points[j], solution.sigma[j]);
        let there = || rays.of_joint(j).iter().filter(|ray| ray.is_there());
        match there().filter(|ray| ray.offset(x).weight(sigma) >= REJECTED).count() {
            _ if there().next().is_none() => JointStatus::Unobserved,
            0 | 1 => JointStatus::Weak,
            _ if !fixed[j] => JointStatus::Weak,
            _ => JointStatus::Ok,
        }
    };
    (0..rays.n_joints()).map(one).collect()
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

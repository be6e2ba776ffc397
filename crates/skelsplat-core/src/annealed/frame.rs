//! Annealed splatting of one frame: start, pose, left–right swaps, error bars.

use super::consensus::agreement;
use super::depth::is_fixed;
use super::evidence::evidence;
use super::locate::{anywhere, locate};
use super::noise::NoiseModel;
use super::posterior::error_bars;
use super::proportions::with_bones;
use super::rays::{Rays, there};
use super::solver::{Annealing, Prior, Problem, Solution, Widening, solve};
use super::starts::{Before, Given, Start, start};
use super::swaps::{self, Chain, Swap};
use crate::bones::Bone;
use crate::bones::expected::Expected;
use crate::camera::Camera;
use crate::detections::Detections;
use crate::outcome::{ErrorBars, JointStatus, Loss, Outcome, Splats, StopReason, as_given};
use crate::symmetry::{LimbPair, symmetry};
use nalgebra::{Matrix3, Vector3};

/// One frame, before sides are assigned; lengths are mm.
#[derive(Debug, Clone)]
pub struct AnnealedFrame<'a> {
    /// The cameras.
    pub cameras: &'a [Camera],
    /// Detections as ideal pixels.
    pub detections: &'a Detections,
    /// Weight of each view; empty: 1 for all.
    pub view_weights: &'a [f64],
    /// Limbs of equal length.
    pub pairs: &'a [LimbPair],
    /// Joints that a detector may swap together.
    pub chains: &'a [Chain],
    /// Expected lengths of bones; none: bones are free.
    pub expected: &'a Expected,
    /// The annealing schedule.
    pub annealing: Annealing,
    /// Initial pose and prior.
    pub before: Option<Before>,
}

/// A pose and its error bars.
#[derive(Debug, Clone, PartialEq)]
pub struct Annealed {
    /// The pose.
    pub outcome: Outcome,
    /// Its error bars.
    pub bars: ErrorBars,
}

/// One frame solved alone.
#[derive(Debug, Clone)]
pub struct Alone {
    /// Its rays, with left and right as they were used.
    pub rays: Rays,
    /// The joint for which each detection `(M, N)` was used.
    pub used_for: Vec<usize>,
    /// Positions `(N)`, mm; NaN where unknown.
    pub points: Vec<Vector3<f64>>,
    /// Posterior covariances `(N)`, mm².
    pub spread: Vec<Matrix3<f64>>,
    /// Status of every joint.
    pub status: Vec<JointStatus>,
    /// Standard deviation of the detection noise, mm; NaN without detections.
    pub noise: f64,
}

/// A solution for one assignment of left and right.
struct Attempt {
    rays: Rays,
    init: Vec<Vector3<f64>>,
    solution: Solution,
    widening: Widening,
    /// Bones that took part.
    bones: Vec<Bone>,
}

/// A pose with priors, and the noise used to find it.
struct Informed<'a> {
    given: Given<'a>,
    found: Attempt,
}

/// Maximum rounds of the search for swaps.
const SWAP_ROUNDS: usize = 3;
/// Detections of mean weight that a swap has to explain in addition, after the pose is solved
/// again.
const SWAP_GAIN: f64 = 1.0;
/// Log-odds that a swap has to reach where the noise is large: there are a few dozen candidates.
const SWAP_EVIDENCE: f64 = 10.0;

impl Attempt {
    /// Whether a joint with a position in `other` has none here.
    fn loses_against(&self, other: &Self) -> bool {
        let (here, there) = (&self.solution.points, &other.solution.points);
        here.iter().zip(there).any(|(x, y)| x.x.is_nan() && y.x.is_finite())
    }

    /// Whether a swap is accepted: by the number of explained detections and, where the noise is so
    /// large that chance explains some, by the likelihood of all.
    fn explains_more(&self, before: &Self, given: &Given<'_>) -> bool {
        let likely = |found: &Self| {
            let anywhere = anywhere(&found.rays, &given.annealing);
            evidence(&found.rays, &found.solution, given.priors, anywhere).log
        };
        self.explained() > before.explained() + SWAP_GAIN
            && (!before.widening.follows_noise || likely(self) > likely(before) + SWAP_EVIDENCE)
    }

    /// Explained detections of mean weight, under the same kernel for all compared solutions.
    fn explained(&self) -> f64 {
        let joints = self.solution.points.iter().enumerate().filter(|(_, x)| x.x.is_finite());
        let sum: f64 =
            joints.map(|(j, x)| agreement(self.rays.of_joint(j), x, Annealing::END)).sum();
        sum / self.rays.mean_weight()
    }

    /// The rays with the chains of `swaps` swapped.
    fn exchanged(&self, chains: &[Chain], swaps: &[Swap]) -> Rays {
        let mut out = self.rays.clone();
        for swap in swaps {
            for [l, r] in &chains[swap.chain] {
                out.swap(swap.view, *l, *r);
            }
        }
        out
    }
}

impl AnnealedFrame<'_> {
    /// The pose of the frame.
    pub fn solve(&self) -> Annealed {
        let rays = Rays::new(self.detections, self.cameras, self.view_weights);
        let Informed { given, mut found } = match self.before.as_ref().and_then(Before::priors) {
            None => {
                let given = Given::without_priors(self.annealing.clone());
                Informed { found: self.find(rays, &given), given }
            }
            Some(priors) => self.with_priors(priors, &rays),
        };
        let n_joints = self.detections.n_joints();
        let mut used_for = as_given(self.detections.n_views(), n_joints);
        for _ in 0..SWAP_ROUNDS {
            let swaps =
                swaps::find(&found.rays, self.chains, &found.solution, &given.annealing.end);
            if swaps.is_empty() {
                break;
            }
            let other = self.find(found.exchanged(self.chains, &swaps), &given);
            if other.loses_against(&found) || !other.explains_more(&found, &given) {
                break;
            }
            found = other;
            for swap in &swaps {
                for [l, r] in &self.chains[swap.chain] {
                    used_for.swap(swap.view * n_joints + l, swap.view * n_joints + r);
                }
            }
        }
        self.outcome(&given, found, used_for)
    }

    /// The posterior at `points`, found by another method.
    pub fn error_bars(&self, points: &[Vector3<f64>]) -> ErrorBars {
        let rays = Rays::new(self.detections, self.cameras, self.view_weights);
        let annealing = Annealing { max_steps: 0, ..self.annealing.clone() };
        let given = Given::without_priors(annealing);
        let problem = self.problem(&rays, &given, Widening::NONE, &[]);
        let mut solution = solve(&problem, points, &given.annealing.end);
        let bars = error_bars(&problem, &mut solution);
        // Its splats are wider than these kernels: detections rejected here may still determine the
        // depth.
        let all = vec![1.0; self.detections.n_views()];
        let has_depth = |j: usize| is_fixed(rays.of_joint(j), j, &solution, &all);
        let status = (0..points.len()).map(|j| match has_depth(j) {
            true => JointStatus::Ok,
            false => JointStatus::Weak,
        });
        ErrorBars { status: status.collect(), ..bars }
    }

    /// The pose with priors. The noise is estimated without them, so that a wrong prior is not
    /// mistaken for detection noise. Where the noise requires wider kernels, the priors take part
    /// in the decision whether it is noise.
    fn with_priors<'p>(&self, priors: &'p [Prior], rays: &Rays) -> Informed<'p> {
        let annealing = &self.annealing;
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
            let found = self.find(rays.clone(), &given);
            Informed { given, found }
        };
        let wide = under(alone.solution.noise, alone.widening);
        if annealing.noise != NoiseModel::Estimated || !alone.widening.follows_noise {
            return wide;
        }
        let narrow = under(alone.narrow_noise, Widening::NONE);
        let likely = |informed: &Informed<'_>| {
            let anywhere = anywhere(rays, annealing);
            evidence(rays, &informed.found.solution, Some(priors), anywhere).log
        };
        if likely(&wide) > likely(&narrow) { wide } else { narrow }
    }

    fn find(&self, rays: Rays, given: &Given<'_>) -> Attempt {
        let Start { init, points, sigma, widening } = start(self.before.as_ref(), &rays, given);
        let problem = self.problem(&rays, given, widening, &[]);
        let solution = solve(&problem, &points, &sigma);
        let (solution, bones) =
            with_bones(&problem, self.expected, &solution, self.before.is_none())
                .unwrap_or((solution, Vec::new()));
        Attempt { rays, init, solution, widening, bones }
    }

    fn problem<'b>(
        &'b self,
        rays: &'b Rays,
        given: &'b Given<'b>,
        widening: Widening,
        bones: &'b [Bone],
    ) -> Problem<'b> {
        let Given { priors, annealing, .. } = given;
        Problem { rays, pairs: self.pairs, bones, priors: *priors, annealing, widening }
    }

    fn outcome(&self, given: &Given<'_>, found: Attempt, used_for: Vec<usize>) -> Annealed {
        let Attempt { rays, init, mut solution, widening, bones } = found;
        let problem = self.problem(&rays, given, widening, &bones);
        let bars = error_bars(&problem, &mut solution);
        let loss = loss(&problem, &solution);
        let known = |(x, status): (&Vector3<f64>, &JointStatus)| {
            x.x.is_finite() && *status != JointStatus::Unobserved
        };
        let observed = solution.points.iter().zip(&bars.status).any(known);
        let outcome = Outcome {
            points: solution.points,
            splats: Splats::Round(solution.sigma),
            init,
            status: bars.status.clone(),
            used_for,
            loss,
            loss_history: Vec::new(),
            n_iter: solution.n_iter,
            stop_reason: match (observed, solution.converged) {
                (false, _) => StopReason::NoObservations,
                (true, true) => StopReason::Converged,
                (true, false) => StopReason::MaxSteps,
            },
        };
        Annealed { outcome, bars }
    }
}

/// The terms of F (see [`crate::annealed`]): data and symmetry.
fn loss(problem: &Problem<'_>, solution: &Solution) -> Loss {
    let mut render = 0.0;
    for (j, x) in solution.points.iter().enumerate().filter(|(_, x)| x.x.is_finite()) {
        let scale = 2.0 * solution.sigma[j].powi(2) / solution.variance;
        for ray in there(problem.rays.of_joint(j)) {
            render += ray.weight * scale * (1.0 - ray.offset(x).weight(solution.sigma[j]));
        }
    }
    let known = |(l, r): &&LimbPair| l.iter().chain(r).all(|j| solution.points[*j].x.is_finite());
    let pairs: Vec<LimbPair> = problem.pairs.iter().filter(known).copied().collect();
    let symmetry = symmetry(|j| solution.points[j], &pairs, |_, _| ());
    Loss { total: render, render, symmetry }
}

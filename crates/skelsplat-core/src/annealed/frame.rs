//! Annealed splatting of one frame: a start, one annealing, moves, left–right swaps, error bars.

use nalgebra::Vector3;

use super::depth::is_fixed;
use super::evidence::{Evidence, can_outvote, evidence, of_few};
use super::joints::Joints;
use super::noise::NoiseModel;
use super::places::{PlaceSearch, Votes, against_bones, needed, shown};
use super::posterior::{Explanation, error_bars};
use super::problem::{Annealing, Prior, Solution};
use super::rays::{Rays, there};
use super::solver::{Solver, Terms, UPWARDS};
use super::starts::{Before, nearest_to_all};
use super::swaps::{self, Chain, Swap};
use super::views::factors;
use crate::bones::Bone;
use crate::bones::expected::Expected;
use crate::camera::Camera;
use crate::detections::Detections;
use crate::outcome::{ErrorBars, JointStatus, Loss, Outcome, Splats, StopReason, as_given};
use crate::symmetry::{LimbPair, symmetry};

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
    /// Whether it is one of a recording, which tells more of the noise of its joints and views.
    pub in_recording: bool,
}

/// A pose and its error bars.
#[derive(Debug, Clone, PartialEq)]
pub struct Annealed {
    /// The pose.
    pub outcome: Outcome,
    /// Its error bars.
    pub bars: ErrorBars,
    /// Its rays, with left and right as they were used.
    pub rays: Rays,
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
    /// Their error bars.
    pub bars: ErrorBars,
}

/// An explanation of the frame, for one assignment of left and right.
struct Attempt {
    rays: Rays,
    /// The joint for which each detection `(M, N)` is used.
    used_for: Vec<usize>,
    init: Vec<Vector3<f64>>,
    solver: Solver,
    /// Whether the kernels followed the noise.
    follows_noise: bool,
    /// Bones that took part.
    bones: Vec<Bone>,
}

/// Maximum rounds of moves.
const MOVE_ROUNDS: usize = 3;
/// Maximum rounds of the search for swaps.
const SWAP_ROUNDS: usize = 3;
/// Log-odds against a swap: there are a few dozen candidates, each rarely true. As much may larger
/// noise lack before swaps and moves: where it lacks more they hardly ever make up for it.
pub(crate) const SWAP_EVIDENCE: f64 = 10.0;
/// Share of the residuals' variance that is noise under the configured kernels; the rest are wrong
/// detections that these let through (measured, docs/decisions.md).
const NOISE_SHARE: f64 = 0.87;
/// Kernel from which limb pairs take part, mm: under wider ones they throw joints along their rays.
const ENTER: f64 = 0.25 * Annealing::START;
/// Tolerance of the solver until the explanation is chosen.
const COARSE: f64 = 0.1;

impl Attempt {
    /// With the joints where they are, and left and right as they are given.
    fn new(rays: Rays, solver: Solver) -> Self {
        let used_for = as_given(rays.n_views(), rays.n_joints());
        let init = solver.solution().points;
        Self { rays, used_for, init, solver, follows_noise: false, bones: Vec::new() }
    }

    /// Whether a joint with a position in `other` has none here.
    fn loses_against(&self, other: &Self) -> bool {
        let lost = |j| !self.solver.joints.is_live(j) && other.solver.joints.is_live(j);
        (0..self.rays.n_joints()).any(lost)
    }
}

impl AnnealedFrame<'_> {
    /// The pose of the frame: under the configured kernels, or under those that follow larger noise
    /// where that explains the frame better, and where no joint has three views, since nothing
    /// outvotes a wrong detection there.
    pub fn solve(&self) -> Annealed {
        let rays = Rays::new(self.detections, self.cameras, self.view_weights);
        let annealing = &self.annealing;
        let may_follow = annealing.per_noise.is_finite();
        let is_estimated = annealing.noise == NoiseModel::Estimated;
        let mut found = self.moved(self.annealed(rays.clone(), may_follow && !is_estimated));
        let is_contested = can_outvote(&found.rays);
        // With less noise the wide kernels end like the configured ones.
        let needs = annealing.base / annealing.per_noise / if is_contested { UPWARDS } else { 1.0 };
        if may_follow && is_estimated && found.solver.noise() >= needs {
            let mut wide = self.annealed(rays, true);
            let least = if is_contested { self.explains(&found) } else { f64::NEG_INFINITY };
            if self.explains(&wide) > least - SWAP_EVIDENCE {
                wide = self.moved(wide);
                if wide.solver.noise() <= annealing.start && self.explains(&wide) > least {
                    found = wide;
                }
            }
        }
        let given = self.finish(&mut found);
        self.outcome(found, given)
    }

    /// Solves the chosen explanation to the end; where views do not compare as their confidences
    /// say, with other weights. Returns the rays with their confidences then.
    fn finish(&self, found: &mut Attempt) -> Option<Rays> {
        let alone = !self.in_recording;
        let factors = alone.then(|| factors(&found.rays, &found.solver.solution())).flatten();
        let given = factors.map(|factors| {
            let rays = found.rays.weighed(&factors);
            found.solver.joints.set_all_rays(&rays);
            found.solver.measure(found.follows_noise);
            std::mem::replace(&mut found.rays, rays)
        });
        let terms = self.terms(found.follows_noise, &found.bones);
        let terms = Terms { tolerance: self.annealing.tolerance, ..terms };
        match given.is_none() && found.solver.whole {
            true => found.solver.proceed(&terms),
            false => found.solver.run(&terms, |_| true),
        }
        given
    }

    /// With swaps and moves.
    fn moved(&self, mut found: Attempt) -> Attempt {
        let n = self.detections.n_joints();
        for _ in 0..SWAP_ROUNDS {
            let joints = &found.solver.joints;
            let points: Vec<_> = (0..n).map(|j| joints.at(j)).collect();
            let sigma: Vec<_> =
                (0..n).map(|j| joints.sigma(j).min(self.annealing.end[j])).collect();
            let swaps = swaps::find(&found.rays, self.chains, &points, &sigma);
            if swaps.is_empty() {
                break;
            }
            let other = self.swapped(&found, &swaps);
            let least = self.evidence(&found.solver).log + SWAP_EVIDENCE;
            if other.loses_against(&found) || self.evidence(&other.solver).log <= least {
                break;
            }
            found = other;
        }
        for _ in 0..MOVE_ROUNDS {
            if !self.make_moves(&mut found) {
                break;
            }
        }
        found
    }

    /// The posterior at `points`, found by another method, of joints of this `status`.
    pub fn error_bars(&self, points: &[Vector3<f64>], status: &[JointStatus]) -> ErrorBars {
        let rays = Rays::new(self.detections, self.cameras, self.view_weights);
        let mut joints = Joints::new(&rays, self.pairs);
        for (j, x) in points.iter().enumerate() {
            joints.put(j, x);
            joints.set_sigma(j, self.annealing.end[j]);
        }
        joints.scale_to(&rays);
        let mut solver = Solver::new(joints, self.annealing.noise);
        solver.measure(false);
        let solution = solver.solution();
        let found = Attempt::new(rays, solver);
        let bars = self.bars(&found, &solution);
        // Its splats are wider than these kernels: detections rejected here may still determine the
        // depth.
        let all = vec![1.0; self.detections.n_views()];
        let has_depth = |j: usize| is_fixed(found.rays.of_joint(j), j, &solution, &all);
        let status = status.iter().enumerate().map(|(j, status)| match status {
            JointStatus::Ok if !has_depth(j) => JointStatus::Weak,
            _ => *status,
        });
        ErrorBars { status: status.collect(), ..bars }
    }

    fn bars(&self, found: &Attempt, solution: &Solution) -> ErrorBars {
        let votes = Votes::of(&found.rays, solution);
        let follows = found.follows_noise && self.annealing.noise == NoiseModel::Estimated;
        // Otherwise neither the share of wrong detections nor other places matter.
        let own_noise = !self.in_recording;
        let is_loud = own_noise && (0..votes.seen.len()).any(|j| solution.is_loud(j));
        let matters = follows || is_loud || votes.agree != votes.seen || !found.bones.is_empty();
        let evidence = if matters { self.evidence(&found.solver) } else { Evidence::default() };
        let noise_share = match follows {
            true => (1.0 - evidence.wrong) * of_few(&found.rays),
            false => NOISE_SHARE,
        };
        error_bars(&Explanation {
            search: PlaceSearch {
                rays: &found.rays,
                bones: &found.bones,
                solution,
                votes: &votes,
                mixture: &evidence.mixture.undecided(),
                priors: self.priors(),
                past: None,
            },
            pairs: self.pairs,
            symmetry_sigma: self.annealing.symmetry_sigma,
            noise_share,
            own_noise,
        })
    }

    fn priors(&self) -> Option<&[Prior]> {
        self.before.as_ref().and_then(|before| before.priors.as_deref())
    }

    fn terms<'b>(&'b self, follows_noise: bool, bones: &'b [Bone]) -> Terms<'b> {
        let Self { pairs, annealing, .. } = self;
        let tolerance = annealing.tolerance.max(COARSE);
        let enter = if bones.is_empty() { ENTER } else { f64::INFINITY };
        Terms { pairs, bones, annealing, enter, tolerance, follows_noise }
    }

    /// One annealing of all joints, without bones.
    fn annealed(&self, rays: Rays, follows_noise: bool) -> Attempt {
        let mut joints = Joints::new(&rays, self.pairs);
        joints.start(&rays, &self.annealing);
        let mut solver = Solver::new(joints, self.annealing.noise);
        let terms = self.terms(follows_noise, &[]);
        // A prior is compared with the noise without it.
        let tolerance =
            if self.priors().is_some() { self.annealing.tolerance } else { terms.tolerance };
        solver.run(&Terms { tolerance, ..terms }, |_| true);
        solver.joints.drop_undetermined(&rays);
        let mut attempt = Attempt { follows_noise, ..Attempt::new(rays, solver) };
        match &self.before {
            Some(Before { pose, priors: Some(priors), .. }) => {
                self.inform(&mut attempt, pose, priors);
            }
            Some(before) => self.complete(&mut attempt, &before.pose),
            None => (),
        }
        attempt
    }

    /// log p of the detections and of the bones.
    fn explains(&self, found: &Attempt) -> f64 {
        let solution = found.solver.solution();
        let votes = Votes::of(&found.rays, &solution);
        let bones = shown(self.expected, &solution, &votes);
        self.evidence(&found.solver).log - against_bones(bones, &solution, self.annealing.start)
    }

    fn evidence(&self, solver: &Solver) -> Evidence {
        evidence(&solver.joints, solver.variance, self.annealing.start)
    }

    /// The pose with priors. The noise is that without them, so that a wrong prior is not mistaken
    /// for detection noise.
    fn inform(&self, found: &mut Attempt, pose: &[Option<Vector3<f64>>], priors: &[Prior]) {
        self.begin_at(&mut found.solver, &found.rays, pose, priors);
        found.init = found.solver.solution().points;
        found.solver.run(&self.terms(found.follows_noise, &[]), |_| true);
    }

    /// Joints begin at their priors under the widest kernel, and the noise stays as it is.
    fn begin_at(
        &self,
        solver: &mut Solver,
        rays: &Rays,
        pose: &[Option<Vector3<f64>>],
        priors: &[Prior],
    ) {
        if solver.model == NoiseModel::Estimated {
            solver.model = match (0..priors.len()).any(|j| solver.joints.is_live(j)) {
                true => NoiseModel::Millimetres(solver.noise()),
                false => NoiseModel::Pixels(NoiseModel::PRIOR_PX),
            };
        }
        solver.joints.set_priors(priors);
        for (j, prior) in priors.iter().enumerate() {
            let is_wide = Annealing::PER_NOISE * prior.spread > self.annealing.start;
            let x = match pose[j] {
                Some(_) if is_wide && solver.joints.is_live(j) => solver.joints.at(j),
                Some(x) => x,
                None => nearest_to_all(rays, j),
            };
            solver.joints.put(j, &x);
            solver.joints.set_sigma(j, self.annealing.start);
        }
        solver.joints.scale_to(rays);
    }

    /// Joints that the detections do not determine start at the given `pose`.
    fn complete(&self, found: &mut Attempt, pose: &[Option<Vector3<f64>>]) {
        let lost: Vec<bool> = found.init.iter().map(|x| x.x.is_nan()).collect();
        for (j, x) in pose.iter().enumerate().filter_map(|(j, x)| Some((j, (*x)?))) {
            if lost[j] {
                found.solver.joints.begin(&found.rays, &self.annealing, j, &x);
            }
            found.init[j] = x;
        }
        if lost.iter().zip(pose).any(|(lost, x)| *lost && x.is_some()) {
            found.solver.run(&self.terms(found.follows_noise, &[]), |_| true);
        }
    }

    /// Doubtful joints move to their most likely places, and the joints around them are solved with
    /// their bones. Returns whether that tells others more about the noise: any has moved, and does
    /// not return.
    fn make_moves(&self, found: &mut Attempt) -> bool {
        let solution = found.solver.solution();
        let votes = Votes::of(&found.rays, &solution);
        let n = found.rays.n_joints();
        if found.bones.is_empty() && !(0..n).any(|j| votes.is_doubtful(j)) {
            return false;
        }
        let bones = needed(self.expected, &solution, &votes);
        let is_known = bones.iter().map(|b| b.joints).eq(found.bones.iter().map(|b| b.joints));
        let search = PlaceSearch {
            rays: &found.rays,
            bones: &bones,
            solution: &solution,
            votes: &votes,
            mixture: &self.evidence(&found.solver).mixture,
            priors: self.priors(),
            past: self.before.as_ref().filter(|b| b.priors.is_none()).map(|b| b.pose.as_slice()),
        };
        let guess = search.most_likely();
        let moved = |j: &usize| guess[*j] != solution.points[*j] && !guess[*j].x.is_nan();
        let moved: Vec<usize> = (0..n).filter(moved).collect();
        if moved.is_empty() && is_known {
            return false;
        }
        let in_pair = |pair: &LimbPair, j: usize| pair.0.contains(&j) || pair.1.contains(&j);
        let has_doubt =
            |pair: &LimbPair| pair.0.iter().chain(&pair.1).any(|j| votes.is_doubtful(*j));
        let near = |j: usize| {
            votes.is_doubtful(j)
                || bones.iter().chain(&found.bones).any(|bone| bone.joints.contains(&j))
                || self.pairs.iter().any(|pair| in_pair(pair, j) && has_doubt(pair))
        };
        for (j, x) in guess.iter().enumerate() {
            found.solver.joints.put(j, x);
        }
        found.solver.run(&self.terms(found.follows_noise, &bones), near);
        found.bones = bones;
        let off = |j: usize| (found.solver.joints.at(j) - solution.points[j]).norm();
        !moved.iter().all(|j| off(*j) <= solution.sigma[*j])
    }

    /// The explanation with chains exchanged; for their joints the search starts again.
    fn swapped(&self, found: &Attempt, swaps: &[Swap]) -> Attempt {
        let (mut rays, mut used_for) = (found.rays.clone(), found.used_for.clone());
        let n = rays.n_joints();
        for swap in swaps {
            for [l, r] in &self.chains[swap.chain] {
                rays.swap(swap.view, *l, *r);
                used_for.swap(swap.view * n + l, swap.view * n + r);
            }
        }
        let mut solver = found.solver.clone();
        for j in swaps.iter().flat_map(|swap| self.chains[swap.chain].iter().flatten()) {
            solver.joints.set_rays(&rays, *j);
            let x = nearest_to_all(&rays, *j);
            solver.joints.begin(&rays, &self.annealing, *j, &x);
        }
        solver.run(&self.terms(found.follows_noise, &[]), |_| true);
        if self.priors().is_none() {
            solver.joints.drop_undetermined(&rays);
        }
        Attempt { rays, used_for, solver, init: found.init.clone(), bones: Vec::new(), ..*found }
    }

    fn outcome(&self, mut found: Attempt, given: Option<Rays>) -> Annealed {
        found.solver.joints.scale_to(&found.rays);
        found.solver.measure(found.follows_noise);
        let solution = found.solver.solution();
        let bars = self.bars(&found, &solution);
        let loss = self.loss(&found.rays, &solution);
        let known = |(x, status): (&Vector3<f64>, &JointStatus)| {
            x.x.is_finite() && *status != JointStatus::Unobserved
        };
        let observed = solution.points.iter().zip(&bars.status).any(known);
        let outcome = Outcome {
            points: solution.points,
            splats: Splats::Round(solution.sigma),
            init: found.init,
            used_for: found.used_for,
            loss,
            loss_history: Vec::new(),
            n_iter: solution.n_iter,
            stop_reason: match (observed, solution.converged) {
                (false, _) => StopReason::NoObservations,
                (true, true) => StopReason::Converged,
                (true, false) => StopReason::MaxSteps,
            },
        };
        Annealed { outcome, bars, rays: given.unwrap_or(found.rays) }
    }

    /// The terms of F (see [`crate::annealed`]): data and symmetry.
    fn loss(&self, rays: &Rays, solution: &Solution) -> Loss {
        let mut render = 0.0;
        for (j, x) in solution.points.iter().enumerate().filter(|(_, x)| x.x.is_finite()) {
            let scale = 2.0 * solution.sigma[j].powi(2) / solution.variance;
            for ray in there(rays.of_joint(j)) {
                render += ray.weight * scale * (1.0 - ray.offset(x).weight(solution.sigma[j]));
            }
        }
        let known =
            |(l, r): &&LimbPair| l.iter().chain(r).all(|j| solution.points[*j].x.is_finite());
        let pairs: Vec<LimbPair> = self.pairs.iter().filter(known).copied().collect();
        let symmetry = symmetry(|j| solution.points[j], &pairs, |_, _| ());
        Loss { total: render, render, symmetry }
    }
}

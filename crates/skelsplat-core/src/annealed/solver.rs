//! The loop: weights, normal equations, a step, a narrower kernel.

use nalgebra::Vector3;

use super::couplings::{Link, Scratch, couple, of_bone, of_pair};
use super::joints::Joints;
use super::lanes::{Four, LANES, ZERO, lane, set_lane};
use super::noise::{NoiseModel, Scale};
use super::problem::{Annealing, Prior, Solution};
use super::rays::Rays;
use crate::bones::Bone;
use crate::matrix3::ILL_CONDITIONED;
use crate::symmetry::LimbPair;

/// What takes part in a run besides the rays.
#[derive(Debug, Clone, Copy)]
pub struct Terms<'a> {
    /// Limbs of equal length.
    pub pairs: &'a [LimbPair],
    /// Bones of known length.
    pub bones: &'a [Bone],
    /// Settings.
    pub annealing: &'a Annealing,
    /// Kernel from which limb pairs and bones take part, mm.
    pub enter: f64,
    /// The run ends when no joint moves by more than this fraction of its standard deviation.
    pub tolerance: f64,
    /// Whether the final kernels may exceed [`Annealing::end`] where the noise requires it.
    pub follows_noise: bool,
}

/// Factor on the multiple of the noise for kernels above the configured ones, which makes them
/// reject sooner.
pub(super) const UPWARDS: f64 = 0.78;
/// Relative change of the variance from one step to the next at which kernels that follow the noise
/// have settled, and of a kernel to its final width at which it is narrow.
const STEADY: f64 = 0.05;

/// State of the search for a pose.
#[derive(Debug, Clone)]
pub(super) struct Solver {
    pub(super) joints: Joints,
    /// ŝ², for weight 1.
    pub(super) variance: f64,
    pub(super) model: NoiseModel,
    pub(super) n_iter: usize,
    /// The same when the last run began.
    begun: usize,
    pub(super) converged: bool,
    /// The longest move of a joint in the last step, in standard deviations.
    longest: f64,
    /// Whether all estimated joints took part in the last run.
    pub(super) whole: bool,
    links: Vec<Link>,
    scratch: Scratch,
}

impl Solver {
    /// Of joints that have their places, under this model of the noise.
    pub(super) fn new(joints: Joints, model: NoiseModel) -> Self {
        let (links, scratch) = (Vec::new(), Scratch::default());
        let mut solver = Self {
            joints,
            variance: 0.0,
            model,
            n_iter: 0,
            begun: 0,
            converged: false,
            longest: f64::INFINITY,
            whole: false,
            links,
            scratch,
        };
        let scale = solver.scale(false);
        solver.variance = model.variance([0.0; 2], f64::INFINITY, scale);
        solver
    }

    /// ŝ of a detection of mean weight.
    pub(super) fn noise(&self) -> f64 {
        (self.variance / self.joints.weight).sqrt()
    }

    /// Anneals the joints for which `moves` is true from where they are.
    pub(super) fn run(&mut self, terms: &Terms<'_>, moves: impl Fn(usize) -> bool) {
        self.release(terms, moves);
        (self.begun, self.converged) = (self.n_iter, false);
        self.proceed(terms);
    }

    /// Anneals the joints of the last run further.
    pub(super) fn proceed(&mut self, terms: &Terms<'_>) {
        let annealing = terms.annealing;
        let damping = annealing.start.powi(-2);
        self.converged &= self.longest <= terms.tolerance;
        let mut steady = !terms.follows_noise;
        while self.n_iter < self.begun + annealing.max_steps && !self.converged {
            self.joints.sum(1.0 / self.variance, damping);
            self.link(terms);
            self.solve();
            self.n_iter += 1;
            self.longest = self.step(annealing, steady);
            let before = self.variance;
            self.estimate_noise(terms.follows_noise);
            steady = !terms.follows_noise || (self.variance / before - 1.0).abs() < STEADY;
            self.converged = self.narrow(terms) && steady && self.longest <= terms.tolerance;
        }
    }

    fn release(&mut self, terms: &Terms<'_>, moves: impl Fn(usize) -> bool) {
        self.whole = true;
        let joints = &mut self.joints;
        for j in 0..joints.n_joints {
            let (g, l) = joints.place_of(j);
            let is_active = joints.is_active(j);
            let group = &mut joints.groups[g];
            group.settled[l] = !is_active || !moves(j);
            self.whole &= !is_active || !group.settled[l];
            (group.coupled[l], group.narrow[l]) = (false, false);
        }
        let of_pairs = terms.pairs.iter().flat_map(|(l, r)| l.iter().chain(r));
        for j in of_pairs.chain(terms.bones.iter().flat_map(|bone| &bone.joints)) {
            let (g, l) = joints.place_of(*j);
            joints.groups[g].coupled[l] = true;
        }
    }

    /// Collects the couplings between joints with narrow enough kernels.
    fn link(&mut self, terms: &Terms<'_>) {
        self.links.clear();
        let ready =
            |joints: &Joints, j: usize| joints.is_active(j) && joints.sigma(j) <= terms.enter;
        for pair in terms.pairs {
            let mut ends = pair.0.iter().chain(&pair.1);
            if ends.all(|j| ready(&self.joints, *j)) {
                let coupling = of_pair(pair, terms.annealing.symmetry_sigma, |j| self.joints.at(j));
                self.links.extend(coupling.map(|c| Link::new(c, &mut self.joints)));
            }
        }
        for bone in terms.bones {
            if bone.joints.iter().all(|j| ready(&self.joints, *j)) {
                let coupling = of_bone(bone, |j| self.joints.at(j));
                self.links.extend(coupling.map(|c| Link::new(c, &mut self.joints)));
            }
        }
    }

    /// The steps of all joints.
    fn solve(&mut self) {
        for group in &mut self.joints.groups {
            if group.is_settled() {
                (group.step, group.inverse) = ([Four::ZERO; 3], ZERO);
                continue;
            }
            let cofactors = group.block.cofactors();
            let determinant = group.block.determinant(&cofactors);
            let mut over = Four::ONE / determinant;
            for l in (0..LANES).filter(|l| group.settled[*l]) {
                set_lane(&mut over, l, 0.0);
            }
            group.inverse = cofactors.scaled(over);
            let scale = group.block.trace() * (1.0 / 3.0);
            let is_ill = determinant.simd_lt(scale * scale * scale * ILL_CONDITIONED);
            if is_ill.any() {
                group.invert_carefully();
            }
            group.step = group.inverse.times(&group.pull);
        }
        if !self.links.is_empty() {
            couple(&mut self.links, &mut self.joints, &mut self.scratch);
        }
    }

    /// Moves the joints, at most by the widest kernel; returns the longest step in standard
    /// deviations: √(δᵀ D δ) of a joint's own block, √Λ |gᵀ δ| of a coupling. What a step lacks
    /// along a ray that nothing else crosses means little. If `steady`, joints that no longer move
    /// settle.
    fn step(&mut self, annealing: &Annealing, steady: bool) -> f64 {
        let (most, small) = (Four::splat(annealing.start), annealing.tolerance.powi(2));
        let joints = &mut self.joints;
        let stretch =
            |link: &Link| link.coupling.precision * link.along(|s| joints.step(s)).powi(2);
        let mut longest = self.links.iter().map(stretch).fold(0.0, f64::max);
        for group in joints.groups.iter_mut().filter(|group| !group.is_settled()) {
            let ([x, y, z], held) = (group.step, group.block.times(&group.step));
            let square = x * held[0] + y * held[1] + z * held[2];
            let share = (most / (x * x + y * y + z * z).sqrt()).fast_min(Four::ONE);
            (0..3).for_each(|a| group.at[a] += group.step[a] * share);
            for l in 0..LANES {
                if !group.settled[l] {
                    let square = lane(&square, l);
                    longest = longest.max(square);
                    let is_free = group.narrow[l] && !group.coupled[l];
                    group.settled[l] = steady && is_free && square <= small;
                }
            }
        }
        longest.sqrt()
    }

    /// Narrows the kernels; returns whether all are final.
    fn narrow(&mut self, terms: &Terms<'_>) -> bool {
        let annealing = terms.annealing;
        let share = annealing.per_noise * self.noise() / annealing.base;
        let most = if terms.follows_noise { UPWARDS * share } else { 1.0 };
        let share = share.min(most.max(1.0));
        let mut done = true;
        let joints = &mut self.joints;
        for (s, j) in joints.joint.iter().enumerate() {
            let (group, l) = (&mut joints.groups[s / LANES], s % LANES);
            if group.settled[l] {
                continue;
            }
            let (sigma, end) = (lane(&group.sigma, l), annealing.end[*j] * share);
            group.narrow[l] = (sigma - end).abs() <= STEADY * end;
            done &= group.narrow[l];
            set_lane(&mut group.sigma, l, (sigma * annealing.factor).max(end));
        }
        done
    }

    /// The residuals and the noise at the present positions.
    pub(super) fn measure(&mut self, follows_noise: bool) {
        for j in 0..self.joints.n_joints {
            let (g, l) = self.joints.place_of(j);
            self.joints.groups[g].settled[l] = !self.joints.is_active(j);
        }
        self.joints.sum(1.0 / self.variance, 0.0);
        self.estimate_noise(follows_noise);
    }

    fn estimate_noise(&mut self, refuted: bool) {
        let [squares, freedom, sigma] = self.joints.totals();
        let mean = sigma / self.joints.n_joints as f64;
        self.variance = self.model.variance([squares, freedom], mean, self.scale(refuted));
    }

    fn scale(&self, refuted: bool) -> Scale {
        Scale { pixel: self.joints.pixel, weight: self.joints.weight, refuted }
    }

    pub(super) fn solution(&self) -> Solution {
        let joints = &self.joints;
        let all = 0..joints.n_joints;
        Solution {
            points: all.clone().map(|j| joints.at(j)).collect(),
            sigma: all.clone().map(|j| joints.sigma(j)).collect(),
            residuals: all.map(|j| joints.residuals(j)).collect(),
            noise: self.noise(),
            variance: self.variance,
            pixel: joints.pixel,
            n_iter: self.n_iter,
            converged: self.converged,
        }
    }
}

/// The solution that has its joints at `points`, for study and tests: with kernels as wide as this
/// `noise`.
pub fn solution_at(rays: &Rays, points: &[Vector3<f64>], noise: f64) -> Solution {
    let mut joints = Joints::new(rays, &[]);
    for (j, x) in points.iter().enumerate() {
        joints.put(j, x);
        joints.set_sigma(j, noise);
    }
    joints.scale_to(rays);
    let mut solver = Solver::new(joints, NoiseModel::Millimetres(noise));
    solver.measure(false);
    solver.solution()
}

/// ∇F at `points` `(3N)`, for study and tests: with kernels of standard deviation `sigma` and the
/// noise that `terms` give.
pub fn gradient(
    rays: &Rays,
    terms: &Terms<'_>,
    priors: &[Prior],
    points: &[Vector3<f64>],
    sigma: f64,
) -> Vec<f64> {
    let mut joints = Joints::new(rays, terms.pairs);
    joints.set_priors(priors);
    for (j, x) in points.iter().enumerate() {
        joints.put(j, x);
        joints.set_sigma(j, sigma);
    }
    let mut solver = Solver::new(joints, terms.annealing.noise);
    solver.release(terms, |_| true);
    solver.joints.sum(1.0 / solver.variance, 0.0);
    solver.link(terms);
    let joints = &solver.joints;
    let own = |j: usize| {
        let (g, l) = joints.place_of(j);
        joints.groups[g].pull.map(|p| -lane(&p, l))
    };
    let mut gradient: Vec<f64> = (0..points.len()).flat_map(own).collect();
    for coupling in solver.links.iter().map(|link| &link.coupling) {
        for (j, g) in coupling.ends() {
            let push = g * (coupling.residual * coupling.precision);
            (0..3).for_each(|a| gradient[3 * j + a] += push[a]);
        }
    }
    gradient
}

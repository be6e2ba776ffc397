//! The loop: weights, normal equations, a step, a narrower kernel.

use nalgebra::{Matrix3, Vector3};

use super::equations::{Coupling, NormalEquations};
use super::noise::{NoiseModel, Residuals, Scale, pixel_size};
use super::rays::{Ray, Rays, there};
use crate::bones::{Bone, Pull};
use crate::matrix3::Symmetric;
use crate::symmetry::LimbPair;

/// A Gaussian prior of one joint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// x⁰, mm.
    pub mean: Vector3<f64>,
    /// Π, the inverse of its covariance, mm⁻².
    pub precision: Matrix3<f64>,
    /// Largest standard deviation along an axis of the world, mm; 0 if it has none.
    pub spread: f64,
}

/// The annealing schedule and the stopping rule.
#[derive(Debug, Clone, PartialEq)]
pub struct Annealing {
    /// Widest kernel, mm.
    pub start: f64,
    /// Final kernel of each joint, mm; narrower according to `per_noise`.
    pub end: Vec<f64>,
    /// The final kernel of a joint with `end` equal to `base` is at most this multiple of the
    /// noise, that of others in proportion to `end`; infinite: always `end`.
    pub per_noise: f64,
    /// See [`Self::per_noise`], mm.
    pub base: f64,
    /// Factor from one step to the next.
    pub factor: f64,
    /// σ_sym, mm.
    pub symmetry_sigma: f64,
    /// Maximum number of steps.
    pub max_steps: usize,
    /// The solver stops when no joint moves by more than this fraction of the noise.
    pub tolerance: f64,
    /// Model of the noise.
    pub noise: NoiseModel,
}

impl Annealing {
    /// Widest final kernel, mm.
    pub const END: f64 = 30.0;
    /// Final σ as a multiple of the noise.
    pub const PER_NOISE: f64 = 2.0;
    /// σ_sym, mm.
    pub const SYMMETRY_SIGMA: f64 = 15.0;
}

/// A pose to be found.
#[derive(Debug, Clone, Copy)]
pub struct Problem<'a> {
    /// The detections.
    pub rays: &'a Rays,
    /// Limbs of equal length.
    pub pairs: &'a [LimbPair],
    /// Bones of known length.
    pub bones: &'a [Bone],
    /// Prior of each joint `(N)`, if any.
    pub priors: Option<&'a [Prior]>,
    /// Settings.
    pub annealing: &'a Annealing,
    /// Whether the final kernels follow larger noise.
    pub widening: Widening,
}

/// Whether the final kernels follow larger noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Widening {
    /// Whether they may exceed [`Annealing::end`] where the noise requires it.
    pub follows_noise: bool,
    /// Share of the residuals' variance that is noise; the rest are wrong detections that the
    /// kernel lets through.
    pub noise_share: f64,
}

impl Widening {
    /// They end where they are configured. The share is measured (docs/decisions.md).
    pub const NONE: Self = Self { follows_noise: false, noise_share: 0.87 };
    /// They follow noise that is given.
    pub const FREE: Self = Self { follows_noise: true, ..Self::NONE };
}

/// Positions of the joints, and their residuals.
#[derive(Debug, Clone)]
pub struct Solution {
    /// Positions `(N)`, mm; as given where a joint has no detection.
    pub points: Vec<Vector3<f64>>,
    /// Kernel of each joint at the end, mm.
    pub sigma: Vec<f64>,
    /// Residuals of each joint at the end.
    pub residuals: Vec<Residuals>,
    /// Standard deviation of the detection noise across the ray, mm, for a detection of mean
    /// weight.
    pub noise: f64,
    /// ŝ², mm²: the variance for weight 1, as in F.
    pub variance: f64,
    /// Mean size of a pixel at the joints, mm.
    pub pixel: f64,
    /// Steps taken.
    pub n_iter: usize,
    /// Whether the steps became small.
    pub converged: bool,
    /// The system at the solution, undamped, for the covariance.
    pub equations: NormalEquations,
}

/// Reach of the kernel of limb pairs, in σ_sym: pairs that differ by more lose their influence like
/// outlying detections.
const SYMMETRY_REACH: f64 = 3.0;
/// Factor on the multiple of the noise for kernels above the configured ones, which makes them
/// reject sooner.
const UPWARDS: f64 = 0.78;
/// Maximum step, as a fraction of the distance to the nearest camera.
const TRUST: f64 = 0.5;

/// Sums over the rays of one joint.
#[derive(Debug, Clone, Copy)]
struct Sums {
    /// Σ c k.
    weight: f64,
    /// Σ c k d dᵀ.
    outer: Symmetric,
    /// −Σ c k e.
    pull: Vector3<f64>,
    squares: f64,
    support: f64,
    /// Square of the distance of the farthest ray.
    farthest: f64,
    /// Square of the distance of the nearest camera: along the ray of a wrong detection it may be 0
    /// anywhere.
    nearest: f64,
}

impl Default for Sums {
    fn default() -> Self {
        Self {
            weight: 0.0,
            outer: Symmetric::default(),
            pull: Vector3::zeros(),
            squares: 0.0,
            support: 0.0,
            farthest: 0.0,
            nearest: f64::INFINITY,
        }
    }
}

impl Sums {
    #[inline]
    fn add(&mut self, ray: &Ray, x: &Vector3<f64>, sigma: f64) {
        let offset = ray.offset(x);
        let k = offset.weight(sigma);
        let w = ray.weight * k;
        let square = offset.across.norm_squared();
        self.outer.add_outer(w, &ray.direction);
        self.weight += w;
        self.pull -= w * offset.across;
        self.squares += w * square;
        self.support += k;
        self.farthest = self.farthest.max(square);
        if offset.range > 0.0 {
            self.nearest = self.nearest.min(offset.range * offset.range + square);
        }
    }

    /// Σ c k (I − d dᵀ).
    fn information(&self) -> Matrix3<f64> {
        self.outer.below(self.weight).matrix()
    }
}

/// State of one joint.
#[derive(Debug, Clone, Copy)]
struct JointState {
    at: Vector3<f64>,
    /// Kernel; infinite at first, so that every detection has full weight.
    sigma: f64,
    residuals: Residuals,
    /// Distance of the farthest ray.
    farthest: f64,
    /// Distance of the nearest camera.
    nearest: f64,
    /// Whether it is estimated: it has a position, and a detection or a prior.
    active: bool,
    /// Whether a limb pair couples it.
    coupled: bool,
    /// Whether its kernel is the final one.
    narrow: bool,
    /// Whether it is uncoupled and has converged under its final kernel, and is therefore skipped.
    settled: bool,
}

/// State of a run.
struct Solver<'a> {
    problem: &'a Problem<'a>,
    joints: Vec<JointState>,
    variance: f64,
    pixel: f64,
    /// Mean weight of the detections.
    weight: f64,
    equations: NormalEquations,
}

/// Solves `problem` from `start`, in which joints may be NaN and then stay NaN. `sigma` is the
/// initial kernel; infinite means plain least squares first, after which the start no longer
/// matters where the detections determine a joint.
pub fn solve(problem: &Problem<'_>, start: &[Vector3<f64>], sigma: &[f64]) -> Solution {
    let mut run = Solver::new(problem, start, sigma);
    let annealing = problem.annealing;
    let (mut n_iter, mut converged) = (0, false);
    while n_iter < annealing.max_steps && !converged {
        run.linearise();
        let longest = run.step();
        n_iter += 1;
        let narrow = run.narrow();
        converged = narrow && longest <= run.small();
    }
    run.finish();
    Solution {
        points: run.joints.iter().map(|joint| joint.at).collect(),
        sigma: run.joints.iter().map(|joint| joint.sigma).collect(),
        residuals: run.joints.iter().map(|joint| joint.residuals).collect(),
        noise: (run.variance / run.weight).sqrt(),
        variance: run.variance,
        pixel: run.pixel,
        n_iter,
        converged,
        equations: run.equations,
    }
}

impl<'a> Solver<'a> {
    fn new(problem: &'a Problem<'a>, points: &[Vector3<f64>], sigma: &[f64]) -> Self {
        let mut joints: Vec<JointState> =
            (0..points.len()).map(|j| joint(problem, j, points[j], sigma[j])).collect();
        let of_pairs = problem.pairs.iter().flat_map(|(l, r)| l.iter().chain(r));
        for j in of_pairs.chain(problem.bones.iter().flat_map(|bone| &bone.joints)) {
            joints[*j].coupled = true;
        }
        let mut run = Self {
            pixel: pixel_size(problem.rays, points.iter().copied()).unwrap_or(1.0),
            weight: problem.rays.mean_weight(),
            equations: NormalEquations::new(points.len()),
            variance: 0.0,
            joints,
            problem,
        };
        let none = std::iter::empty();
        run.variance = problem.annealing.noise.variance(none, f64::INFINITY, run.scale());
        run
    }

    /// Fills the normal equations at the present points: D = Σ c k (I − d dᵀ)/ŝ² + Π, −∇ = −Σ c k
    /// e/ŝ² − Π(x − x⁰).
    fn linearise(&mut self) {
        let precision = 1.0 / self.variance;
        for (j, joint) in self.joints.iter_mut().enumerate() {
            if joint.settled {
                continue;
            }
            let x = joint.at;
            let mut sums = Sums::default();
            if joint.active {
                for ray in there(self.problem.rays.of_joint(j)) {
                    sums.add(ray, &x, joint.sigma);
                }
            }
            let (mut block, mut pull) = (sums.information() * precision, sums.pull * precision);
            if let Some(prior) = self.problem.priors.map(|p| &p[j]).filter(|_| joint.active) {
                block += prior.precision;
                pull -= prior.precision * (x - prior.mean);
            }
            self.equations.set(j, block, pull);
            joint.residuals = Residuals::new(sums.squares, sums.support);
            (joint.farthest, joint.nearest) = (sums.farthest.sqrt(), sums.nearest.sqrt());
        }
        self.couple();
    }

    /// Limb pairs as scalar residuals r = ‖l‖ − ‖r‖, once the joints match their detections.
    fn couple(&mut self) {
        self.equations.uncouple();
        let sigma = self.problem.annealing.symmetry_sigma;
        for ([l1, l2], [r1, r2]) in self.problem.pairs.iter().copied() {
            let numbers = [l1, l2, r1, r2];
            let joints = numbers.map(|j| &self.joints[j]);
            if joints.iter().any(|joint| !joint.active || joint.sigma.is_infinite()) {
                continue;
            }
            let (left, right) = (joints[0].at - joints[1].at, joints[2].at - joints[3].at);
            let (ll, lr) = (left.norm(), right.norm());
            if ll > 0.0 && lr > 0.0 {
                let (residual, el, er) = (ll - lr, left / ll, right / lr);
                let kept = (-0.5 * (residual / (SYMMETRY_REACH * sigma)).powi(2)).exp();
                self.equations.couple(Coupling {
                    joints: numbers,
                    gradient: [el, -el, -er, er],
                    residual,
                    precision: kept / (sigma * sigma),
                });
            }
        }
        self.couple_bones();
    }

    /// Bones as scalar residuals r = ‖x_a − x_b‖ − l.
    fn couple_bones(&mut self) {
        for bone in self.problem.bones {
            let [a, b] = bone.joints.map(|j| &self.joints[j]);
            if [a, b].iter().any(|joint| !joint.active || joint.sigma.is_infinite()) {
                continue;
            }
            let pull = Pull::new(&a.at, &b.at, bone.length);
            self.equations.couple(Coupling::of_bone(bone.joints, &pull));
        }
    }

    /// Largest step treated as zero, mm.
    fn small(&self) -> f64 {
        self.problem.annealing.tolerance * (self.variance / self.weight).sqrt()
    }

    /// Moves the joints and returns the longest step, mm.
    fn step(&mut self) -> f64 {
        let damping = self.problem.annealing.start.powi(-2);
        let small = self.small();
        let joints = &self.joints;
        self.equations.bend(|a, b| (joints[a].at - joints[b].at).norm());
        let steps = self.equations.solve(|_| damping);
        let mut longest = 0.0_f64;
        for (joint, step) in self.joints.iter_mut().zip(steps) {
            if !joint.active || joint.settled {
                continue;
            }
            let length = step.norm();
            joint.settled = length <= small && joint.narrow && !joint.coupled;
            let most = TRUST * joint.nearest;
            let step = if length > most { step * (most / length) } else { *step };
            joint.at += step;
            longest = longest.max(length);
        }
        longest
    }

    /// Re-estimates the noise, once every joint has a kernel, and narrows the kernels; returns
    /// whether all are final.
    fn narrow(&mut self) -> bool {
        let annealing = self.problem.annealing;
        let first = self.joints.iter().any(|joint| joint.sigma.is_infinite());
        if first {
            let points = self.joints.iter().map(|joint| joint.at);
            self.pixel = pixel_size(self.problem.rays, points).unwrap_or(self.pixel);
            self.measure();
        } else {
            self.estimate_noise();
        }
        let noise = (self.variance / self.weight).sqrt();
        let share = annealing.per_noise * noise / annealing.base;
        let most = if self.problem.widening.follows_noise { UPWARDS * share } else { 1.0 };
        let share = share.min(most.max(1.0));
        let mut done = true;
        for (joint, end) in self.joints.iter_mut().zip(&annealing.end) {
            let end = end * share;
            let next = if joint.sigma.is_infinite() {
                joint.farthest.min(annealing.start)
            } else {
                joint.sigma * annealing.factor
            };
            joint.narrow = joint.sigma <= 1.05 * end;
            done &= !joint.active || joint.settled || joint.narrow;
            if !joint.settled {
                joint.sigma = next.max(end);
            }
        }
        done
    }

    /// The system and the noise at the final positions.
    fn finish(&mut self) {
        for (joint, end) in self.joints.iter_mut().zip(&self.problem.annealing.end) {
            joint.settled = false;
            joint.sigma = if joint.sigma.is_finite() { joint.sigma } else { *end };
        }
        self.linearise();
        self.estimate_noise();
    }

    fn estimate_noise(&mut self) {
        let sum: f64 = self.joints.iter().map(|joint| joint.sigma).sum();
        let mean = sum / self.joints.len() as f64;
        let residuals = self.joints.iter().map(|joint| joint.residuals);
        let model = self.problem.annealing.noise;
        self.variance = model.variance(residuals, mean, self.scale());
    }

    fn scale(&self) -> Scale {
        let refuted = self.problem.widening.follows_noise;
        Scale { pixel: self.pixel, weight: self.weight, refuted }
    }

    /// Distance of each joint's farthest ray.
    fn measure(&mut self) {
        for (j, joint) in self.joints.iter_mut().enumerate() {
            let squares = there(self.problem.rays.of_joint(j))
                .map(|ray| ray.offset(&joint.at).across.norm_squared());
            joint.farthest = squares.fold(0.0, f64::max).sqrt();
        }
    }
}

/// Joint `j` before the first step.
fn joint(problem: &Problem<'_>, j: usize, at: Vector3<f64>, sigma: f64) -> JointState {
    let known = at.iter().all(|v| v.is_finite());
    let has_prior = || problem.priors.is_some_and(|p| p[j].precision.trace() > 0.0);
    let seen = || problem.rays.of_joint(j).iter().any(Ray::is_there);
    JointState {
        at,
        sigma,
        residuals: Residuals::default(),
        farthest: 0.0,
        nearest: f64::INFINITY,
        active: known && (seen() || has_prior()),
        coupled: false,
        narrow: false,
        settled: false,
    }
}

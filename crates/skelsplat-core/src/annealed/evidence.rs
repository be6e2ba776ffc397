//! The one evidence: what speaks for an explanation of a frame.
//!
//! A kernel that ends narrow explains two or three of four scattered rays and rejects the others; a
//! wide one explains all by larger noise. Either is a model of the same frame: a detection of view
//! i is correct with probability 1 − ε_i and then lies within the noise s_ij² = ŝ²/c_ij, or it is
//! wrong and lies within S, or, one in ten of these, anywhere in the image,
//!
//! ```text
//! p(e) = (1−ε_i) N₂(e; s²) + ε_i (0.9 N₂(e; S²) + 0.1 W/2π (W² + e²)^−3/2)
//! log p = log Σ_S p(S) Π_i Σ_ε p(ε_i) Π_j p(e_ij) − ½ Σ_j log det H_j
//! H_j  = Σ_i r_ij (I − d dᵀ)/s² + I/W²            r = (1−ε_i) N₂(e; s²) / p(e)
//! ```
//!
//! with the joints integrated out by Laplace's method: that two rays nearly meet somewhere is no
//! evidence for small noise, since the volume in which they do so shrinks with it. Every view has
//! its own ε, since its calibration may be wrong. ε and S are summed over, not chosen: a few
//! detections cannot be sure of them. A prior adds −½ (x−x⁰)ᵀ Π (x−x⁰) to log p and Π to H.

use super::across::{FourRays, FourViews};
use super::joints::Joints;
use super::lanes::{Four, LANES, ZERO, added, exp, exp_of_one, lane, ln};
use super::noise::PRIOR_DOF;
use super::problem::Prior;
use super::rays::{Rays, there};
use crate::matrix3::Symmetric;
use nalgebra::Vector3;

/// Shares ε of wrong detections in a view, as likely as each other: from the best detectors in
/// sight of everything to a camera that stands elsewhere.
const SHARES: [f64; 4] = [0.01, 0.06, 0.3, 0.8];
/// Distances S of wrong detections, as likely as each other: W, W/2 and W/4.
const SCALES: usize = 3;
/// Least S in multiples of the noise.
const LEAST_REACH: f64 = 2.5;
/// Share of the wrong detections that may be as far away as the image reaches, and of the frames
/// before which something else has happened: a cut, or a wrong past.
pub(super) const ASTRAY: f64 = 0.1;

/// Which detections are wrong.
#[derive(Debug, Clone, Default)]
pub struct Mixture {
    /// ŝ² for weight 1.
    variance: f64,
    /// W².
    widest: f64,
    /// c̄.
    weight: f64,
    /// Posterior probability of each S.
    scales: [f64; SCALES],
    /// Density of a wrong detection besides, times 2πW².
    flat: f64,
    /// Posterior mean of ε_i.
    wrong: Vec<f64>,
    /// Its mean over the views that detect anything.
    share: f64,
}

/// The evidence for an explanation.
#[derive(Debug, Clone, Default)]
pub struct Evidence {
    /// log p up to a constant common to all explanations with the same set of positioned joints.
    pub log: f64,
    /// The share of wrong detections of all views.
    pub wrong: f64,
    /// Which detections are wrong.
    pub mixture: Mixture,
}

impl Mixture {
    /// N₂(e; s²), and the density of a wrong detection for each S, times 2πW².
    #[inline(always)]
    fn densities(&self, square: Four) -> (Four, [Four; SCALES]) {
        let near = exp(square * (-0.5 * self.weight / self.variance));
        let e = square * (1.0 / self.widest);
        let beyond = e + 1.0;
        let tail = Four::splat(ASTRAY) / (beyond * beyond.sqrt());
        let (mut kernel, mut height) = (exp(e * -0.5), 1.0 - ASTRAY);
        let far = std::array::from_fn(|_| {
            let far = kernel * height + tail;
            (kernel, height) = ((kernel * kernel) * (kernel * kernel), 4.0 * height);
            far
        });
        (near * (self.weight * self.widest / self.variance), far)
    }

    /// The density of a wrong detection, whatever S is.
    #[inline(always)]
    fn astray(&self, far: &[Four; SCALES]) -> Four {
        let each = far.iter().zip(self.scales).map(|(far, p)| *far * p);
        each.fold(Four::splat(self.flat), |sum, p| sum + p)
    }

    /// The same with one ε of all views, and wrong detections anywhere: which views are wrong, and
    /// how far off, is what rival places disagree on, and what one of them says may not decide.
    #[must_use]
    pub fn undecided(&self) -> Self {
        Self {
            wrong: vec![self.share; self.wrong.len()],
            scales: [0.0; SCALES],
            flat: 1.0,
            ..self.clone()
        }
    }

    /// The same with the variance `by` times as large.
    #[must_use]
    pub fn noisier(&self, by: f64) -> Self {
        Self { variance: by * self.variance, ..self.clone() }
    }

    /// log p of the rays of a joint at `x`, and of its prior, with the volume in which it may lie;
    /// and the information on where that is.
    pub(super) fn at(
        &self,
        views: &[FourViews],
        x: &Vector3<f64>,
        prior: Option<&Prior>,
    ) -> (f64, Symmetric) {
        let (mut outer, mut weight, mut log_p) = (ZERO, Four::ZERO, Four::ZERO);
        for four in views {
            let (across, rays) = (four.across(x), &four.rays);
            let share = Four::new(four.views.map(|i| self.wrong.get(i).copied().unwrap_or(1.0)));
            let (near, far) = self.densities(across.square);
            let near = across.range.simd_gt(Four::ZERO) & (near * (Four::ONE - share));
            let p = near + share * self.astray(&far);
            log_p += rays.weight * ln(p);
            let w = rays.weight * near / p;
            weight += w;
            outer.add_outer(w, &rays.direction);
        }
        let mut log_p = log_p.reduce_add() / self.weight;
        let least = 1.0 / self.widest;
        let mut information = added(&outer).below(weight.reduce_add(), 1.0 / self.variance, least);
        if let Some(prior) = prior {
            let off = x - prior.mean;
            log_p -= 0.5 * off.dot(&(prior.precision * off));
            information.add(&Symmetric::of(&prior.precision));
        }
        (log_p - 0.5 * information.determinant(&information.cofactors()).ln(), information)
    }
}

/// log Σ exp of `logs` under equal priors, and the posterior probability of each.
pub(super) fn averaged<const N: usize>(logs: [f64; N]) -> (f64, [f64; N]) {
    let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights = logs.map(|log| exp_of_one(log - most));
    let all: f64 = weights.iter().sum();
    (most + (all / N as f64).ln(), weights.map(|w| w / all))
}

/// Densities of a detection of each of four joints in one view.
struct Seen {
    /// c/c̄, 0 where there is no detection.
    there: Four,
    near: Four,
    far: [Four; SCALES],
}

impl Seen {
    /// Of every group and view.
    fn all(joints: &Joints, mixture: &Mixture) -> Vec<Self> {
        let m = joints.n_views;
        let of = |(k, ray): (usize, &FourRays)| {
            let across =
                ray.across(&joints.groups[k / m].at, &joints.centres[k % m].map(Four::splat));
            let (near, far) = mixture.densities(across.square);
            let there = joints.groups[k / m].live * ray.weight * (1.0 / joints.weight);
            Self { there, near: across.range.simd_gt(Four::ZERO) & near, far }
        };
        joints.rays.iter().enumerate().map(of).collect()
    }

    /// log Σ_ε p(ε) Π_j p(e_ij) of the view that has every `m`-th of these, and the posterior mean
    /// of ε, where wrong detections have the scale `s`.
    fn of_view(seen: &[Self], m: usize, s: usize) -> (f64, f64) {
        let mut log = [Four::ZERO; SHARES.len()];
        for Self { there, near, far } in seen.iter().step_by(m) {
            for (log, share) in log.iter_mut().zip(SHARES) {
                *log += *there * ln(*near * (1.0 - share) + far[s] * share);
            }
        }
        let (log, weights) = averaged(log.map(Four::reduce_add));
        (log, weights.iter().zip(SHARES).map(|(w, share)| w * share).sum())
    }
}

/// The mean share ε of wrong detections of the views that detect anything.
fn mean_share(seen: &[Seen], wrong: &[f64]) -> f64 {
    let m = wrong.len();
    let detects = |i: &usize| seen.iter().skip(*i).step_by(m).any(|s| s.there != Four::ZERO);
    let (sum, views) =
        (0..m).filter(detects).fold((0.0, 0.0), |(sum, n), i| (sum + wrong[i], n + 1.0));
    sum / f64::max(views, 1.0)
}

/// The evidence of the frame for the `joints` where they are and this `variance`; `widest` is W,
/// mm.
pub(super) fn evidence(joints: &Joints, variance: f64, widest: f64) -> Evidence {
    let (m, widest) = (joints.n_views, widest * widest);
    let mut mixture = Mixture { variance, widest, weight: joints.weight, ..Mixture::default() };
    let seen = Seen::all(joints, &mixture);
    let least = LEAST_REACH * LEAST_REACH * variance / joints.weight;
    let mut logs = [f64::NEG_INFINITY; SCALES];
    let mut shares = vec![[0.0; SCALES]; m];
    for s in 0..SCALES {
        if s == 0 || widest / 4f64.powi(s as i32) >= least {
            logs[s] = 0.0;
            for (i, shares) in shares.iter_mut().enumerate() {
                let (log, wrong) = Seen::of_view(&seen[i.min(seen.len())..], m, s);
                logs[s] += log;
                shares[s] = wrong;
            }
        }
    }
    let (mut log, scales) = averaged(logs);
    mixture.scales = scales;
    let mean = |of_view: &[f64; SCALES]| of_view.iter().zip(scales).map(|(v, p)| p * v).sum();
    mixture.wrong = shares.iter().map(mean).collect();
    mixture.share = mean_share(&seen, &mixture.wrong);
    let [mut correct, mut count] = [Four::ZERO; 2];
    for (g, group) in joints.groups.iter().enumerate() {
        let (mut weight, mut outer) = (Four::ZERO, Symmetric::default());
        let of_group = seen[g * m..(g + 1) * m].iter().zip(&joints.rays[g * m..]);
        for ((Seen { there, near, far }, ray), wrong) in of_group.zip(&mixture.wrong) {
            let near = *near * (1.0 - wrong);
            let r = *there * near / (near + mixture.astray(far) * *wrong);
            correct += r;
            count += *there;
            let w = r * joints.weight;
            outer.add_outer(w, &ray.direction);
            weight += w;
        }
        let least = Four::splat(1.0 / widest);
        let mut information = outer.below(weight, Four::splat(1.0 / variance), least);
        log -= joints.against_priors(g, &mut information);
        let volume = ln(information.determinant(&information.cofactors())) * 0.5;
        log -= (0..LANES).map(|l| lane(&group.live, l) * lane(&volume, l)).sum::<f64>();
    }
    let wrong = (count - correct).reduce_add() / f64::max(count.reduce_add(), 1.0);
    Evidence { log, wrong, mixture }
}

/// The evidence of joints at `points`, for study and tests.
pub fn evidence_at(
    rays: &Rays,
    points: &[Vector3<f64>],
    variance: f64,
    priors: &[Prior],
    widest: f64,
) -> Evidence {
    let mut joints = Joints::new(rays, &[]);
    points.iter().enumerate().for_each(|(j, x)| joints.put(j, x));
    joints.set_priors(priors);
    evidence(&joints, variance, widest)
}

/// Whether three views see any joint, so that two of them can outvote the third.
pub(super) fn can_outvote(rays: &Rays) -> bool {
    let views = |j: usize| there(rays.of_joint(j)).count();
    (0..rays.n_joints()).any(|j| views(j) > 2)
}

/// Factor on the squares of error bars for a noise estimated from few residuals: the variance of
/// Student's t. Two views leave one residual per joint, three views three.
pub(super) fn of_few(rays: &Rays) -> f64 {
    let freedom = rays.n_joints() as f64;
    if can_outvote(rays) || freedom < PRIOR_DOF { 1.0 } else { freedom / (freedom - 2.0) }
}

//! The loop over a stretch of frames: weights, one sparse system, a step, a narrower kernel.

use nalgebra::{Matrix3, Vector3};

use super::chain::{Band, Chain, add_stiffness};
use super::noise::DetectionNoise;
use super::process_noise::ProcessNoise;
use super::system::System;
use super::times::{SHORT, around, frames_in};
use super::tracks::Tracks;
use crate::annealed::Annealing;
use crate::batch::Progress;
use crate::bones::{Length, Pull, REACH};
use crate::error::Result;
use crate::matrix3::{Symmetric, inverse, times};

/// What is common to all frames of a recording; lengths are mm, times s.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Common {
    /// Frames per second.
    pub fps: f64,
    /// Joints at both ends of every bone.
    pub bones: Vec<[usize; 2]>,
    /// Their lengths.
    pub lengths: Vec<Length>,
    /// The process noise of each joint.
    pub process_noise: Vec<ProcessNoise>,
    /// The detections' noise.
    pub noise: DetectionNoise,
    /// Root mean square distance of the joints from the body's centre, mm: no joint is unknown
    /// beyond it.
    pub reach: f64,
}

impl Common {
    /// The usual process noise of each joint, mm²/s³.
    pub(super) fn usual(&self) -> Vec<f64> {
        self.process_noise.iter().map(|process_noise| process_noise.usual).collect()
    }
}

/// Kernels in multiples of the final ones, the widest first, with the maximum number of steps under
/// each.
pub type Schedule = [(f64, usize)];

/// From wide kernels to those under which the noise is measured,
pub const WIDE: &Schedule = &[(8.0, 1), (NARROWEST, 2)];
/// and the last of them.
pub const NARROWEST: f64 = 2.0;
/// On to the final ones.
pub const NARROW: &Schedule = &[(1.0, 3)];
/// Under the final kernels only.
pub const SETTLE: &Schedule = &[(1.0, 6)];

/// Rounds of conjugate gradients per step.
const ROUNDS: usize = 8;
/// Their relative accuracy.
const ACCURACY: f64 = 0.05;
/// Rounds of the smoothing from which the annealing starts.
const SMOOTHING: usize = 4;
/// Reach of its kernel for positions on which views do not agree, and live of that of the
/// prediction, in standard deviations; from as many on, the measured and the expected length of a
/// bone contradict each other.
pub(super) const UNSURE_REACH: f64 = 3.0;

/// The state of a run over one stretch.
pub struct WindowSolver<'a> {
    pub(super) tracks: &'a Tracks,
    pub(super) common: &'a Common,
    /// Positions `(N, T)`; zero where inactive.
    pub points: Vec<Vector3<f64>>,
    /// The system, filled by [`WindowSolver::linearise`].
    pub system: System,
    /// Steps taken.
    pub n_iter: usize,
}

/// k and the offsets of the rays of one joint `(T, M)`, and the running sums of k and of their
/// number.
type Weighed = (Vec<(f64, Vector3<f64>)>, Vec<[f64; 2]>);

impl<'a> WindowSolver<'a> {
    /// A run that starts at `points` `(N, T)`, or at the smoothed positions of the frames alone.
    pub fn new(tracks: &'a Tracks, common: &'a Common, points: Option<Vec<Vector3<f64>>>) -> Self {
        let system = System::new(tracks.frames, tracks.joints, &common.bones);
        let smooth = points.is_none();
        let points = points.unwrap_or_else(|| vec![Vector3::zeros(); tracks.active.len()]);
        let mut run = Self { tracks, common, points, system, n_iter: 0 };
        if smooth {
            (0..tracks.joints).for_each(|j| run.smooth(j));
        }
        run
    }

    /// Anneals along `schedule`, without filling the system at the last positions.
    ///
    /// # Errors
    /// [`crate::Error::Cancelled`] once `progress` is cancelled.
    pub fn anneal(&mut self, schedule: &Schedule, progress: &Progress) -> Result<()> {
        for (wider, steps) in schedule {
            for _ in 0..*steps {
                progress.check()?;
                self.linearise(*wider);
                self.n_iter += 1;
                if self.step() < Annealing::TOLERANCE {
                    break;
                }
            }
        }
        Ok(())
    }

    /// Fills the system at the present positions under kernels `wider` than the final ones.
    pub fn linearise(&mut self, wider: f64) {
        for j in 0..self.tracks.joints {
            self.couple(j, REACH);
            self.see(j, wider);
            let (of, system) = (self.system.of(j), &mut self.system);
            let pulls = &mut system.pulls[of.clone()];
            add_stiffness(&system.weights[of.clone()], &self.points[of], -1.0, pulls);
        }
        self.pull_of_bones();
    }

    /// The selected inverse of joint `j`'s chain; a joint lies within `reach` (see [`Common`]) of
    /// the body's centre.
    pub fn bands(&self, j: usize) -> Vec<Band> {
        let of = self.system.of(j);
        let blocks = &self.system.blocks[of.clone()];
        let reach = Matrix3::from_diagonal_element(self.common.reach.powi(-2));
        let mut chain = Chain::default();
        chain.factorise(&self.system.weights[of], |t| blocks[t] + reach);
        chain.selected_inverse()
    }

    /// One step δ; returns its root mean square in standard deviations, √(δᵀ H δ/NT), with H δ =
    /// −∇.
    fn step(&mut self) -> f64 {
        let step = self.system.solve(Annealing::START.powi(-2), ACCURACY, ROUNDS);
        let mut squares = 0.0;
        for ((x, step), pull) in self.points.iter_mut().zip(step).zip(&self.system.pulls) {
            let length = step.norm();
            *x += if length > Annealing::START { step * (Annealing::START / length) } else { step };
            squares += step.dot(pull);
        }
        (squares / self.points.len() as f64).sqrt()
    }

    /// The detections of joint `j`: Σ c k k̄ (I − d dᵀ)/ŝ² and −Σ c k k̄ e/ŝ², where k̄ is the mean
    /// of k over the frames around: errors that are not noise last. Where three views agree on a
    /// position and none disagrees, k and k̄ do not fall below their values at this position: the
    /// other frames never outvote them.
    fn see(&mut self, j: usize, wider: f64) {
        let (kept, sums) = self.weigh(j, wider);
        let (views, of) = (self.tracks.views, self.system.of(j));
        let reach = frames_in(SHORT, self.common.fps);
        let (rays, weights) = self.tracks.of_joint(j);
        let system = &mut self.system;
        let own = system.blocks[of.clone()].iter_mut().zip(&mut system.pulls[of.clone()]);
        for (t, (block, pull)) in own.enumerate() {
            (*block, *pull) = (Matrix3::identity(), Vector3::zeros());
            if !self.tracks.active[of.start + t] {
                continue;
            }
            let near = around(t, reach, of.len());
            let first = &sums[near.start * views..][..views];
            let last = &sums[near.end * views..][..views];
            let (mut weight, mut outer) = (0.0, Symmetric::default());
            for (i, r) in (t * views..(t + 1) * views).enumerate() {
                let (k, across) = kept[r];
                if k > 0.0 {
                    let around = [0, 1].map(|a| last[i][a] - first[i][a]);
                    let w = weights[r].precision * k * (around[0] / around[1]).max(weights[r].held);
                    outer.add_outer(w, &rays[r].direction.into());
                    weight += w;
                    *pull -= across * w;
                }
            }
            *block = outer.below(weight, 1.0, 0.0).matrix();
        }
    }

    /// The rays of joint `j`; k is at least the held weight.
    fn weigh(&self, j: usize, wider: f64) -> Weighed {
        let (views, of) = (self.tracks.views, self.system.of(j));
        let (mut kept, mut sums) = (Vec::with_capacity(of.len() * views), vec![[0.0; 2]; views]);
        let ((rays, weights), narrower) = (self.tracks.of_joint(j), wider.powi(-2));
        let seen = self.tracks.active[of.clone()].iter().zip(&self.points[of]);
        for (t, (active, x)) in seen.enumerate() {
            for r in t * views..(t + 1) * views {
                let [sum, n] = sums[r];
                let ray = &rays[r];
                if *active && ray.is_there() {
                    let offset = ray.offset(x);
                    let k = weights[r].kernel(&offset, narrower).max(weights[r].held);
                    kept.push((k, offset.across));
                    sums.push([sum + k, n + 1.0]);
                } else {
                    kept.push((0.0, Vector3::zeros()));
                    sums.push([sum, n]);
                }
            }
        }
        (kept, sums)
    }

    /// The weights of joint `j`'s second differences, 1/(q dt³), less where the acceleration is
    /// larger than usual: it is measured over [`SHORT`], so that the frame rate does not
    /// matter. There is none across a cut.
    fn couple(&mut self, j: usize, reach: f64) {
        let of = self.system.of(j);
        let (x, active) = (&self.points[of.clone()], &self.tracks.active[of.clone()]);
        let n = x.len();
        let dt = 1.0 / self.common.fps;
        let local = self.tracks.process_noise.get(of.clone());
        let h = frames_in(SHORT, self.common.fps);
        let usual = |q: f64, h: usize| {
            3.0 * q * (h as f64 * dt).powi(3) * if h > 1 { 2.0 / 3.0 } else { 1.0 }
        };
        let w = &mut self.system.weights[of];
        w.fill(0.0);
        for t in 1..n.saturating_sub(1) {
            let joined = |h: usize| !self.tracks.is_cut(t - h, t + h);
            if !(active[t - 1] && active[t] && active[t + 1] && joined(1)) {
                continue;
            }
            let wide = t >= h && t + h < n && active[t - h] && active[t + h] && joined(h);
            let h = if wide { h } else { 1 };
            let q = local.map_or(self.common.process_noise[j].usual, |local| local[t]);
            let d = x[t - h] - 2.0 * x[t] + x[t + h];
            let kept = 1.0 / (1.0 + d.norm_squared() / (usual(q, h) * reach * reach));
            w[t] = kept / (q * dt.powi(3));
        }
    }

    fn pull_of_bones(&mut self) {
        let frames = self.tracks.frames;
        let bones = self.common.bones.iter().zip(&self.common.lengths);
        for (b, ([head, tail], length)) in bones.enumerate() {
            for t in 0..frames {
                let (h, l) = (head * frames + t, tail * frames + t);
                let both = self.tracks.active[h] && self.tracks.active[l];
                let pull = match both {
                    true => Pull::new(&self.points[h], &self.points[l], *length),
                    false => Pull::default(),
                };
                let gradient = pull.gradient();
                self.system.pulls[h] -= gradient;
                self.system.pulls[l] += gradient;
                self.system.lengths[b * frames + t] = pull;
            }
        }
    }

    /// Fills in and smooths the positions that the frames alone give joint `j`: the same motion
    /// term, and a Gaussian per frame with its covariance under a Cauchy kernel.
    fn smooth(&mut self, j: usize) {
        let of = self.system.of(j);
        let alone = &self.tracks.alone[of.clone()];
        let (active, sure) = (&self.tracks.active[of.clone()], &self.tracks.sure[of.clone()]);
        interpolate(alone, active, &mut self.points[of.clone()]);
        let spread = &self.tracks.spread[of.clone()];
        let known = |t: usize| active[t] && alone[t].x.is_finite();
        let precision: Vec<Matrix3<f64>> = (0..alone.len())
            .map(|t| if known(t) { inverse(&spread[t]) } else { Matrix3::zeros() })
            .collect();
        let mut chain = Chain::default();
        for _ in 0..SMOOTHING {
            self.couple(j, f64::INFINITY);
            let x = &self.points[of.clone()];
            let block = |t: usize| {
                if !known(t) {
                    let still = if active[t] { Annealing::START.powi(-4) } else { 1.0 };
                    return Matrix3::from_diagonal_element(still);
                }
                let off = alone[t] - x[t];
                let square = off.dot(&(precision[t] * off));
                let reach = if sure[t] { f64::INFINITY } else { UNSURE_REACH };
                precision[t] / (1.0 + square / (reach * reach))
            };
            let blocks: Vec<Matrix3<f64>> = (0..x.len()).map(block).collect();
            let pull =
                |t: usize| if known(t) { times(&blocks[t], &alone[t]) } else { Vector3::zeros() };
            let mut next: Vec<Vector3<f64>> = (0..x.len()).map(pull).collect();
            chain.factorise(&self.system.weights[of.clone()], |t| blocks[t]);
            chain.solve(&mut next);
            self.points[of.clone()].copy_from_slice(&next);
        }
    }
}

/// Linear interpolation of `known` over the active frames between known positions; `out` stays
/// where inactive.
fn interpolate(known: &[Vector3<f64>], active: &[bool], out: &mut [Vector3<f64>]) {
    let there: Vec<usize> =
        (0..known.len()).filter(|t| active[*t] && known[*t].x.is_finite()).collect();
    there.iter().for_each(|t| out[*t] = known[*t]);
    for pair in there.windows(2) {
        let (first, last, gap) = (known[pair[0]], known[pair[1]], pair[1] - pair[0]);
        for (k, x) in out[pair[0]..pair[1]].iter_mut().enumerate() {
            *x = first + (last - first) * (k as f64 / gap as f64);
        }
    }
}

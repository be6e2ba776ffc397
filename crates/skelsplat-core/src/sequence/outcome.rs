//! What comes out of a solved window: positions, error bars and status of the joints of each frame,
//! and errors of the bones' lengths.

use nalgebra::{Matrix3, Vector3};

use super::known::Learnt;
use super::posterior::Posterior;
use super::solver::{Common, WindowSolver};
use super::tracks::{BRIDGE, Tracks};
use super::windows::{around, frames_in};
use crate::annealed::Alone;
use crate::annealed::consensus::REJECTED;
use crate::annealed::depth::determine;
use crate::annealed::rays::{Ray, there};
use crate::outcome::{ErrorBars, JointStatus, Loss, Outcome, Splats, StopReason};
use crate::statistics::median;

/// Largest standard deviation of an inferred joint, as a share of the body's spread.
pub(super) const INFERRED: f64 = 0.25;

/// A solved window.
pub(super) struct SolvedWindow<'a> {
    run: &'a WindowSolver<'a>,
    tracks: &'a Tracks,
    learnt: &'a Learnt,
    posterior: &'a Posterior,
    /// k of every view at the path `(N, T, M)`; NaN where missing, or where no place is solved for.
    believed: Vec<f64>,
    /// Whether the views that agree on each joint fix its depth `(N, T)`; `None` where fewer than
    /// two do.
    fixed: Vec<Option<bool>>,
    /// Whether the frames around show the depth of each joint `(N, T)`, as [`deep`] finds.
    deep: Vec<bool>,
}

/// A joint of a frame.
struct SolvedJoint {
    at: Vector3<f64>,
    covariance: Matrix3<f64>,
    /// k of every view; NaN where missing.
    believed: Vec<f64>,
    status: JointStatus,
    loss: f64,
}

impl<'a> SolvedWindow<'a> {
    /// The window along the path of `run`.
    pub(super) fn of(
        run: &'a WindowSolver<'a>,
        tracks: &'a Tracks,
        learnt: &'a Learnt,
        posterior: &'a Posterior,
    ) -> Self {
        let (common, views) = (&learnt.common, tracks.views);
        let mut known = vec![f64::NAN; tracks.active.len() * views];
        let mut depths = vec![None; tracks.active.len()];
        for k in (0..depths.len()).filter(|k| tracks.active[*k]) {
            let (j, at, own) =
                (k / tracks.frames, &run.points[k], &mut known[k * views..][..views]);
            let rays = tracks.rays(j, k % tracks.frames);
            own.iter_mut().zip(believed(rays, at, common.sigma[j])).for_each(|(k, now)| *k = now);
            depths[k] = fixed(rays, common, j, at, own);
        }
        let deep = deep(&depths, tracks.frames, frames_in(BRIDGE, common.fps));
        Self { run, tracks, learnt, posterior, believed: known, fixed: depths, deep }
    }

    /// Frame `t`, and its error bars.
    pub(super) fn outcome(
        &self,
        t: usize,
        alone: &Alone,
        used_for: Vec<usize>,
        n_iter: usize,
    ) -> (Outcome, ErrorBars) {
        let joints: Vec<SolvedJoint> =
            (0..alone.points.len()).map(|j| self.joint(j, t, alone)).collect();
        let status: Vec<JointStatus> = joints.iter().map(|joint| joint.status).collect();
        let observed = status.iter().any(|s| *s != JointStatus::Unobserved);
        let outcome = Outcome {
            points: joints.iter().map(|joint| joint.at).collect(),
            splats: Splats::Round(self.learnt.common.sigma.clone()),
            init: alone.points.clone(),
            status: status.clone(),
            used_for,
            loss: self.loss(&joints),
            loss_history: Vec::new(),
            n_iter,
            stop_reason: if observed { StopReason::Converged } else { StopReason::NoObservations },
        };
        let variance = median(self.learnt.common.variance.iter().copied());
        let bars = ErrorBars {
            covariances: joints.iter().map(|joint| joint.covariance).collect(),
            believed: joints.iter().flat_map(|joint| joint.believed.iter().copied()).collect(),
            noise: if observed { (variance / self.learnt.common.weight).sqrt() } else { f64::NAN },
            status,
        };
        (outcome, bars)
    }

    fn joint(&self, j: usize, t: usize, alone: &Alone) -> SolvedJoint {
        let k = j * self.tracks.frames + t;
        let common = &self.learnt.common;
        let rays = self.tracks.rays(j, t);
        let active = self.tracks.active[k];
        let (at, covariance) = match active {
            true => (self.run.points[k], self.posterior.positions[k] + self.undecided(j, t, alone)),
            false => (alone.points[j], alone.spread[j]),
        };
        let believed: Vec<f64> = match active {
            true => self.believed[k * rays.len()..][..rays.len()].to_vec(),
            false => believed(rays, &at, common.sigma[j]).collect(),
        };
        let fixed = self.fixed[k] == Some(true);
        let widest = || covariance.symmetric_eigenvalues().max().sqrt();
        let status = match (active, fixed) {
            (false, _) => alone.status[j],
            (true, true) => JointStatus::Ok,
            (true, false) if self.deep[k] && widest() <= INFERRED * common.reach => {
                JointStatus::Inferred
            }
            (true, false) => JointStatus::Weak,
        };
        let scale = 2.0 * common.sigma[j].powi(2) / common.variance[j];
        let terms = rays.iter().zip(&believed).filter(|(ray, k)| ray.is_there() && k.is_finite());
        let loss = terms.map(|(ray, k)| ray.weight * scale * (1.0 - k)).sum();
        SolvedJoint { at, covariance, believed, status, loss }
    }

    /// What a joint's covariance in its frame alone adds where no frame around shows it to enough
    /// views: its bone then allows two places on the ray, and all frames may have taken the wrong
    /// one.
    fn undecided(&self, j: usize, t: usize, alone: &Alone) -> Matrix3<f64> {
        let near = around(t, frames_in(BRIDGE, self.learnt.common.fps), self.tracks.frames);
        let of_joint = j * self.tracks.frames..(j + 1) * self.tracks.frames;
        let shown = self.tracks.sure[of_joint][near].iter().any(|sure| *sure);
        let spread = alone.spread[j];
        if shown || !spread[(0, 0)].is_finite() { Matrix3::zeros() } else { spread }
    }

    fn loss(&self, joints: &[SolvedJoint]) -> Loss {
        let render = joints.iter().map(|joint| joint.loss).sum();
        Loss { total: render, render, symmetry: 0.0 }
    }
}

/// k of every view at a position; NaN where missing.
fn believed(rays: &[Ray], at: &Vector3<f64>, sigma: f64) -> impl Iterator<Item = f64> {
    rays.iter().map(move |ray| ray.trust(at, sigma).unwrap_or(f64::NAN))
}

/// Whether the views that agree on joint `j` fix its depth; `None` where fewer than two agree.
fn fixed(
    rays: &[Ray],
    common: &Common,
    j: usize,
    at: &Vector3<f64>,
    believed: &[f64],
) -> Option<bool> {
    if believed.iter().filter(|k| **k >= REJECTED).count() < 2 {
        return None;
    }
    let ranges = there(rays).map(|ray| ray.offset(at).range.abs() * ray.pixel);
    let pixel = ranges.clone().sum::<f64>() / ranges.count() as f64;
    let variance = common.variance[j] / (pixel * pixel);
    Some(determine(rays, at, variance, common.weight, |i| believed[i]))
}

/// Whether the frames around show the depth of each joint `(N, T)`: of those up to `reach` frames
/// away in which two views agree, at least half fix it. Where fewer do, the cameras are so close
/// together that only errors which bring the joint nearer fix it.
fn deep(fixed: &[Option<bool>], frames: usize, reach: usize) -> Vec<bool> {
    let balance = |fixed: &Option<bool>| fixed.map_or(0, |is| if is { 1 } else { -1 });
    let of_joint = |own: &[Option<bool>]| {
        let mut sums = vec![0_i64];
        own.iter().for_each(|fixed| sums.push(sums[sums.len() - 1] + balance(fixed)));
        let near = move |t| around(t, reach, frames);
        (0..frames).map(move |t| sums[near(t).end] >= sums[near(t).start])
    };
    fixed.chunks(frames.max(1)).flat_map(of_joint).collect()
}

/// Standard errors of the bones' lengths, mm: those of a typical frame, since most of an error
/// lasts.
pub(super) fn errors(
    run: &WindowSolver<'_>,
    found: &Posterior,
    tracks: &Tracks,
    common: &Common,
) -> Vec<f64> {
    let t = tracks.frames;
    let of_bone = |(b, [head, tail]): (usize, &[usize; 2])| {
        let along = |k: usize| {
            let u = run.system.lengths[b * t + k].along;
            let spread = found.positions[head * t + k] + found.positions[tail * t + k];
            u.dot(&(spread * u)).sqrt()
        };
        let seen = |k: &usize| tracks.sure[head * t + k] && tracks.sure[tail * t + k];
        let all: Vec<f64> = (0..t).filter(seen).map(along).filter(|e| e.is_finite()).collect();
        if all.is_empty() { f64::INFINITY } else { median(all) }
    };
    common.bones.iter().enumerate().map(of_bone).collect()
}

//! What comes out of a solved window: positions, error bars and status of the joints of each frame,
//! and errors of the bones' lengths.

use nalgebra::{Matrix3, Vector3};

use super::posterior::Posterior;
use super::solver::WindowSolver;
use super::times::{BRIDGE, around, frames_in};
use super::tracks::Tracks;
use crate::annealed::Alone;
use crate::annealed::consensus::REJECTED;
use crate::annealed::depth::determine;
use crate::annealed::posterior::INFERRED;
use crate::annealed::rays::there;
use crate::bones::Pull;
use crate::outcome::{ErrorBars, JointStatus, Loss, Outcome, Splats, StopReason};
use crate::statistics::median;

/// A solved window.
pub(super) struct SolvedWindow<'a> {
    run: &'a WindowSolver<'a>,
    posterior: &'a Posterior,
    /// k of every view at the path `(N, T, M)`; NaN where missing, or where no place is solved for.
    believed: Vec<f64>,
    /// Whether the views that agree on each joint fix its depth `(N, T)`; `None` where fewer than
    /// two do.
    fixed: Vec<Option<bool>>,
    /// Whether the frames around show the depth of each joint `(N, T)`, as [`deep`] finds.
    deep: Vec<bool>,
    /// What bones that contradict the positions add to their covariances `(N, T)`.
    contradicted: Vec<Matrix3<f64>>,
}

/// A joint of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Answer {
    pub(super) at: Vector3<f64>,
    pub(super) covariance: Matrix3<f64>,
    pub(super) status: JointStatus,
}

impl Alone {
    /// Joint `j`.
    pub(super) fn joint(&self, j: usize) -> Answer {
        let (covariance, status) = (self.bars.covariances[j], self.bars.status[j]);
        Answer { at: self.points[j], covariance, status }
    }
}

/// A joint with what it rests on.
#[derive(Debug, Clone)]
pub(super) struct SolvedJoint {
    pub(super) answer: Answer,
    /// k of every view; NaN where missing.
    pub(super) believed: Vec<f64>,
    pub(super) loss: f64,
}

/// A frame of these joints under kernels `sigma`, mm, and its error bars; `noise` is NaN without
/// detections.
pub(super) fn together(
    joints: &[SolvedJoint],
    sigma: Vec<f64>,
    noise: f64,
    init: Vec<Vector3<f64>>,
    used_for: Vec<usize>,
    n_iter: usize,
) -> (Outcome, ErrorBars) {
    let render = joints.iter().map(|joint| joint.loss).sum();
    let found = noise.is_finite();
    let outcome = Outcome {
        points: joints.iter().map(|joint| joint.answer.at).collect(),
        splats: Splats::Round(sigma),
        init,
        used_for,
        loss: Loss { total: render, render, symmetry: 0.0 },
        loss_history: Vec::new(),
        n_iter,
        stop_reason: if found { StopReason::Converged } else { StopReason::NoObservations },
    };
    let bars = ErrorBars {
        covariances: joints.iter().map(|joint| joint.answer.covariance).collect(),
        believed: joints.iter().flat_map(|joint| joint.believed.iter().copied()).collect(),
        noise,
        status: joints.iter().map(|joint| joint.answer.status).collect(),
    };
    (outcome, bars)
}

impl<'a> SolvedWindow<'a> {
    /// The window along the path of `run`.
    pub(super) fn of(run: &'a WindowSolver<'a>, posterior: &'a Posterior) -> Self {
        let (tracks, views) = (run.tracks, run.tracks.views);
        let mut known = vec![f64::NAN; tracks.active.len() * views];
        let mut depths = vec![None; tracks.active.len()];
        for k in (0..depths.len()).filter(|k| tracks.active[*k]) {
            let (j, at, own) =
                (k / tracks.frames, &run.points[k], &mut known[k * views..][..views]);
            let now = believed(tracks, j, k % tracks.frames, at);
            own.iter_mut().zip(now).for_each(|(k, now)| *k = now);
            depths[k] = fixed(tracks, k, at, own);
        }
        let deep = deep(&depths, tracks.frames, frames_in(BRIDGE, run.common.fps));
        let contradicted = contradicted(run);
        Self { run, posterior, believed: known, fixed: depths, deep, contradicted }
    }

    /// Frame `t`, of which `before` is known otherwise, and its error bars.
    pub(super) fn outcome(
        &self,
        t: usize,
        before: &[Answer],
        init: Vec<Vector3<f64>>,
        used_for: Vec<usize>,
        n_iter: usize,
    ) -> (Outcome, ErrorBars) {
        let joint = |(j, before): (usize, &Answer)| self.joint(j, t, before);
        let joints: Vec<SolvedJoint> = before.iter().enumerate().map(joint).collect();
        let observed = joints.iter().any(|j| j.answer.status != JointStatus::Unobserved);
        let noise = &self.run.common.noise;
        let usual = if observed { median(noise.variance.iter().copied()).sqrt() } else { f64::NAN };
        together(&joints, noise.kernels(), usual, init, used_for, n_iter)
    }

    fn joint(&self, j: usize, t: usize, before: &Answer) -> SolvedJoint {
        let k = j * self.run.tracks.frames + t;
        let common = self.run.common;
        let rays = self.run.tracks.rays(j, t);
        let active = self.run.tracks.active[k];
        let (at, covariance) = match active {
            true => {
                let also = self.undecided(j, t, before) + self.contradicted[k];
                (self.run.points[k], self.posterior.positions[k] + also)
            }
            false => (before.at, before.covariance),
        };
        let believed: Vec<f64> = match active {
            true => self.believed[k * rays.len()..][..rays.len()].to_vec(),
            false => believed(self.run.tracks, j, t, &at).collect(),
        };
        let fixed = self.fixed[k] == Some(true);
        let most = (INFERRED * common.reach).powi(2);
        let unknown = active
            // Those that agree are the fewer.
            && (common.noise.wrong > 0.5
                || self.contradicted[k].trace() > 0.0
                || (covariance.trace() > most && covariance.symmetric_eigenvalues().max() > most));
        let status = match (active, fixed) {
            (false, _) => before.status,
            (true, _) if unknown => JointStatus::Weak,
            (true, true) => JointStatus::Ok,
            (true, false) if self.deep[k] => JointStatus::Inferred,
            (true, false) => JointStatus::Weak,
        };
        let loss = self.run.tracks.loss(k, &believed);
        SolvedJoint { answer: Answer { at, covariance, status }, believed, loss }
    }

    /// What a joint's covariance in its frame alone adds where no frame around shows it to enough
    /// views: its bone then allows two places on the ray, and all frames may have taken the wrong
    /// one.
    fn undecided(&self, j: usize, t: usize, before: &Answer) -> Matrix3<f64> {
        let near = around(t, frames_in(BRIDGE, self.run.common.fps), self.run.tracks.frames);
        let of_joint = j * self.run.tracks.frames..(j + 1) * self.run.tracks.frames;
        let shown = self.run.tracks.sure[of_joint][near].iter().any(|sure| *sure);
        let spread = before.covariance;
        if shown || !spread[(0, 0)].is_finite() { Matrix3::zeros() } else { spread }
    }
}

/// k of every view for joint `j` of frame `t` at a position; NaN where missing.
fn believed<'a>(
    tracks: &'a Tracks,
    j: usize,
    t: usize,
    at: &'a Vector3<f64>,
) -> impl Iterator<Item = f64> + 'a {
    let rays = tracks.rays(j, t).iter().enumerate();
    let k = j * tracks.frames + t;
    rays.map(move |(i, ray)| if ray.is_there() { tracks.trust(k, i, at, 1.0) } else { f64::NAN })
}

/// Whether the views that agree on joint and frame `k` fix its depth; `None` where fewer than two
/// agree.
fn fixed(tracks: &Tracks, k: usize, at: &Vector3<f64>, believed: &[f64]) -> Option<bool> {
    if believed.iter().filter(|k| **k >= REJECTED).count() < 2 {
        return None;
    }
    let rays = tracks.rays(k / tracks.frames, k % tracks.frames);
    let ranges = there(rays).map(|ray| ray.offset(at).range.abs() * ray.pixel);
    let n = ranges.clone().count() as f64;
    let pixel = ranges.sum::<f64>() / n;
    let precision = |i: usize| tracks.weights[k * rays.len() + i].precision;
    let mean = (0..rays.len()).map(precision).sum::<f64>() / n;
    let weight = |i: usize| believed[i] * precision(i) / rays[i].weight;
    Some(determine(rays, at, 1.0 / (pixel * pixel), mean, weight))
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

/// What bones that contradict the positions add to their covariances `(N, T)`, where they have lost
/// their influence on a joint as rejected detections have: it may be anywhere on the spheres around
/// their other ends. A joint that another bone holds is right.
fn contradicted(run: &WindowSolver<'_>) -> Vec<Matrix3<f64>> {
    let (tracks, common, t) = (run.tracks, run.common, run.tracks.frames);
    // Weights of a joint's bones, their number, and what is missing along them.
    let mut sums = vec![(0.0, 0.0, Matrix3::zeros()); tracks.active.len()];
    let bones = common.bones.iter().zip(&common.lengths);
    for (ends, length) in bones.filter(|(_, length)| length.sigma.is_finite()) {
        for k in 0..t {
            let at = ends.map(|j| j * t + k);
            if at.iter().all(|at| tracks.active[*at]) {
                let d = run.points[at[0]] - run.points[at[1]];
                let pull = Pull::new(&run.points[at[0]], &run.points[at[1]], *length);
                let sphere = Matrix3::from_diagonal_element(length.mean * length.mean / 3.0);
                for at in at {
                    sums[at].0 += pull.stiffness * length.sigma * length.sigma;
                    sums[at].1 += 1.0;
                    sums[at].2 += d * d.transpose() + sphere;
                }
            }
        }
    }
    let added = |(kept, n, off): (f64, f64, Matrix3<f64>)| {
        if kept < REJECTED * n && off.trace().is_finite() { off } else { Matrix3::zeros() }
    };
    sums.into_iter().map(added).collect()
}

/// Standard errors of the bones' lengths, mm: those of a typical frame, since most of an error
/// lasts.
pub(super) fn errors(run: &WindowSolver<'_>, found: &Posterior) -> Vec<f64> {
    let (tracks, t) = (run.tracks, run.tracks.frames);
    let of_bone = |(b, [head, tail]): (usize, &[usize; 2])| {
        let along = |k: usize| {
            let u = run.system.lengths[b * t + k].along;
            let spread = found.positions[head * t + k] + found.positions[tail * t + k];
            u.dot(&(spread * u)).sqrt()
        };
        let seen = (0..t).filter(|k| tracks.see_bone([*head, *tail], *k));
        let all: Vec<f64> = seen.map(along).filter(|e| e.is_finite()).collect();
        if all.is_empty() { f64::INFINITY } else { median(all) }
    };
    run.common.bones.iter().enumerate().map(of_bone).collect()
}

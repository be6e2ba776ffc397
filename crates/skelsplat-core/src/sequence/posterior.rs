//! Error bars of a recording.
//!
//! The detections of a joint have errors with a constant part c that no number of frames averages
//! out; of the rest, f(n) among n frames make up an independent detection ([`Memory`]). With the
//! information D_t of a frame's detections, the motion's stiffness K and the mean D̄_t of the
//! information around t,
//!
//! ```text
//! C_t = (1 − c) f(n_t) S_t + c D̄_t⁻¹        S = (D + K)⁻¹        n_t = 3 / tr(S_t D_t)
//! ```
//!
//! where S_t is a block of the selected inverse of the joint's chain and n_t the number of frames
//! that it averages over. Bones then act on each frame: a joint that is known to C_n is a
//! measurement along the bone u of variance σ_b² + uᵀ C_n u of its neighbour. These messages pass
//! from joint to joint, never back to where they come from, so that no information counts twice. An
//! error of a bone's length lasts as well: it is not averaged over the frames. Where the direction
//! of a bone is uncertain itself, as with cameras that are close together, a measurement along it
//! says less: an end that is off by e across the bone changes its length by |e|²/2l.

use nalgebra::{Matrix3, Vector3};

use super::chain::Band;
use super::lasting::Memory;
use super::learn::Learnt;
use super::solver::WindowSolver;
use super::times::{AROUND, around, frames_in};
use crate::matrix3::{inverse, times};

/// Sweeps of the bones' messages: to joints two bones away.
const SWEEPS: usize = 3;

/// Posterior of positions and velocities.
#[derive(Debug, Clone)]
pub struct Posterior {
    /// Covariances of the positions `(N, T)`, mm²; NaN where inactive.
    pub positions: Vec<Matrix3<f64>>,
    /// Velocities `(N, T)`, mm/s; NaN at the ends.
    pub velocities: Vec<Vector3<f64>>,
    /// Their covariances `(N, T)`, (mm/s)².
    pub of_velocities: Vec<Matrix3<f64>>,
}

/// The posterior at the solution of `run`, with what is `learnt` as its common knowledge.
pub fn posterior(run: &WindowSolver<'_>, learnt: &Learnt) -> Posterior {
    let (tracks, n, t) = (run.tracks, run.tracks.joints, run.tracks.frames);
    let unknown = Matrix3::repeat(f64::NAN);
    let mut out = Posterior {
        positions: vec![unknown; n * t],
        velocities: vec![Vector3::repeat(f64::NAN); n * t],
        of_velocities: vec![unknown; n * t],
    };
    for (j, memory) in learnt.memory.iter().enumerate() {
        let mut bands = run.bands(j);
        bands.iter_mut().zip(&run.system.blocks[run.system.of(j)]).for_each(|(band, block)| {
            band.scale(memory.widens(&band.own, block));
        });
        let lasting = lasting(run, memory, j);
        for k in (0..t).filter(|k| tracks.active[j * t + k]) {
            out.positions[j * t + k] = bands[k].own + lasting[k];
        }
        out.velocities(run, &bands, j);
    }
    for k in 0..t {
        join(run, k, &mut out.positions);
    }
    out
}

/// c D̄⁻¹ of joint `j` in every frame.
fn lasting(run: &WindowSolver<'_>, memory: &Memory, j: usize) -> Vec<Matrix3<f64>> {
    let (common, t, own) = (run.common, run.tracks.frames, j * run.tracks.frames);
    let reach = frames_in(AROUND, common.fps);
    let body = Matrix3::from_diagonal_element(common.reach.powi(-2));
    let mut sums = vec![(Matrix3::zeros(), 0.0)];
    for k in 0..t {
        let (mut sum, mut n): (Matrix3<f64>, f64) = sums[k];
        if run.tracks.active[own + k] {
            sum += run.system.blocks[own + k];
            n += 1.0;
        }
        sums.push((sum, n));
    }
    let of_frame = |k: usize| {
        let near = around(k, reach, t);
        let (first, last) = (&sums[near.start], &sums[near.end]);
        let mean = (last.0 - first.0) / (last.1 - first.1).max(1.0);
        inverse(&(mean + body)) * (memory.constant + memory.common)
    };
    (0..t).map(of_frame).collect()
}

impl Posterior {
    fn velocities(&mut self, run: &WindowSolver<'_>, bands: &[Band], j: usize) {
        let (tracks, t) = (run.tracks, run.tracks.frames);
        let own = j * t;
        for k in 0..t {
            let there = |k: usize| tracks.active[own + k];
            let (a, b) = (k.saturating_sub(1), (k + 1).min(t - 1));
            let joined =
                |k: usize, end: usize| there(end) && !tracks.is_cut(k.min(end), k.max(end));
            let (a, b) = (if joined(k, a) { a } else { k }, if joined(k, b) { b } else { k });
            if !there(k) || a == b {
                continue;
            }
            let rate = run.common.fps / (b - a) as f64;
            let cross = if b - a == 2 { bands[a].after } else { bands[a].next };
            let spread = bands[a].own + bands[b].own - cross - cross.transpose();
            self.velocities[own + k] = (run.points[own + b] - run.points[own + a]) * rate;
            self.of_velocities[own + k] = spread * (rate * rate);
        }
    }
}

/// Passes the bones' messages of frame `k` and adds what they tell.
fn join(run: &WindowSolver<'_>, k: usize, spread: &mut [Matrix3<f64>]) {
    let (tracks, common, t) = (run.tracks, run.common, run.tracks.frames);
    let alone: Vec<Matrix3<f64>> =
        (0..tracks.joints).map(|j| inverse(&spread[j * t + k])).collect();
    let variances: Vec<f64> =
        (0..common.bones.len()).map(|b| variance(run, [b, k], spread)).collect();
    // Information along the bone that its first joint has from the second, and the second from the
    // first.
    let mut messages = vec![[0.0; 2]; common.bones.len()];
    let told = |messages: &[[f64; 2]], j: usize, without: usize| {
        let mut information = alone[j];
        for (b, bone) in common.bones.iter().enumerate().filter(|(b, _)| *b != without) {
            if let Some(end) = bone.iter().position(|of| *of == j) {
                let u = run.system.lengths[b * t + k].along;
                information += u * u.transpose() * messages[b][end];
            }
        }
        information
    };
    for _ in 0..SWEEPS {
        for (b, [head, tail]) in common.bones.iter().enumerate() {
            let pull = &run.system.lengths[b * t + k];
            if !variances[b].is_finite() {
                continue;
            }
            let from = |j: usize, messages: &[[f64; 2]]| {
                let known = inverse(&told(messages, j, b));
                let variance = pull.along.dot(&times(&known, &pull.along));
                if variance > 0.0 { 1.0 / (variances[b] + variance) } else { 0.0 }
            };
            messages[b] = [from(*tail, &messages), from(*head, &messages)];
        }
    }
    for j in (0..tracks.joints).filter(|j| tracks.active[j * t + k]) {
        spread[j * t + k] = inverse(&told(&messages, j, usize::MAX));
    }
}

/// Variance of bone `b` as a measurement in frame `k`, mm²; infinite where it is none. To that of
/// its length comes the second moment of |e|²/2l, with the errors e across the bone of those of its
/// ends that two views see; where one does, the bone decides.
fn variance(run: &WindowSolver<'_>, [b, k]: [usize; 2], spread: &[Matrix3<f64>]) -> f64 {
    let (tracks, common) = (run.tracks, run.common);
    let (pull, length) = (&run.system.lengths[b * tracks.frames + k], common.lengths[b].mean);
    let ends = common.bones[b].map(|j| j * tracks.frames + k);
    let seen = ends.iter().filter(|end| tracks.active[**end] && tracks.sure[**end]);
    let errors: Matrix3<f64> = seen.map(|end| spread[*end]).sum();
    let of_along = times(&errors, &pull.along);
    let along = pull.along.dot(&of_along);
    let across = errors.trace() - along;
    let of_squares = errors.norm_squared() - 2.0 * of_along.norm_squared() + along * along;
    let bent = (across * across + 2.0 * of_squares) / (4.0 * length * length);
    if pull.stiffness > 0.0 { 1.0 / pull.stiffness + bent } else { f64::INFINITY }
}

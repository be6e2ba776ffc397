//! Process noise: the spectral density q of the joints' acceleration, in the whole recording and
//! at every time.
//!
//! For white acceleration of density q the second difference over the time h has the variance ⅔ q
//! h³ per axis, and for white noise of variance s² per frame 6 s². The shortest span in which
//! motion outweighs the noise counts: only there can they be told apart. Errors with a memory
//! follow the joint, so that only the white part of the noise weighs against the motion; the solver
//! takes the whole variance, and q grows by the same factor.
//!
//! A body rests, walks and jumps in the same recording. So q changes with time: it is that of the
//! second differences around, of the joint and of those that bones connect to it, with the
//! recording's as a prior.

use std::f64::consts::PI;

use super::times::{AROUND, INDEPENDENT, around, frames_in};
use super::tracks::{Tracks, Weights};
use crate::bones::other_end;
use crate::statistics::median;
use nalgebra::Vector3;

/// Longest time over which an acceleration is measured, s: half of the second difference's span.
pub(super) const SPAN: f64 = 0.4;
/// Multiple of the noise at which a span shows motion.
const CLEAR: f64 = 2.0;
/// Least share of white noise in the variance of the detections.
const LEAST_WHITE: f64 = 0.1;
/// Process noise of joints of which too little is known, mm²/s³: 5 m/s² for a tenth of a second.
pub(super) const USUAL_PROCESS_NOISE: f64 = 2.5e6;
/// Share of the measured process noise where views do not agree, at high rates: wrong detections
/// last, and the more of them there are per second, the more they weigh against the motion
/// (measured).
pub(super) const SHARE: f64 = 0.5;
/// Frames per second up to which it is all of it.
const SLOW_RATE: f64 = 15.0;
/// Least variance of second differences in multiples of the white noise: those of detections that
/// never change are 0, and others are counted in multiples of them.
const STILL: f64 = 1e-6;
/// Second differences needed for an estimate, and as which the recording's process noise counts, if
/// these are not fewer than those of the time in which errors become independent: at high rates
/// they overlap.
const LEAST: usize = 6;

/// The process noise of a joint in a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct ProcessNoise {
    /// q for the solver, mm²/s³.
    pub usual: f64,
    /// Variances of the detections and of the white part of the positions' errors, mm².
    variance: f64,
    white: f64,
    /// Variances per axis of the second differences over 1, 2, … frames, mm²; empty if q is the
    /// same at all times.
    squares: Vec<f64>,
}

impl ProcessNoise {
    /// q at all times.
    pub fn steady(q: f64) -> Self {
        Self { usual: q, variance: 1.0, white: 1.0, squares: Vec::new() }
    }
}

/// The process noise of every joint for data of these variances, mm².
pub fn learn(tracks: &Tracks, fps: f64, variance: &[f64]) -> Vec<ProcessNoise> {
    let own = (0..tracks.joints).map(|j| measured(tracks, fps, j, variance[j]));
    let mut own: Vec<ProcessNoise> = own.collect();
    let known = own.iter().map(|of| of.usual).filter(|q| q.is_finite());
    let shared = median(known).max(USUAL_PROCESS_NOISE);
    for ProcessNoise { usual, variance, white, squares } in &mut own {
        let (q, white) = (if usual.is_finite() { *usual } else { shared }, *white);
        squares.iter_mut().for_each(|square| *square = square.max(STILL * white));
        for h in squares.len() + 1..=frames_in(SPAN, fps) {
            squares.push(of_span(h, q, white, fps));
        }
        *usual = bounded(share(fps) * q, white, *variance, fps);
    }
    own
}

/// The variance per axis of second differences over `h` frames, for these densities of motion and
/// of white noise.
pub(super) fn of_span(h: usize, q: f64, white: f64, fps: f64) -> f64 {
    2.0 / 3.0 * q * (h as f64 / fps).powi(3) + 6.0 * white
}

/// The white part of the noise of this `variance`, by the second differences from frame to frame.
pub(super) fn white_part(first: f64, variance: f64) -> f64 {
    (first / 6.0).clamp(LEAST_WHITE * variance, variance)
}

/// Share of the measured process noise where views do not agree.
fn share(fps: f64) -> f64 {
    (SLOW_RATE / fps).clamp(SHARE, 1.0)
}

/// q for data of this variance, of which `white` is white: the cut-off frequency between motion and
/// noise is at most half of the frame rate.
pub(super) fn bounded(q: f64, white: f64, variance: f64, fps: f64) -> f64 {
    (q * variance / white).min((PI * fps).powi(4) * variance / fps)
}

/// q by the variances of second differences over spans of h frames, for noise of the variance
/// `white`: the first span in which motion outweighs the noise counts. NaN of nothing.
pub(super) fn density(squares: impl Iterator<Item = (usize, f64)>, white: f64, fps: f64) -> f64 {
    let mut q = f64::NAN;
    for (h, square) in squares {
        q = at_span(h, square, white, fps);
        if is_clear(square, white) {
            break;
        }
    }
    q
}

/// q by the variance of second differences over `h` frames.
fn at_span(h: usize, square: f64, white: f64, fps: f64) -> f64 {
    1.5 * (square - 6.0 * white).max(0.6 * white) / (h as f64 / fps).powi(3)
}

fn is_clear(square: f64, white: f64) -> bool {
    square > CLEAR * 6.0 * white
}

/// How little a span shows motion, from 1 to 0 around [`CLEAR`], without a jump: q must not depend
/// on a hair.
fn unclear(square: f64, white: f64) -> f64 {
    (CLEAR + 0.5 - square / (6.0 * white)).clamp(0.0, 1.0)
}

/// What the positions of a joint show: q, NaN if too little is known, and the variances of second
/// differences, as far as there are enough.
fn measured(tracks: &Tracks, fps: f64, j: usize, variance: f64) -> ProcessNoise {
    let of = j * tracks.frames..(j + 1) * tracks.frames;
    let sure = tracks.alone[of.clone()].iter().zip(&tracks.sure[of]);
    let unknown = Vector3::repeat(f64::NAN);
    let x: Vec<Vector3<f64>> = sure.map(|(x, sure)| if *sure { *x } else { unknown }).collect();
    let joined = |a: usize, b: usize| !tracks.is_cut(a, b);
    let spans = frames_in(SPAN, fps);
    let squares: Vec<f64> = (1..=spans).map_while(|h| second_moment(&x, h, joined)).collect();
    let Some(first) = squares.first() else {
        return ProcessNoise { usual: f64::NAN, variance, white: variance, squares };
    };
    let white = white_part(*first, variance);
    // Too short a recording may end before a slow joint has moved: then little motion in few
    // frames means nothing.
    let shows = squares.len() == spans || squares.iter().any(|s| is_clear(*s, white));
    let of_spans = squares.iter().zip(1..).map(|(square, h)| (h, *square));
    let usual = if shows { density(of_spans, white, fps) } else { f64::NAN };
    ProcessNoise { usual, variance, white, squares }
}

/// Variance per axis of the second differences over `h` frames, between frames that are `joined`
/// and without the largest tenth: rest and motion both count, jumps do not. `None` if there are
/// few.
fn second_moment(
    x: &[Vector3<f64>],
    h: usize,
    joined: impl Fn(usize, usize) -> bool,
) -> Option<f64> {
    let mut squares: Vec<f64> = (h..x.len().saturating_sub(h))
        .filter(|t| joined(t - h, t + h))
        .map(|t| (x[t - h] - 2.0 * x[t] + x[t + h]).norm_squared())
        .filter(|s| s.is_finite())
        .collect();
    let n = squares.len();
    if n < LEAST {
        return None;
    }
    let kept = n - n / 10;
    squares.select_nth_unstable_by(kept - 1, f64::total_cmp);
    Some(squares[..kept].iter().sum::<f64>() / kept as f64 / 3.0)
}

/// q of every joint at every time `(N, T)`, mm²/s³.
///
/// The second differences around count in multiples of the recording's, so that those of joints
/// that bones connect can be added. Only positions on which all of at least three views agree
/// count, and only the same views in a second difference: others differ by their errors.
pub fn local(tracks: &Tracks, fps: f64, bones: &[[usize; 2]], usual: &[ProcessNoise]) -> Vec<f64> {
    let t = tracks.frames;
    let mut out: Vec<f64> = vec![0.0; tracks.joints * t];
    // What no shorter span has shown.
    let mut open: Vec<f64> = vec![1.0; out.len()];
    // Each joint and those that bones connect to it.
    let connected =
        |j| std::iter::once(j).chain(bones.iter().filter_map(move |b| other_end(*b, j)));
    let near: Vec<Vec<usize>> = (0..tracks.joints).map(|j| connected(j).collect()).collect();
    let views: Vec<Vec<u64>> = (0..tracks.joints).map(|j| agreeing(tracks, j)).collect();
    let (reach, spans) = (frames_in(AROUND, fps), frames_in(SPAN, fps));
    let mut shares: Vec<f64> = Vec::new();
    let prior = (LEAST as f64).max(INDEPENDENT * fps);
    for h in 1..=spans {
        let of_joint = |j: usize| ratios(tracks, &views[j], j, h, usual[j].squares[h - 1]);
        let sums: Vec<Vec<[f64; 2]>> = (0..tracks.joints).map(of_joint).collect();
        let within = |i: usize, k: usize| {
            let near = around(k, reach, t);
            let (first, last) = (sums[i][near.start], sums[i][near.end]);
            [last[0] - first[0], last[1] - first[1]]
        };
        if h == 1 {
            let low = share(fps);
            let of_own = |n: f64| low + (1.0 - low) * n / (n + prior);
            shares = (0..out.len()).map(|k| of_own(within(k / t, k % t)[1])).collect();
        }
        for k in 0..out.len() {
            if open[k] <= 0.0 {
                continue;
            }
            let (j, of) = (k / t, &usual[k / t]);
            let add = |sum: [f64; 2], i: &usize| {
                let other = within(*i, k % t);
                [sum[0] + other[0], sum[1] + other[1]]
            };
            let [ratio, n] = near[j].iter().fold([prior, prior], add);
            let square = of.squares[h - 1] * ratio / n;
            let left = if h < spans { unclear(square, of.white) } else { 0.0 };
            let q = shares[k] * at_span(h, square, of.white, fps);
            out[k] += open[k] * (1.0 - left) * bounded(q, of.white, of.variance, fps);
            open[k] *= left;
        }
    }
    out
}

/// The views of joint `j` in every frame, as bits, if all of at least three agree closely; else 0.
fn agreeing(tracks: &Tracks, j: usize) -> Vec<u64> {
    let bit = |bits: u64, (i, of): (usize, &Weights)| {
        bits ^ u64::from(of.held > 0.0).rotate_left(i as u32)
    };
    let of_frame = |own: &[Weights]| own.iter().enumerate().fold(0, bit);
    tracks.of_joint(j).1.chunks(tracks.views).map(of_frame).collect()
}

/// Running sums `(T + 1)` of the squares of second differences of joint `j` over `h` frames in
/// multiples of the usual one, and of their number.
fn ratios(tracks: &Tracks, views: &[u64], j: usize, h: usize, usual: f64) -> Vec<[f64; 2]> {
    let x = &tracks.alone[j * tracks.frames..(j + 1) * tracks.frames];
    let mut sum = [0.0; 2];
    let mut sums = vec![sum];
    for t in 0..x.len() {
        let (a, b) = (t.wrapping_sub(h), t + h);
        if t >= h && b < x.len() {
            let same = views[t] != 0 && views[a] == views[t] && views[b] == views[t];
            if same && !tracks.is_cut(a, b) {
                let square = (x[a] - 2.0 * x[t] + x[b]).norm_squared() / 3.0;
                sum = [sum[0] + square / usual, sum[1] + 1.0];
            }
        }
        sums.push(sum);
    }
    sums
}

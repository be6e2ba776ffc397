//! How long the errors of detections last.

use nalgebra::{Matrix3, Vector3};

use super::noise::DetectionNoise;
use super::solver::WindowSolver;
use super::times::{SHORT, frames_in};
use crate::annealed::consensus::REJECTED;
use crate::matrix3::product;
use crate::statistics::{median, variance_of};

/// Time up to which errors have a memory, s.
const MEMORY: f64 = 0.7;
/// Shortest recording, s, that shows how long its errors last.
const LEAST_SECONDS: f64 = 3.0;
/// The constant share of the errors' variance where the recording does not show it, and the slow
/// share of the rest, as measured on real recordings.
pub(super) const USUAL_SHARE: f64 = 0.4;
/// Joints in a view as which the memory of all joints counts for a class of them.
const SHARED: f64 = 8.0;

/// How long the errors of detections last.
#[derive(Debug, Clone, PartialEq)]
pub struct Memory {
    /// Share of the variance that does not change within seconds.
    pub constant: f64,
    /// Autocorrelation of the rest, from lag 1 on, frame by frame.
    pub rest: Vec<f64>,
    /// Variance that a view's detections share, in multiples of the joint's least one in any view.
    pub common: f64,
}

impl Memory {
    /// The memory of errors of which nothing is known, with a time constant of half of the longest,
    /// as measured on real recordings.
    pub fn usual(fps: f64) -> Self {
        let longest = frames_in(MEMORY, fps);
        let after = |lag: usize| USUAL_SHARE * (-(lag as f64) / (0.5 * MEMORY * fps)).exp();
        Self { constant: USUAL_SHARE, rest: (1..=longest).map(after).collect(), common: 0.0 }
    }

    /// From the autocorrelation `rho` of the residuals at `lags`: at the longest ones it is the
    /// constant share c, at most twice the usual, and (ρ − c)/(1 − c) is that of the rest.
    fn of(lags: &[usize], rho: &[f64], fps: f64) -> Self {
        let late = frames_in(MEMORY - SHORT, fps);
        let last = || lags.iter().zip(rho).filter(|(lag, _)| **lag >= late).map(|(_, r)| *r);
        let constant = (last().sum::<f64>() / last().count() as f64).clamp(0.0, 2.0 * USUAL_SHARE);
        let rest = |k: usize| ((rho[k] - constant) / (1.0 - constant)).max(0.0);
        let of_lag = |lag: usize| {
            let k = lags.partition_point(|h| *h < lag);
            let share = (lag - lags[k - 1]) as f64 / (lags[k] - lags[k - 1]) as f64;
            rest(k - 1) * (1.0 - share) + rest(k) * share
        };
        Self { constant, rest: (1..=lags[lags.len() - 1]).map(of_lag).collect(), common: 0.0 }
    }

    /// The number of frames among `n` that make up an independent detection, apart from the
    /// constant share: the mean of `n` errors has the variance of one times (1 + 2 Σ_h (1 − h/n)
    /// ρ_h)/n.
    pub fn frames(&self, n: f64) -> f64 {
        let lags = self.rest.iter().enumerate().map(|(k, rho)| ((k + 1) as f64, rho));
        1.0 + 2.0
            * lags.take_while(|(h, _)| *h < n).map(|(h, rho)| (1.0 - h / n) * rho).sum::<f64>()
    }

    /// (1 − c) f(n), by which errors that last widen the `spread` S of a position over time: it
    /// averages n = 3 / tr(S D) frames with the `information` D each.
    pub(super) fn widens(&self, spread: &Matrix3<f64>, information: &Matrix3<f64>) -> f64 {
        let frames = 3.0 / product(spread, information).trace().clamp(1e-3, 3.0);
        (1.0 - self.constant) * self.frames(frames)
    }
}

/// Variance per axis of what a view's errors share, as a wrong calibration does, mm²: the median of
/// the views' squared mean offsets is 2 ln 2 times it, and positions take up three numbers of them.
fn common(run: &WindowSolver<'_>) -> f64 {
    let tracks = run.tracks;
    let mut sums = vec![(Vector3::zeros(), 0.0); tracks.views];
    for k in (0..tracks.active.len()).filter(|k| tracks.active[*k]) {
        let (rays, x) = (tracks.rays(k / tracks.frames, k % tracks.frames), &run.points[k]);
        for ((i, ray), (sum, n)) in rays.iter().enumerate().zip(&mut sums) {
            let kept = tracks.trust(k, i, x, 1.0);
            *sum += ray.offset(x).across * kept;
            *n += kept;
        }
    }
    let squares = sums.iter().filter(|(_, n)| *n > 0.0).map(|(sum, n)| (sum / *n).norm_squared());
    let numbers = 2.0 * tracks.views as f64;
    variance_of(median(squares)) * numbers / (numbers - 3.0).max(1.0)
}

/// The memory of every joint's errors along the path of `run`, given their `noise`.
pub(super) fn memories(
    run: &WindowSolver<'_>,
    noise: &DetectionNoise,
    classes: &[usize],
    absorbed: f64,
) -> Vec<Memory> {
    let (mut memories, common) = (shown(run, classes, absorbed), common(run));
    for (memory, own) in memories.iter_mut().zip(noise.variance.chunks(run.tracks.views)) {
        memory.common = common / own.iter().copied().fold(f64::INFINITY, f64::min);
    }
    memories
}

/// The memory of every joint's errors, as the residuals of believed detections along the path of
/// `run` show it for classes of joints; the errors' correlation is `absorbed` times theirs.
fn shown(run: &WindowSolver<'_>, classes: &[usize], absorbed: f64) -> Vec<Memory> {
    let (tracks, fps) = (run.tracks, run.common.fps);
    let longest = frames_in(MEMORY, fps);
    let stride = (longest / 12).max(1);
    let lags: Vec<usize> = (0..=longest).filter(|h| *h < 8 || h % stride == 0).collect();
    let usual = || vec![Memory::usual(fps); classes.len()];
    if (tracks.frames as f64) < LEAST_SECONDS * fps {
        return usual();
    }
    let own: Vec<Vec<[f64; 2]>> = (0..tracks.joints).map(|j| sums(run, j, &lags)).collect();
    let over = |joints: &dyn Fn(usize) -> bool| {
        let of = || own.iter().enumerate().filter(|(j, _)| joints(*j));
        let sum = |k: usize| of().fold([0.0; 2], |a, (_, s)| [a[0] + s[k][0], a[1] + s[k][1]]);
        let square = sum(0)[0] / sum(0)[1];
        let rho = (0..lags.len()).map(|k| absorbed * sum(k)[0] / sum(k)[1] / square);
        (rho.collect::<Vec<f64>>(), (of().count() * tracks.views) as f64)
    };
    let (all, _) = over(&|_| true);
    if all.iter().any(|rho| !rho.is_finite()) {
        return usual();
    }
    let of_class = |class: &usize| {
        let (rho, n) = over(&|j| classes[j] == *class);
        let shrunk = rho.iter().zip(&all).map(|(own, all)| {
            if own.is_finite() { (n * own + SHARED * all) / (n + SHARED) } else { *all }
        });
        Memory::of(&lags, &shrunk.collect::<Vec<f64>>(), fps)
    };
    classes.iter().map(of_class).collect()
}

/// Σ of the products of a joint's residuals so many frames apart, in multiples of the noise, and
/// their number.
fn sums(run: &WindowSolver<'_>, j: usize, lags: &[usize]) -> Vec<[f64; 2]> {
    let tracks = run.tracks;
    let mut sums = vec![[0.0; 2]; lags.len()];
    let mut residuals = vec![None; tracks.frames];
    for i in 0..tracks.views {
        for (t, residual) in residuals.iter_mut().enumerate() {
            let k = j * tracks.frames + t;
            let (ray, x) = (&tracks.rays(j, t)[i], &run.points[k]);
            let kept = tracks.active[k] && tracks.trust(k, i, x, 1.0) >= REJECTED;
            let scale = tracks.weights[k * tracks.views + i].precision.sqrt();
            *residual = kept.then(|| ray.offset(x).across * scale);
        }
        for (sum, lag) in sums.iter_mut().zip(lags) {
            let later = residuals.iter().enumerate().skip(*lag);
            for ((t, b), a) in later.zip(&residuals) {
                if let (Some(a), Some(b), false) = (a, b, tracks.is_cut(t - lag, t)) {
                    *sum = [sum[0] + a.dot(b), sum[1] + 1.0];
                }
            }
        }
    }
    sums
}

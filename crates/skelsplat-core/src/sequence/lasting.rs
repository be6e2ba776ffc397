//! How long the errors of detections last.

use super::scales::Residuals;
use super::solver::WindowSolver;
use super::tracks::Tracks;
use super::windows::frames_in;
use crate::annealed::consensus::REJECTED;

/// Time up to which errors have a memory, s.
const MEMORY: f64 = 0.7;
/// Time from which errors that remain count as constant, s.
const LATE: f64 = 0.6;
/// Shortest recording, s, that shows how long its errors last.
const LEAST_SECONDS: f64 = 3.0;
/// The constant share where the recording does not show it, as measured on real recordings.
const USUAL_CONSTANT: f64 = 0.4;
/// The slow share of the rest, as measured on real recordings.
const USUAL_SLOW: f64 = 0.42;
/// Its time constant, s, as measured on real recordings.
const USUAL_SECONDS: f64 = 0.35;
/// Largest constant share.
const MOST_CONSTANT: f64 = 0.8;
/// Joints in a view as which the memory of all joints counts for a class of them.
const SHARED: f64 = 8.0;

/// How long the errors of detections last.
#[derive(Debug, Clone, PartialEq)]
pub struct Memory {
    /// Share of the variance that does not change within seconds.
    pub constant: f64,
    /// Autocorrelation of the rest, from lag 1 on, frame by frame.
    pub rest: Vec<f64>,
}

impl Memory {
    /// The memory of errors of which nothing is known.
    pub fn usual(fps: f64) -> Self {
        let longest = frames_in(MEMORY, fps);
        let after = |lag: usize| USUAL_SLOW * (-(lag as f64) / (USUAL_SECONDS * fps)).exp();
        Self { constant: USUAL_CONSTANT, rest: (1..=longest).map(after).collect() }
    }

    /// The number of frames among `n` that make up an independent detection, apart from the
    /// constant share: the mean of `n` errors has the variance of one times (1 + 2 Σ_h (1 − h/n)
    /// ρ_h)/n.
    pub fn frames(&self, n: f64) -> f64 {
        let lags = self.rest.iter().enumerate().map(|(k, rho)| ((k + 1) as f64, rho));
        1.0 + 2.0
            * lags.take_while(|(h, _)| *h < n).map(|(h, rho)| (1.0 - h / n) * rho).sum::<f64>()
    }
}

/// Autocorrelation of the residuals of believed detections.
pub(super) struct Correlation {
    /// Lags, frames; the first is 0.
    lags: Vec<usize>,
    /// The correlation at each, of every class of joints; empty if the recording is too short to
    /// show it.
    at: Vec<Vec<f64>>,
}

impl Correlation {
    pub(super) fn of(run: &WindowSolver<'_>, tracks: &Tracks, classes: &[usize], fps: f64) -> Self {
        let longest = frames_in(MEMORY, fps);
        let stride = (longest / 12).max(1);
        let lags: Vec<usize> = (0..=longest).filter(|h| *h < 8 || h % stride == 0).collect();
        if (tracks.frames as f64) < LEAST_SECONDS * fps {
            return Self { lags, at: Vec::new() };
        }
        let own: Vec<Vec<[f64; 2]>> =
            (0..tracks.joints).map(|j| sums(run, tracks, j, &lags)).collect();
        let over = |joints: &dyn Fn(usize) -> bool| {
            let of = || own.iter().enumerate().filter(|(j, _)| joints(*j));
            let sum = |k: usize| of().fold([0.0; 2], |a, (_, s)| [a[0] + s[k][0], a[1] + s[k][1]]);
            let square = sum(0)[0] / sum(0)[1];
            let rho = (0..lags.len()).map(|k| sum(k)[0] / sum(k)[1] / square);
            (rho.collect::<Vec<f64>>(), (of().count() * tracks.views) as f64)
        };
        let (all, _) = over(&|_| true);
        if all.iter().any(|rho| !rho.is_finite()) {
            return Self { lags, at: Vec::new() };
        }
        let of_class = |class: usize| {
            let (rho, n) = over(&|j| classes[j] == class);
            let shrunk = |(own, all): (&f64, &f64)| (n * own + SHARED * all) / (n + SHARED);
            let known = |rho: f64, all: &f64| if rho.is_finite() { rho } else { *all };
            rho.iter().zip(&all).map(|pair| known(shrunk(pair), pair.1)).collect()
        };
        let at = (0..tracks.joints).map(of_class).collect();
        Self { lags, at }
    }

    /// Share of the errors of a class that are the same in the next frame.
    pub(super) fn lasting(&self, class: usize) -> f64 {
        match self.at.get(class) {
            Some(rho) if rho.len() > 1 => rho[1].clamp(0.0, 1.0),
            _ => USUAL_CONSTANT,
        }
    }

    /// The memory of the errors of every class; their correlation is that of the residuals times
    /// `scale(class)`. At the longest lags it is the constant share c, and (ρ − c)/(1 − c) is that
    /// of the rest.
    pub(super) fn memory(&self, fps: f64, scale: impl Fn(usize) -> f64) -> Vec<Memory> {
        (0..self.at.len()).map(|class| self.of_class(class, fps, scale(class))).collect()
    }

    fn of_class(&self, class: usize, fps: f64, scale: f64) -> Memory {
        let (late, at) = (frames_in(LATE, fps), &self.at[class]);
        let last = || self.lags.iter().zip(at).filter(|(lag, _)| **lag >= late).map(|(_, r)| *r);
        let mean = scale * last().sum::<f64>() / last().count() as f64;
        if !mean.is_finite() {
            return Memory::usual(fps);
        }
        let constant = mean.clamp(0.0, MOST_CONSTANT);
        let rest = |k: usize| ((scale * at[k] - constant) / (1.0 - constant)).max(0.0);
        let between = |lag: usize| {
            let k = self.lags.partition_point(|h| *h < lag).clamp(2, self.lags.len() - 1);
            let share =
                (lag as f64 - self.lags[k - 1] as f64) / (self.lags[k] - self.lags[k - 1]) as f64;
            rest(k - 1) * (1.0 - share) + rest(k) * share
        };
        let longest = *self.lags.last().unwrap_or(&0);
        let of_lag = |lag: usize| if lag == 1 { rest(1) } else { between(lag) };
        Memory { constant, rest: (1..=longest).map(of_lag).collect() }
    }
}

/// Σ of the products of a joint's residuals so many frames apart, in multiples of the noise, and
/// their number.
fn sums(run: &WindowSolver<'_>, tracks: &Tracks, j: usize, lags: &[usize]) -> Vec<[f64; 2]> {
    let mut sums = vec![[0.0; 2]; lags.len()];
    let mut residuals = vec![None; tracks.frames];
    for i in 0..tracks.views {
        for (t, residual) in residuals.iter_mut().enumerate() {
            let k = j * tracks.frames + t;
            let (ray, x) = (&tracks.rays(j, t)[i], &run.points[k]);
            let kept = tracks.active[k] && ray.is_there() && tracks.trust(k, i, x) >= REJECTED;
            let scale = tracks.precision[k * tracks.views + i].sqrt();
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

/// How much of the leverage that they have in their frames alone the positions of each joint take
/// up: all of errors that last, of white ones what is left after smoothing.
pub(super) fn taken(
    run: &WindowSolver<'_>,
    tracks: &Tracks,
    correlation: &Correlation,
    classes: &[usize],
) -> Vec<f64> {
    let of_joint = |j: usize| {
        let (mut sum, mut n) = (0.0, 0.0);
        for (t, band) in run.bands(j).iter().enumerate() {
            if tracks.active[j * tracks.frames + t] {
                let block = &run.system.blocks[j * tracks.frames + t];
                sum += (band.own * block).trace().clamp(0.0, 3.0) / 3.0;
                n += 1.0;
            }
        }
        let lasting = correlation.lasting(classes[j]);
        lasting + (1.0 - lasting) * if n > 0.0 { sum / n } else { 1.0 }
    };
    (0..tracks.joints).map(of_joint).collect()
}

/// The memories of the classes, with residuals whose positions take up all (`frames`) and a part
/// (`smooth`) of the leverage.
pub(super) fn memories(
    correlation: &Correlation,
    classes: &[usize],
    fps: f64,
    [frames, smooth]: [&Residuals; 2],
) -> Vec<Memory> {
    let n = classes.len();
    let of = |class: usize| (0..n).filter(move |j| classes[*j] == class);
    let scale = |class: usize| {
        let ratio = smooth.left(of(class)) / frames.left(of(class));
        if ratio.is_finite() { ratio } else { 1.0 }
    };
    let found = correlation.memory(fps, scale);
    if found.is_empty() { vec![Memory::usual(fps); n] } else { found }
}

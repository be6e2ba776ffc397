//! The detections' errors in a recording: how large they are, and how long they last.

use std::f64::consts::FRAC_PI_2;

use super::solver::{Common, WindowSolver};
use super::tracks::Tracks;
use super::windows::frames_in;
use crate::annealed::consensus::REJECTED;
use crate::statistics::median;

/// Weight of the recording's noise for one joint, in degrees of freedom.
const SHARED_DOF: f64 = 50.0;
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
/// Least sum of weights of a frame that shows the noise: two views.
const LEAST_SUPPORT: f64 = 1.6;
/// Largest constant share.
const MOST_CONSTANT: f64 = 0.8;
/// Squares of the distances, in widths of the kernel and one apart, between which detections are
/// wrong.
const WRONG: std::ops::Range<f64> = 9.0..16.0;
/// Share of the residuals' variance that is noise, where nothing shows it.
pub(super) const USUAL_SHARE: f64 = 0.93;
/// Least share that a recording shows.
const LEAST_SHARE: f64 = 0.4;

/// How long the errors of detections last.
#[derive(Debug, Clone, PartialEq)]
pub struct Memory {
    /// Share of the variance that does not change within seconds.
    pub constant: f64,
    /// Autocorrelation of the rest, from lag 1 on, frame by frame.
    pub rest: Vec<f64>,
}

/// What the residuals at the solution tell about the detections.
#[derive(Debug, Clone)]
pub struct DetectionNoise {
    /// Variance of a detection of weight 1 of every joint, mm².
    pub variance: Vec<f64>,
    /// How long the errors last.
    pub memory: Memory,
    /// Share of the variance that is noise; the rest are wrong detections that the kernel lets
    /// through.
    pub share: f64,
}

impl DetectionNoise {
    /// From the residuals of `run`.
    ///
    /// Residuals have 2 Σ k degrees of freedom less those that the position takes up: 3 of errors
    /// that last, tr(S D) of white ones, with the covariance S of the smoothed position. They are
    /// scaled up accordingly, by a_l and a_w.
    ///
    /// Wrong detections lie at any distance r, about as many in every ring of the same width; far
    /// outside the kernel k = exp(−r²/2w²), w² = 2 σ², there is nothing else. n of them per w of
    /// distance add n ∫ k dr = n √(π/2) to Σ k, and as much times w² to Σ k |e|²; without them the
    /// variance is smaller.
    pub fn of(run: &WindowSolver<'_>, tracks: &Tracks, common: &Common) -> Self {
        let sums: Vec<Sums> =
            (0..tracks.joints).map(|j| Sums::of(run, tracks, common, j)).collect();
        let all = sums.iter().fold(Sums::default(), Sums::plus);
        let rho = Correlation::of(run, tracks, common);
        let lasting = if rho.at.len() > 1 { rho.at[1].clamp(0.0, 1.0) } else { USUAL_CONSTANT };
        let scale = |taken: f64| match all.freedom {
            0.0 => 1.0, // no two views agree on any joint: nothing to learn from
            freedom => freedom / (freedom - taken).max(0.1 * freedom),
        };
        let (of_lasting, of_white) = (scale(3.0 * all.frames), scale(all.taken));
        let growth = lasting * of_lasting + (1.0 - lasting) * of_white;
        let before = median(common.variance.iter().copied());
        let shared = (growth * all.squares + SHARED_DOF * before) / (all.freedom + SHARED_DOF);
        let own = |(sums, sigma): (&Sums, &f64)| {
            let shrunk =
                (growth * sums.squares + SHARED_DOF * shared) / (sums.freedom + SHARED_DOF);
            shrunk / (1.0 - shrunk / (2.0 * common.weight * sigma * sigma)).max(0.25)
        };
        let variance = sums.iter().zip(&common.sigma).map(own).collect();
        let memory = rho.memory(common.fps, of_lasting / growth);
        Self { variance, memory, share: all.share(growth) }
    }
}

/// Sums over the frames of a joint that two views see.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    frames: f64,
    /// Those with at least three detections, of which one can be outvoted.
    shown: f64,
    /// Σ c k |e|², mm².
    squares: f64,
    /// 2 Σ k.
    freedom: f64,
    /// tr(S D).
    taken: f64,
    /// What wrong detections add to the squares, mm², and to the freedom.
    wrong: [f64; 2],
}

impl Sums {
    fn of(run: &WindowSolver<'_>, tracks: &Tracks, common: &Common, j: usize) -> Self {
        let bands = run.bands(j);
        let mut sums = Self::default();
        for (t, band) in bands.iter().enumerate() {
            let k = j * tracks.frames + t;
            let (mut there, mut support, mut squares, mut wrong) = (0, 0.0, 0.0, [0.0; 2]);
            let width = 2.0 * common.sigma[j] * common.sigma[j];
            for ray in tracks.rays(j, t).iter().filter(|ray| ray.is_there() && tracks.active[k]) {
                let offset = ray.offset(&run.points[k]);
                let kept = offset.weight(common.sigma[j]);
                there += 1;
                support += kept;
                let square = offset.across.norm_squared();
                squares += ray.weight * kept * square;
                if WRONG.contains(&(square / width)) {
                    wrong[0] += FRAC_PI_2.sqrt() * ray.weight * width;
                    wrong[1] += FRAC_PI_2.sqrt() * 2.0;
                }
            }
            if support > LEAST_SUPPORT {
                sums.frames += 1.0;
                sums.shown += if there > 2 { 1.0 } else { 0.0 };
                sums.squares += squares;
                sums.wrong = [sums.wrong[0] + wrong[0], sums.wrong[1] + wrong[1]];
                sums.freedom += 2.0 * support;
                sums.taken += (band.own * run.system.blocks[k]).trace().clamp(0.0, 3.0);
            }
        }
        sums
    }

    fn plus(self, other: &Self) -> Self {
        Self {
            frames: self.frames + other.frames,
            shown: self.shown + other.shown,
            squares: self.squares + other.squares,
            freedom: self.freedom + other.freedom,
            taken: self.taken + other.taken,
            wrong: [self.wrong[0] + other.wrong[0], self.wrong[1] + other.wrong[1]],
        }
    }

    /// Share of the variance that is noise, for residuals that are scaled up by `growth`; the usual
    /// one where most joints are seen by two views, of which none can outvote the other.
    fn share(&self, growth: f64) -> f64 {
        let (squares, freedom) = (self.wrong[0] / self.squares, self.wrong[1] / self.freedom);
        let share = (1.0 - squares) / (1.0 - growth * freedom);
        let known = 2.0 * self.shown > self.frames && share.is_finite() && growth * freedom < 1.0;
        if known { share.clamp(LEAST_SHARE, 1.0) } else { USUAL_SHARE }
    }
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
struct Correlation {
    /// Lags, frames; the first is 0.
    lags: Vec<usize>,
    /// The correlation at each; empty if the recording is too short to show it.
    at: Vec<f64>,
}

impl Correlation {
    fn of(run: &WindowSolver<'_>, tracks: &Tracks, common: &Common) -> Self {
        let longest = frames_in(MEMORY, common.fps);
        let stride = (longest / 12).max(1);
        let lags: Vec<usize> = (0..=longest).filter(|h| *h < 8 || h % stride == 0).collect();
        if (tracks.frames as f64) < LEAST_SECONDS * common.fps {
            return Self { lags, at: Vec::new() };
        }
        let mut sums = vec![(0.0, 0.0); lags.len()];
        let mut residuals = vec![None; tracks.frames];
        for (j, i) in (0..tracks.joints).flat_map(|j| (0..tracks.views).map(move |i| (j, i))) {
            for (t, residual) in residuals.iter_mut().enumerate() {
                let k = j * tracks.frames + t;
                let ray = &tracks.rays(j, t)[i];
                let offset = ray.offset(&run.points[k]);
                let kept = tracks.active[k]
                    && ray.is_there()
                    && offset.weight(common.sigma[j]) >= REJECTED;
                *residual = kept.then_some(offset.across);
            }
            for (sum, lag) in sums.iter_mut().zip(&lags) {
                let later = residuals.iter().enumerate().skip(*lag);
                for ((t, b), a) in later.zip(&residuals) {
                    if let (Some(a), Some(b), false) = (a, b, tracks.is_cut(t - lag, t)) {
                        *sum = (sum.0 + a.dot(b), sum.1 + 1.0);
                    }
                }
            }
        }
        let square = sums[0].0 / sums[0].1;
        let at: Vec<f64> = sums.iter().map(|(sum, n)| sum / n / square).collect();
        let known = at.iter().all(|rho| rho.is_finite());
        Self { lags, at: if known { at } else { Vec::new() } }
    }

    /// The memory of the errors; their correlation is that of the residuals times `scale`. At the
    /// longest lags it is the constant share c, and (ρ − c)/(1 − c) is that of the rest.
    fn memory(&self, fps: f64, scale: f64) -> Memory {
        let late = frames_in(LATE, fps);
        let last: Vec<f64> = self
            .lags
            .iter()
            .zip(&self.at)
            .filter(|(lag, _)| **lag >= late)
            .map(|(_, r)| *r)
            .collect();
        if last.is_empty() {
            return Memory::usual(fps);
        }
        let mean = scale * last.iter().sum::<f64>() / last.len() as f64;
        let constant = mean.clamp(0.0, MOST_CONSTANT);
        let rest = |k: usize| ((scale * self.at[k] - constant) / (1.0 - constant)).max(0.0);
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

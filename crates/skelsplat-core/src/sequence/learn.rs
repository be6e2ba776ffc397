//! What a recording shows about itself: how agile its joints are, how long its bones, how large and how lasting the errors of its
//! detections.

use nalgebra::Vector3;

use super::posterior;
use super::solver::{Common, Run, frames_in};
use super::tracks::Tracks;
use crate::annealed::consensus::REJECTED;
use crate::bones::Length;

/// Longest time over which an acceleration is measured, s: half of the second difference's span.
const SPAN: f64 = 0.4;
/// Multiple of the noise at which a span shows motion.
const CLEAR: f64 = 2.0;
/// Least share of white noise in the variance of the detections.
const LEAST_WHITE: f64 = 0.1;
/// Agility of joints of which too little is known, mm²/s³: 5 m/s² for a tenth of a second.
const USUAL_AGILITY: f64 = 2.5e6;
/// Bounds of the frequency up to which motion is told from noise, Hz and share of the frame rate.
const SLOWEST: f64 = 0.5;
const FASTEST: f64 = 0.5;
/// Share of the measured agility: less than it allows for is better where detections are wrong (docs/decisions.md).
const AGILITY: f64 = 0.5;
/// Frames needed for an estimate.
const LEAST: usize = 12;
/// Least standard deviation of a bone's length, mm and share of its length.
const LEAST_SPREAD: f64 = 6.0;
const LEAST_SHARE: f64 = 0.02;
/// Weight of the recording's noise for one joint, in degrees of freedom.
const SHARED_DOF: f64 = 50.0;
/// Times, s, up to which errors have a memory, and from which those that remain count as constant.
const MEMORY: [f64; 2] = [0.7, 0.6];
/// Shortest recording, s, whose errors show their memory.
const LEAST_SECONDS: f64 = 3.0;
/// Where it does not: the constant share, the slow share of the rest and its time constant, s, as measured on real recordings.
const USUAL_CONSTANT: f64 = 0.4;
const USUAL_SLOW: f64 = 0.42;
const USUAL_SECONDS: f64 = 0.35;
/// Least sum of weights of a frame that shows the noise: two views.
const LEAST_SUPPORT: f64 = 1.6;
/// Largest constant share.
const MOST_CONSTANT: f64 = 0.8;

/// How long the errors of detections last.
#[derive(Debug, Clone, PartialEq)]
pub struct Memory {
    /// Share of the variance that does not change within seconds.
    pub constant: f64,
    /// Autocorrelation of the rest, from lag 1 on, frame by frame.
    pub rest: Vec<f64>,
}

/// The median; NaN of nothing.
#[must_use]
pub fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// The spectral density q of the acceleration of every joint, mm²/s³, for data of these variances, mm².
///
/// For white acceleration of density q the second difference over the time h has the variance ⅔ q h³ per axis, and for white noise
/// of variance s² per frame 6 s². The shortest span in which motion outweighs the noise counts: there the one is told from the
/// other. Errors with a memory follow the joint, so that only the white part of the noise weighs against the motion; the solver
/// takes the whole variance, and q grows by the same factor.
#[must_use]
pub fn agility(tracks: &Tracks, fps: f64, variance: &[f64]) -> Vec<f64> {
    let own: Vec<(f64, f64)> =
        (0..tracks.joints).map(|j| of_joint(tracks, fps, j, variance[j])).collect();
    let known = own.iter().map(|(q, _)| *q).filter(|q| q.is_finite());
    let shared = Some(median(known.collect())).filter(|q| q.is_finite()).unwrap_or(USUAL_AGILITY);
    let bounded = |((q, white), variance): (&(f64, f64), &f64)| {
        let q = if q.is_finite() { *q } else { shared };
        let at = |f: f64| (std::f64::consts::TAU * f).powi(4) * variance / fps;
        let fastest = FASTEST * fps;
        (AGILITY * q * variance / white).clamp(at(SLOWEST.min(fastest)), at(fastest))
    };
    own.iter().zip(variance).map(bounded).collect()
}

/// q (NaN if too little is known) and the variance of the white noise.
fn of_joint(tracks: &Tracks, fps: f64, j: usize, variance: f64) -> (f64, f64) {
    let of = j * tracks.frames..(j + 1) * tracks.frames;
    let sure = tracks.alone[of.clone()].iter().zip(&tracks.sure[of]);
    let unknown = Vector3::repeat(f64::NAN);
    let x: Vec<Vector3<f64>> = sure.map(|(x, sure)| if *sure { *x } else { unknown }).collect();
    let mut white = variance;
    let mut q = f64::NAN;
    for h in 1..=frames_in(SPAN, fps) {
        let Some(square) = second_moment(&x, h) else { break };
        if h == 1 {
            white = (square / 6.0).clamp(LEAST_WHITE * variance, variance);
        }
        q = 1.5 * (square - 6.0 * white).max(0.6 * white) / (h as f64 / fps).powi(3);
        if square > CLEAR * 6.0 * white {
            break;
        }
    }
    (q, white)
}

/// Variance per axis of the second differences over `h` frames, without the largest tenth: rest and motion both count, jumps do
/// not. `None` if there are few.
fn second_moment(x: &[Vector3<f64>], h: usize) -> Option<f64> {
    let mut squares: Vec<f64> = (h..x.len().saturating_sub(h))
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

/// The length of every bone at `points` `(N, T)`: a weighted median over the frames that see it well, and its spread beyond what
/// their error bars explain. σ is infinite for a bone that no frame shows.
#[must_use]
pub fn lengths(tracks: &Tracks, points: &[Vector3<f64>], bones: &[[usize; 2]]) -> Vec<Length> {
    bones.iter().map(|bone| length(tracks, points, *bone)).collect()
}

/// One frame's length of a bone: the length, its weight, and its variance.
#[derive(Clone, Copy)]
struct Shown {
    length: f64,
    weight: f64,
    variance: f64,
}

fn length(tracks: &Tracks, points: &[Vector3<f64>], [a, b]: [usize; 2]) -> Length {
    let at = |t: usize| (a * tracks.frames + t, b * tracks.frames + t);
    let is_sure = |t: &usize| tracks.sure[at(*t).0] && tracks.sure[at(*t).1];
    let shown = |t: usize| {
        let (a, b) = at(t);
        let spread = tracks.spread[a] + tracks.spread[b];
        let d = points[a] - points[b];
        let (length, u) = (d.norm(), d.normalize());
        let variance = u.dot(&(spread * u));
        let known = tracks.active[a] && tracks.active[b] && variance.is_finite();
        let weight = 1.0 / (variance + LEAST_SPREAD * LEAST_SPREAD);
        known.then_some(Shown { length, weight, variance })
    };
    let sure: Vec<Shown> = (0..tracks.frames).filter(is_sure).filter_map(shown).collect();
    let mut seen =
        if sure.len() >= LEAST { sure } else { (0..tracks.frames).filter_map(shown).collect() };
    if seen.is_empty() {
        return Length { mean: 0.0, sigma: f64::INFINITY };
    }
    let mean = weighted_median(&mut seen);
    let mut off: Vec<Shown> =
        seen.iter().map(|s| Shown { length: (s.length - mean).abs(), ..*s }).collect();
    let scatter = 1.4826 * weighted_median(&mut off);
    let total: f64 = seen.iter().map(|s| s.weight).sum();
    let noise = seen.iter().map(|s| s.weight * s.variance).sum::<f64>() / total;
    let own = (scatter * scatter - noise).max(0.0).sqrt();
    Length { mean, sigma: own.max(LEAST_SPREAD).max(LEAST_SHARE * mean) }
}

fn weighted_median(seen: &mut [Shown]) -> f64 {
    seen.sort_by(|a, b| a.length.total_cmp(&b.length));
    let half = 0.5 * seen.iter().map(|s| s.weight).sum::<f64>();
    let mut sum = 0.0;
    let above = |s: &&Shown| {
        sum += s.weight;
        sum >= half
    };
    seen.iter().find(above).map_or(f64::NAN, |s| s.length)
}

/// What the residuals at the solution tell about the detections.
#[derive(Debug, Clone)]
pub struct Noise {
    /// Variance of a detection of weight 1 of every joint, mm².
    pub variance: Vec<f64>,
    /// How long the errors last.
    pub memory: Memory,
}

impl Noise {
    /// From the residuals of `run`.
    ///
    /// Residuals have 2 Σ k degrees of freedom less those that the position takes up: 3 of errors that last, tr(S D) of white ones,
    /// with the covariance S of the smoothed position. They are scaled up accordingly, by a_l and a_w.
    #[must_use]
    pub fn of(run: &Run<'_>, tracks: &Tracks, common: &Common) -> Self {
        let sums: Vec<Sums> =
            (0..tracks.joints).map(|j| Sums::of(run, tracks, common, j)).collect();
        let all = sums.iter().fold(Sums::default(), Sums::plus);
        let rho = Correlation::of(run, tracks, common);
        let lasting = if rho.at.len() > 1 { rho.at[1].clamp(0.0, 1.0) } else { USUAL_CONSTANT };
        let scale = |taken: f64| all.freedom / (all.freedom - taken).max(0.1 * all.freedom);
        let (of_lasting, of_white) = (scale(3.0 * all.frames), scale(all.taken));
        let growth = lasting * of_lasting + (1.0 - lasting) * of_white;
        let before = median(common.variance.clone());
        let shared = (growth * all.squares + SHARED_DOF * before) / (all.freedom + SHARED_DOF);
        let own = |(sums, sigma): (&Sums, &f64)| {
            let shrunk =
                (growth * sums.squares + SHARED_DOF * shared) / (sums.freedom + SHARED_DOF);
            shrunk / (1.0 - shrunk / (2.0 * common.weight * sigma * sigma)).max(0.25)
        };
        let variance = sums.iter().zip(&common.sigma).map(own).collect();
        Self { variance, memory: rho.memory(common.fps, of_lasting / growth) }
    }
}

/// Sums over the frames of a joint that two views see.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    frames: f64,
    /// Σ c k |e|², mm².
    squares: f64,
    /// 2 Σ k.
    freedom: f64,
    /// tr(S D).
    taken: f64,
}

impl Sums {
    fn of(run: &Run<'_>, tracks: &Tracks, common: &Common, j: usize) -> Self {
        let bands = posterior::bands(run, common, j);
        let mut sums = Self::default();
        for (t, band) in bands.iter().enumerate() {
            let k = j * tracks.frames + t;
            let (mut support, mut squares) = (0.0, 0.0);
            for ray in tracks.rays(j, t).iter().filter(|ray| ray.is_there() && tracks.active[k]) {
                let offset = ray.offset(&run.points[k]);
                let kept = offset.weight(common.sigma[j]);
                support += kept;
                squares += ray.weight * kept * offset.across.norm_squared();
            }
            if support > LEAST_SUPPORT {
                sums.frames += 1.0;
                sums.squares += squares;
                sums.freedom += 2.0 * support;
                sums.taken += (band.own * run.system.blocks[k]).trace().clamp(0.0, 3.0);
            }
        }
        sums
    }

    fn plus(self, other: &Self) -> Self {
        Self {
            frames: self.frames + other.frames,
            squares: self.squares + other.squares,
            freedom: self.freedom + other.freedom,
            taken: self.taken + other.taken,
        }
    }
}

impl Memory {
    /// The memory of errors of which nothing is known.
    #[must_use]
    pub fn usual(fps: f64) -> Self {
        let longest = frames_in(MEMORY[0], fps);
        let after = |lag: usize| USUAL_SLOW * (-(lag as f64) / (USUAL_SECONDS * fps)).exp();
        Self { constant: USUAL_CONSTANT, rest: (1..=longest).map(after).collect() }
    }

    /// The number of frames among `n` that make up an independent detection, apart from the constant share: the mean of `n` errors
    /// has the variance of one times (1 + 2 Σ_h (1 − h/n) ρ_h)/n.
    #[must_use]
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
    fn of(run: &Run<'_>, tracks: &Tracks, common: &Common) -> Self {
        let longest = frames_in(MEMORY[0], common.fps);
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
                for (a, b) in residuals.iter().zip(residuals.get(*lag..).unwrap_or_default()) {
                    if let (Some(a), Some(b)) = (a, b) {
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

    /// The memory of errors whose correlation is that of the residuals times `scale`: at the longest lags it is the constant share c,
    /// and (ρ − c)/(1 − c) is that of the rest.
    fn memory(&self, fps: f64, scale: f64) -> Memory {
        let late = frames_in(MEMORY[1], fps);
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

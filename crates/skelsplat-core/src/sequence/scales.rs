//! The detections' noise in a recording: a scale for each class of joints and each view, which
//! varies slowly in time.
//!
//! A detection of joint j in view i errs by N(0, v/c) across its ray, with its confidence c
//! relative to the mean of its view, or is wrong, with probability ε, anywhere within W:
//!
//! ```text
//! v_ij(t) = v a_class(j) b_i u_ij g(t) g_i(t)      p(e) = (1 − ε) N₂(e; v/c) + ε N₂(0; W²)
//! ```
//!
//! Each factor is the mean of its posterior on a ladder of variances: log p of its residuals, with
//! a normal prior around the factors above, where it stays if they are few. No view can vote for
//! itself: a position takes h of a residual's two degrees of freedom, so that |e|² counts as
//! 2 (1 − h) v with the weight 1 − h.

use std::sync::LazyLock;

use super::noise::{DetectionNoise, Kernel, WIDER};
use super::solver::WindowSolver;
use super::times::{BRIDGE, INDEPENDENT, around, frames_in};
use crate::annealed::Annealing;
use crate::annealed::posterior::PLACED;
use crate::matrix3::inverse;
use crate::statistics::median;

/// Steps of the ladder per doubling of the variance.
const PER_OCTAVE: usize = 2;
/// Doublings of the variance below the usual one at which the ladder begins.
const LOWEST: usize = 4;
/// Its steps: it ends at 32 times the usual noise.
const LEVELS: usize = 29;
/// Squares are counted in bins, four per doubling, the first below 2⁻¹², the last from 2¹⁶.
const BINS: usize = 112;
const FIRST_BIN: i64 = -48;
/// Shares of wrong detections, of which the likeliest is taken.
const WRONG: [f64; 5] = [0.02, 0.1, 0.25, 0.45, 0.65];
/// Standard deviations of the factors' logarithms, doublings, as of real recordings: of classes, of
/// views and times, and of a class in a view or a view in time.
const APART: [f64; 3] = [1.5, 1.0, 0.5];
/// Frames as which any number of a joint in a view counts: errors last, squares correlate by 0.16.
const MOST_FRAMES: f64 = 6.0;
/// Share of the leverage in its frame alone that a position over time takes up: all of errors that
/// last, of white ones what is left after smoothing (measured on real recordings).
pub(super) const TAKEN: f64 = 0.7;

impl DetectionNoise {
    /// The scales that the residuals show, of joints that belong to `classes`.
    pub fn learnt(&self, residuals: &Residuals, classes: &[usize]) -> Self {
        let (n, m) = (classes.len(), self.confidence.len());
        let usual = median(self.variance.iter().copied());
        let counts = residuals.counts(usual);
        let (wrong, ladder) = Ladder::likeliest(usual, &counts);
        let of_cell = |own: &Counts| {
            let share = MOST_FRAMES / (MOST_FRAMES + own.frames);
            ladder.of(own).map(|log| share * log)
        };
        let cells: Vec<Log> = counts.iter().map(of_cell).collect();
        // log p of some cells together, each less the factors that it is known to have.
        let together = |factor: &dyn Fn(usize) -> Option<f64>| {
            let own = (0..n * m).filter_map(|c| Some(shifted(&cells[c], factor(c)?)));
            own.fold([0.0; LEVELS], plus)
        };
        let shared = mean(&together(&|_| Some(0.0)), 0.0, f64::INFINITY);
        let (mut of_class, mut of_view) = (vec![shared; n], vec![0.0; m]);
        for _ in 0..SWEEPS {
            let own = |a: usize| together(&|c| (classes[c / m] == a).then(|| of_view[c % m]));
            of_class = (0..n).map(|a| mean(&own(a), shared, APART[0])).collect();
            let own = |i: usize| together(&|c| (c % m == i).then(|| of_class[classes[c / m]]));
            of_view = (0..m).map(|i| mean(&own(i), 0.0, APART[1])).collect();
        }
        let octaves =
            |c: usize| mean(&cells[c], of_class[classes[c / m]] + of_view[c % m], APART[2]);
        let variance = (0..n * m).map(|c| usual * exp2(octaves(c))).collect();
        let kernel = Kernel { least: WIDER, ..self.kernel.clone() };
        Self { variance, wrong, kernel, ..self.clone() }
    }

    /// How many times the usual variance that of each view `(M, T)` is, from residuals around.
    pub fn in_time(&self, residuals: &Residuals, fps: f64) -> Vec<f64> {
        let (m, t) = (self.confidence.len(), residuals.frames);
        let ladder = Ladder::new(median(self.variance.iter().copied()), self.wrong);
        let (reach, share) = (frames_in(BRIDGE, fps), 1.0 / (1.0 + INDEPENDENT * fps));
        // Running sums `(T + 1, M)`.
        let mut sums = vec![[0.0; LEVELS]; (t + 1) * m];
        for (j, squares) in residuals.squares.chunks(t * m).enumerate() {
            for (k, [square, weight]) in squares.iter().enumerate().filter(|(_, of)| of[1] > 0.0) {
                let row = &ladder.table[bin(square / self.variance[j * m + k % m])];
                sums[m + k].iter_mut().zip(row).for_each(|(sum, p)| *sum += share * weight * p);
            }
        }
        for k in m..sums.len() {
            sums[k] = plus(sums[k], sums[k - m]);
        }
        let mut out = vec![1.0; m * t];
        for k in 0..t {
            let near = around(k, reach, t);
            let of_view = |i: usize| {
                let (first, last) = (&sums[near.start * m + i], &sums[near.end * m + i]);
                std::array::from_fn(|k| last[k] - first[k])
            };
            let shared = mean(&(0..m).map(of_view).fold([0.0; LEVELS], plus), 0.0, APART[1]);
            (0..m).for_each(|i| out[i * t + k] = exp2(mean(&of_view(i), shared, APART[2])));
        }
        out
    }
}

/// Sweeps over classes and views, of which each is measured given the other.
const SWEEPS: usize = 3;

/// log p by the variances of the ladder.
type Log = [f64; LEVELS];

/// Weights of a cell's residuals by the bins of their squares, and the number of its frames.
struct Counts {
    bins: [f64; BINS],
    frames: f64,
}

/// Normal densities of a square in each bin.
static NORMAL: LazyLock<Vec<Log>> = LazyLock::new(|| {
    let of_bin = |b: usize| {
        let quarters = FIRST_BIN + b as i64;
        let (octave, part) = (quarters.div_euclid(4), quarters.rem_euclid(4));
        let square = exp2(octave as f64) * (1.0 + (part as f64 + 0.5) / 4.0);
        std::array::from_fn(|k| (-square / exp2(octaves(k))).exp() / exp2(octaves(k)))
    };
    (0..BINS).map(of_bin).collect()
});

/// log p of squares under each variance of the ladder, in multiples of the usual one.
struct Ladder {
    table: Vec<Log>,
}

impl Ladder {
    /// Of the share of wrong detections that makes all residuals likeliest under one variance.
    fn likeliest(usual: f64, counts: &[Counts]) -> (f64, Self) {
        let all = Counts {
            bins: std::array::from_fn(|b| counts.iter().map(|own| own.bins[b]).sum()),
            frames: 0.0,
        };
        let of_share = |wrong| {
            let ladder = Self::new(usual, wrong);
            let most = ladder.of(&all).into_iter().fold(f64::NEG_INFINITY, f64::max);
            (most, wrong, ladder)
        };
        let likelier = |a: (f64, f64, Self), b: (f64, f64, Self)| if b.0 > a.0 { b } else { a };
        let first = of_share(WRONG[0]);
        let (_, wrong, ladder) = WRONG[1..].iter().map(|w| of_share(*w)).fold(first, likelier);
        (wrong, ladder)
    }

    fn new(usual: f64, wrong: f64) -> Self {
        let elsewhere = wrong * usual / (Annealing::START * Annealing::START);
        let of_bin = |row: &Log| row.map(|p| ((1.0 - wrong) * p + elsewhere).ln());
        Self { table: NORMAL.iter().map(of_bin).collect() }
    }

    /// log p of these squares.
    fn of(&self, counts: &Counts) -> Log {
        let mut out = [0.0; LEVELS];
        for (row, n) in self.table.iter().zip(counts.bins).filter(|(_, n)| *n > 0.0) {
            out.iter_mut().zip(row).for_each(|(sum, log)| *sum += n * log);
        }
        out
    }
}

/// The bin of a positive number: exponent and first two bits of the mantissa.
#[inline]
fn bin(x: f64) -> usize {
    let quarters = (x.to_bits() >> 50) as i64 - (1023 << 2);
    (quarters - FIRST_BIN).clamp(0, BINS as i64 - 1) as usize
}

/// Doublings of the usual variance at a step of the ladder.
fn octaves(level: usize) -> f64 {
    level as f64 / PER_OCTAVE as f64 - LOWEST as f64
}

fn exp2(x: f64) -> f64 {
    (x * std::f64::consts::LN_2).exp()
}

fn plus(mut a: Log, b: Log) -> Log {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
    a
}

/// log p by the variance that is left when so many doublings are taken off.
fn shifted(log: &Log, octaves: f64) -> Log {
    std::array::from_fn(|k| {
        let at = (k as f64 + octaves * PER_OCTAVE as f64).clamp(0.0, (LEVELS - 1) as f64);
        let below = (at as usize).min(LEVELS - 2);
        let part = at - below as f64;
        log[below] * (1.0 - part) + log[below + 1] * part
    })
}

/// Mean of the posterior of a factor's logarithm, doublings, with a normal prior.
fn mean(log: &Log, prior: f64, spread: f64) -> f64 {
    let of_level = |k: usize| log[k] - 0.5 * ((octaves(k) - prior) / spread).powi(2);
    let most = (0..LEVELS).map(of_level).fold(f64::NEG_INFINITY, f64::max);
    let (mut sum, mut weights, least) = (0.0, 0.0, most + f64::EPSILON.ln());
    for k in (0..LEVELS).filter(|k| of_level(*k) > least) {
        let weight = (of_level(k) - most).exp();
        (sum, weights) = (sum + weight * octaves(k), weights + weight);
    }
    sum / weights
}

/// Squares of the residuals along a path.
pub struct Residuals {
    frames: usize,
    views: usize,
    /// ½ c |e|²/(1 − h), mm², and 1 − h `(N, T, M)`; 0 where it shows nothing.
    squares: Vec<[f64; 2]>,
}

impl Residuals {
    /// Along the path of `run`, by the system as it was filled last, under kernels that are so much
    /// `wider` than the final ones; positions take up `taken` of the leverage in their frames.
    pub fn of(run: &WindowSolver<'_>, wider: f64, taken: f64) -> Self {
        let (tracks, confidence) = (run.tracks, &run.common.noise.confidence);
        let (t, m) = (tracks.frames, tracks.views);
        let mut squares = vec![[0.0; 2]; tracks.active.len() * m];
        let mut kept = vec![0.0; m];
        for k in (0..tracks.active.len()).filter(|k| tracks.active[*k]) {
            let (rays, x) = (tracks.rays(k / t, k % t), &run.points[k]);
            let own = kept.iter_mut().enumerate();
            own.for_each(|(i, kept)| *kept = tracks.trust(k, i, x, wider));
            if kept.iter().sum::<f64>() <= PLACED {
                continue;
            }
            let spread = inverse(&run.system.blocks[k]);
            for (i, ray) in rays.iter().enumerate().filter(|(_, ray)| ray.is_there()) {
                let across = spread.trace() - ray.direction.dot(&(spread * ray.direction));
                let leverage = 0.5 * tracks.weights[k * m + i].precision * kept[i] * across;
                let left = 1.0 - taken * leverage.clamp(0.0, 1.0);
                let square = ray.offset(x).across.norm_squared() * ray.weight / confidence[i];
                squares[k * m + i] = [0.5 * square / left, left];
            }
        }
        Self { frames: t, views: m, squares }
    }

    /// Of every joint and view `(N, M)`, squares in multiples of the usual one.
    fn counts(&self, usual: f64) -> Vec<Counts> {
        let of_joint = self.squares.chunks((self.frames * self.views).max(1)).flat_map(|own| {
            (0..self.views).map(|i| {
                let mut out = Counts { bins: [0.0; BINS], frames: 0.0 };
                let of_view = own.iter().skip(i).step_by(self.views);
                for [square, weight] in of_view.filter(|of| of[1] > 0.0) {
                    out.bins[bin(square / usual)] += weight;
                    out.frames += 1.0;
                }
                out
            })
        });
        of_joint.collect()
    }

    /// How many times as large as the residuals' the correlation of the errors is: positions take
    /// up all the leverage of errors that last, `taken` of it of all.
    pub(super) fn absorbed(&self, taken: f64) -> f64 {
        let known = self.squares.iter().filter(|s| s[1] > 0.0);
        let sums = known.fold([0.0; 2], |a, s| [a[0] + s[1], a[1] + 1.0 - (1.0 - s[1]) / taken]);
        if sums[1] > 0.0 { sums[0] / sums[1] } else { 1.0 }
    }
}

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
//! a normal prior around the factors above. So it follows residuals where there are many, and
//! stays where there are few. No view can vote for itself: a position takes h of a residual's two
//! degrees of freedom, so that |e|² counts as 2 (1 − h) v with the weight 1 − h.

use super::noise::DetectionNoise;
use super::solver::WindowSolver;
use super::tracks::Tracks;
use super::windows::{around, frames_in};
use crate::matrix3::inverse;
use crate::statistics::median;

/// Steps of the ladder per doubling of the variance.
const PER_OCTAVE: f64 = 2.0;
/// Doublings of the variance below the usual one at which the ladder begins.
const LOWEST: f64 = 4.0;
/// Its steps: it ends at 32 times the usual noise.
const LEVELS: usize = 29;
/// Squares are counted in bins, four per doubling, the first below 2⁻¹², the last from 2¹⁶.
const BINS: usize = 112;
const FIRST_BIN: i64 = -48;
/// Shares of wrong detections, of which the likeliest is taken.
const WRONG: [f64; 5] = [0.02, 0.1, 0.25, 0.45, 0.65];
/// Standard deviation of wrong detections per axis, mm: as in a frame's evidence.
const ANYWHERE: f64 = 320.0;
/// Standard deviations of the factors' logarithms, doublings: classes and views of real recordings
/// differ by about as much; the rest is small.
const OF_CLASS: f64 = 1.5;
const OF_VIEW: f64 = 1.0;
const OF_CELL: f64 = 0.5;
const OF_TIME: f64 = 1.0;
/// Frames as which any number of them of a joint in a view counts at most: two fifths of the errors
/// do not change within seconds, so that their squares are correlated by 0.16.
const MOST_FRAMES: f64 = 6.0;
/// Half of the time over which a scale is measured, s.
const AROUND: f64 = 1.0;
/// Time in which errors become independent, s.
const INDEPENDENT: f64 = 0.2;
/// Least sum of weights of a frame that shows the noise: two views.
const LEAST_SUPPORT: f64 = 1.6;
/// Share of a lasting error's leverage where the recording has not yet shown how long errors last.
pub(super) const USUAL_TAKEN: f64 = 0.7;

impl DetectionNoise {
    /// The scales that the residuals show, of joints that belong to `classes`.
    pub fn learnt(&self, residuals: &Residuals, classes: &[usize]) -> Self {
        let (n, m) = (classes.len(), self.confidence.len());
        let usual = median(self.variance.iter().copied());
        let (wrong, ladder) = Ladder::likeliest(usual, residuals);
        let mut cells = vec![[0.0; LEVELS]; n * m];
        for (c, cell) in cells.iter_mut().enumerate() {
            let (mut sum, mut frames) = ([0.0; LEVELS], 0.0);
            for [square, weight] in residuals.of_cell(c / m, c % m) {
                ladder.add(square / usual, weight, &mut sum);
                frames += 1.0;
            }
            let share = MOST_FRAMES / (MOST_FRAMES + frames);
            cell.iter_mut().zip(sum).for_each(|(to, of)| *to = share * of);
        }
        let mut factors = Factors::shared(&cells);
        for _ in 0..SWEEPS {
            factors.of_classes(&cells, classes, m);
            factors.of_views(&cells, classes, m);
        }
        let variance = (0..n * m).map(|c| usual * exp2(factors.of_cell(&cells[c], classes, c, m)));
        Self { variance: variance.collect(), wrong, ..self.clone() }
    }

    /// How many times the usual variance that of each view `(M, T)` is, from residuals around.
    pub fn in_time(&self, residuals: &Residuals, fps: f64) -> Vec<f64> {
        let (m, t) = (self.confidence.len(), residuals.frames);
        let usual = median(self.variance.iter().copied());
        let ladder = Ladder::new(usual, self.wrong);
        let share = 1.0 / (1.0 + INDEPENDENT * fps);
        let reach = frames_in(AROUND, fps);
        let mut sums = vec![[0.0; LEVELS]; m * (t + 1)];
        for i in 0..m {
            for k in 0..t {
                let mut sum = sums[i * (t + 1) + k];
                for j in 0..residuals.joints() {
                    let [square, weight] = residuals.at(j, k, i);
                    if weight > 0.0 {
                        ladder.add(square / self.variance[j * m + i], share * weight, &mut sum);
                    }
                }
                sums[i * (t + 1) + k + 1] = sum;
            }
        }
        let mut out = vec![1.0; m * t];
        for k in 0..t {
            let near = around(k, reach, t);
            let of_view = |i: usize| {
                let (first, last) =
                    (&sums[i * (t + 1) + near.start], &sums[i * (t + 1) + near.end]);
                let mut sum = [0.0; LEVELS];
                sum.iter_mut().zip(first.iter().zip(last)).for_each(|(s, (a, b))| *s = b - a);
                sum
            };
            let all = (0..m).map(of_view).fold([0.0; LEVELS], plus);
            let shared = mean(&all, 0.0, OF_TIME);
            (0..m).for_each(|i| out[i * t + k] = exp2(mean(&of_view(i), shared, OF_CELL)));
        }
        out
    }
}

/// Sweeps over classes and views, of which each is measured given the other.
const SWEEPS: usize = 3;

/// Logarithms of the factors, doublings of the usual variance.
struct Factors {
    shared: f64,
    classes: Vec<f64>,
    views: Vec<f64>,
}

impl Factors {
    fn shared(cells: &[[f64; LEVELS]]) -> Self {
        let all = cells.iter().copied().fold([0.0; LEVELS], plus);
        let shared = mean(&all, 0.0, f64::INFINITY);
        Self { shared, classes: Vec::new(), views: Vec::new() }
    }

    fn of_classes(&mut self, cells: &[[f64; LEVELS]], classes: &[usize], m: usize) {
        self.views.resize(m, 0.0);
        let of_class = |class: usize| {
            let own = cells.iter().enumerate().filter(|(c, _)| classes[c / m] == class);
            let sum = own
                .fold([0.0; LEVELS], |sum, (c, cell)| plus(sum, shifted(cell, self.views[c % m])));
            mean(&sum, self.shared, OF_CLASS)
        };
        self.classes = (0..classes.len()).map(of_class).collect();
    }

    fn of_views(&mut self, cells: &[[f64; LEVELS]], classes: &[usize], m: usize) {
        let of_view = |i: usize| {
            let own = cells.iter().enumerate().skip(i).step_by(m);
            let sum = own.fold([0.0; LEVELS], |sum, (c, cell)| {
                plus(sum, shifted(cell, self.classes[classes[c / m]]))
            });
            mean(&sum, 0.0, OF_VIEW)
        };
        self.views = (0..m).map(of_view).collect();
    }

    fn of_cell(&self, cell: &[f64; LEVELS], classes: &[usize], c: usize, m: usize) -> f64 {
        mean(cell, self.classes[classes[c / m]] + self.views[c % m], OF_CELL)
    }
}

/// log p of squares under each variance of the ladder, in multiples of the usual one.
struct Ladder {
    table: Vec<[f64; LEVELS]>,
}

impl Ladder {
    /// Of the share of wrong detections that makes all residuals likeliest under one variance.
    fn likeliest(usual: f64, residuals: &Residuals) -> (f64, Self) {
        let mut counts = [0.0; BINS];
        for [square, weight] in residuals.squares.iter().filter(|s| s[1] > 0.0) {
            counts[bin(square / usual)] += weight;
        }
        let likelihood = |ladder: &Self| {
            let of = |k: usize| ladder.table.iter().zip(&counts).map(|(row, n)| row[k] * n).sum();
            (0..LEVELS).map(of).fold(f64::NEG_INFINITY, f64::max)
        };
        let all = WRONG.map(|wrong| (wrong, Self::new(usual, wrong)));
        let best = all.into_iter().max_by(|a, b| likelihood(&a.1).total_cmp(&likelihood(&b.1)));
        best.unwrap_or_else(|| (WRONG[1], Self::new(usual, WRONG[1])))
    }

    fn new(usual: f64, wrong: f64) -> Self {
        let elsewhere = wrong * usual / (ANYWHERE * ANYWHERE);
        let of_bin = |b: usize| {
            let quarters = FIRST_BIN + b as i64;
            let (octave, part) = (quarters.div_euclid(4), quarters.rem_euclid(4));
            let square = exp2(octave as f64) * (1.0 + (part as f64 + 0.5) / 4.0);
            std::array::from_fn(|k| {
                let variance = exp2(octaves(k));
                ((1.0 - wrong) / variance * (-square / variance).exp() + elsewhere).ln()
            })
        };
        Self { table: (0..BINS).map(of_bin).collect() }
    }

    /// Adds log p of a square, half of |e|² in multiples of the usual variance, `weight` times.
    #[inline]
    fn add(&self, square: f64, weight: f64, sum: &mut [f64; LEVELS]) {
        let row = &self.table[bin(square)];
        sum.iter_mut().zip(row).for_each(|(sum, log)| *sum += weight * log);
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
    level as f64 / PER_OCTAVE - LOWEST
}

fn exp2(x: f64) -> f64 {
    (x * std::f64::consts::LN_2).exp()
}

fn plus(mut a: [f64; LEVELS], b: [f64; LEVELS]) -> [f64; LEVELS] {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
    a
}

/// log p by the variance that is left when so many doublings are taken off.
fn shifted(log: &[f64; LEVELS], octaves: f64) -> [f64; LEVELS] {
    std::array::from_fn(|k| {
        let at = (k as f64 + octaves * PER_OCTAVE).clamp(0.0, (LEVELS - 1) as f64);
        let below = (at as usize).min(LEVELS - 2);
        let part = at - below as f64;
        log[below] * (1.0 - part) + log[below + 1] * part
    })
}

/// Mean of the posterior of a factor's logarithm, doublings, with a normal prior.
fn mean(log: &[f64; LEVELS], prior: f64, spread: f64) -> f64 {
    let of_level = |k: usize| log[k] - 0.5 * ((octaves(k) - prior) / spread).powi(2);
    let most = (0..LEVELS).map(of_level).fold(f64::NEG_INFINITY, f64::max);
    let (mut sum, mut weights) = (0.0, 0.0);
    for k in 0..LEVELS {
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
    /// Along the path of `run`, whose system is filled there; the position of joint j takes up
    /// `taken[j]` of the leverage that it has in its frame alone. The path is that under kernels
    /// `wider` than the final ones.
    pub fn of(
        run: &WindowSolver<'_>,
        tracks: &Tracks,
        taken: &[f64],
        wider: f64,
        confidence: &[f64],
    ) -> Self {
        let (t, m) = (tracks.frames, tracks.views);
        let mut squares = vec![[0.0; 2]; tracks.active.len() * m];
        for k in (0..tracks.active.len()).filter(|k| tracks.active[*k]) {
            let rays = tracks.rays(k / t, k % t);
            let x = &run.points[k];
            let kept = |i: usize| tracks.trust_under(k, i, x, wider);
            let there = || (0..m).filter(|i| rays[*i].is_there());
            if there().map(kept).sum::<f64>() <= LEAST_SUPPORT {
                continue;
            }
            let spread = inverse(&run.system.blocks[k]);
            for i in there() {
                let ray = &rays[i];
                let across = spread.trace() - ray.direction.dot(&(spread * ray.direction));
                let leverage = 0.5 * tracks.precision[k * m + i] * kept(i) * across;
                let left = 1.0 - taken[k / t] * leverage.clamp(0.0, 1.0);
                let square = ray.offset(x).across.norm_squared() * ray.weight / confidence[i];
                squares[k * m + i] = [0.5 * square / left, left];
            }
        }
        Self { frames: t, views: m, squares }
    }

    fn joints(&self) -> usize {
        self.squares.len() / (self.frames * self.views).max(1)
    }

    #[inline]
    fn at(&self, j: usize, t: usize, i: usize) -> [f64; 2] {
        self.squares[(j * self.frames + t) * self.views + i]
    }

    fn of_cell(&self, j: usize, i: usize) -> impl Iterator<Item = [f64; 2]> + '_ {
        (0..self.frames).map(move |t| self.at(j, t, i)).filter(|[_, weight]| *weight > 0.0)
    }

    /// Mean of 1 − h of the joints `of`.
    pub(super) fn left(&self, of: impl Iterator<Item = usize>) -> f64 {
        let size = self.frames * self.views;
        let all = of.flat_map(|j| &self.squares[j * size..(j + 1) * size]);
        let (sum, n) = all.filter(|s| s[1] > 0.0).fold((0.0, 0.0), |a, s| (a.0 + s[1], a.1 + 1.0));
        sum / n
    }
}

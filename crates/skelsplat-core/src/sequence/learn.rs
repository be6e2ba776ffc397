//! What a recording shows about its motion: how agile its joints are and how long its bones.

use nalgebra::Vector3;

use super::small::median;
use super::solver::frames_in;
use super::tracks::Tracks;
use crate::bones::Length;
use crate::bones::expected::{Expected, Shown, stature};
use crate::bones::population::Proportion;

/// Longest time over which an acceleration is measured, s: half of the second difference's span.
pub(super) const SPAN: f64 = 0.4;
/// Multiple of the noise at which a span shows motion.
const CLEAR: f64 = 2.0;
/// Least share of white noise in the variance of the detections.
pub(super) const LEAST_WHITE: f64 = 0.1;
/// Agility of joints of which too little is known, mm²/s³: 5 m/s² for a tenth of a second.
pub(super) const USUAL_AGILITY: f64 = 2.5e6;
/// Bounds of the cut-off frequency between motion and noise, Hz and as a share of the frame rate.
const SLOWEST: f64 = 0.5;
const FASTEST: f64 = 0.5;
/// Share of the measured agility: less than it allows for is better where detections are wrong (docs/decisions.md).
const AGILITY: f64 = 0.5;
/// Frames needed for an estimate.
const LEAST: usize = 12;
/// Least standard deviation of a bone's length, mm and share of its length.
pub(super) const LEAST_SPREAD: f64 = 6.0;
pub(super) const LEAST_SHARE: f64 = 0.02;
/// Share of a length's variance in one frame that all frames have in common.
const LASTING: f64 = 0.5;
/// Multiple of the population's spread: less errs where frames see a bone badly (docs/decisions.md).
const LOOSE: f64 = 3.0;
/// Standard errors between the measured and the expected length of a bone, from which they contradict each other.
const CONTRADICTS: f64 = 3.0;

/// The spectral density q of the acceleration of every joint, mm²/s³, for data of these variances, mm².
///
/// For white acceleration of density q the second difference over the time h has the variance ⅔ q h³ per axis, and for white noise
/// of variance s² per frame 6 s². The shortest span in which motion outweighs the noise counts: only there can they be
/// told apart. Errors with a memory follow the joint, so that only the white part of the noise weighs against the motion; the solver
/// takes the whole variance, and q grows by the same factor.
#[must_use]
pub fn agility(tracks: &Tracks, fps: f64, variance: &[f64]) -> Vec<f64> {
    let own: Vec<(f64, f64)> =
        (0..tracks.joints).map(|j| of_joint(tracks, fps, j, variance[j])).collect();
    let known = own.iter().map(|(q, _)| *q).filter(|q| q.is_finite());
    let shared = median(known.collect()).max(USUAL_AGILITY);
    let of_its_own = |((q, white), variance): (&(f64, f64), &f64)| {
        bounded(if q.is_finite() { *q } else { shared }, *white, *variance, fps)
    };
    own.iter().zip(variance).map(of_its_own).collect()
}

/// q for data of this variance, of which `white` is white, within the bounds.
pub(super) fn bounded(q: f64, white: f64, variance: f64, fps: f64) -> f64 {
    let at = |f: f64| (std::f64::consts::TAU * f).powi(4) * variance / fps;
    let fastest = FASTEST * fps;
    (AGILITY * q * variance / white).clamp(at(SLOWEST.min(fastest)), at(fastest))
}

/// q by the variances of second differences over spans of h frames, for noise of the variance `white`: the first span in which
/// motion outweighs the noise counts. NaN of nothing.
pub(super) fn density(squares: impl Iterator<Item = (usize, f64)>, white: f64, fps: f64) -> f64 {
    let mut q = f64::NAN;
    for (h, square) in squares {
        q = 1.5 * (square - 6.0 * white).max(0.6 * white) / (h as f64 / fps).powi(3);
        if square > CLEAR * 6.0 * white {
            break;
        }
    }
    q
}

/// q (NaN if too little is known) and the variance of the white noise.
fn of_joint(tracks: &Tracks, fps: f64, j: usize, variance: f64) -> (f64, f64) {
    let of = j * tracks.frames..(j + 1) * tracks.frames;
    let sure = tracks.alone[of.clone()].iter().zip(&tracks.sure[of]);
    let unknown = Vector3::repeat(f64::NAN);
    let x: Vec<Vector3<f64>> = sure.map(|(x, sure)| if *sure { *x } else { unknown }).collect();
    let joined = |a: usize, b: usize| !tracks.is_cut(a, b);
    let Some(first) = second_moment(&x, 1, joined) else { return (f64::NAN, variance) };
    let white = (first / 6.0).clamp(LEAST_WHITE * variance, variance);
    let spans = frames_in(SPAN, fps);
    let longer = (2..=spans).map_while(|h| Some((h, second_moment(&x, h, joined)?)));
    let squares: Vec<(usize, f64)> = std::iter::once((1, first)).chain(longer).collect();
    // Too short a recording may end before a slow joint has moved: then little motion in few frames means nothing.
    let shows =
        squares.len() == spans || squares.iter().any(|(_, square)| *square > CLEAR * 6.0 * white);
    (if shows { density(squares.into_iter(), white, fps) } else { f64::NAN }, white)
}

/// Variance per axis of the second differences over `h` frames, between frames that are `joined` and without the largest tenth: rest
/// and motion both count, jumps do not. `None` if there are few.
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

/// The length of every bone at `points` `(N, T)`: what the frames show, with what is expected as its prior. σ is infinite for a
/// bone that no frame shows and of which nothing is known.
#[must_use]
pub fn lengths(
    tracks: &Tracks,
    points: &[Vector3<f64>],
    bones: &[[usize; 2]],
    expected: &Expected,
) -> Vec<Length> {
    let measured: Vec<Option<Measured>> =
        bones.iter().map(|bone| measure(tracks, points, *bone)).collect();
    let of = |joints: [usize; 2]| bones.iter().position(|b| *b == joints).and_then(|b| measured[b]);
    let shown = |p: &Proportion| {
        let m = of(p.joints).filter(|m| m.well)?;
        Some(Shown { proportion: *p, length: m.length.mean, variance: m.variance })
    };
    let stature = stature(expected.proportions.iter().filter_map(shown));
    let of_population = |joints: [usize; 2]| {
        let own = expected.proportions.iter().find(|p| p.joints == joints)?.at(stature);
        Some(Length { sigma: LOOSE * own.sigma, ..own })
    };
    let prior = |joints: [usize; 2]| expected.given(joints).or_else(|| of_population(joints));
    bones.iter().zip(&measured).map(|(b, m)| combined(*m, prior(*b))).collect()
}

/// What the frames show of a bone.
#[derive(Debug, Clone, Copy)]
struct Measured {
    /// The length and its spread over the frames.
    length: Length,
    /// Variance of the mean length, mm²: most errors last.
    variance: f64,
    /// Whether enough frames see both ends well.
    well: bool,
}

/// A measured length with a prior, by their precisions. Of two lengths that contradict each other, the frames' one counts if they see the
/// bone well.
fn combined(measured: Option<Measured>, prior: Option<Length>) -> Length {
    let (m, prior) = match (measured, prior) {
        (None, None) => return Length { mean: 0.0, sigma: f64::INFINITY },
        (None, Some(prior)) => return prior,
        (Some(m), None) => return m.length,
        (Some(m), Some(prior)) => (m, prior),
    };
    let square = prior.sigma * prior.sigma;
    let off = m.length.mean - prior.mean;
    if m.well && off * off > CONTRADICTS * CONTRADICTS * (m.variance + square) {
        return m.length;
    }
    let share = m.variance / (m.variance + square);
    let left = if m.well { 0.0 } else { share * square };
    let sigma = (m.length.sigma.powi(2) + left).sqrt();
    Length { mean: m.length.mean - share * off, sigma }
}

/// One frame's length of a bone: the length, its weight, and its variance.
#[derive(Clone, Copy)]
struct InFrame {
    length: f64,
    weight: f64,
    variance: f64,
}

fn measure(tracks: &Tracks, points: &[Vector3<f64>], [a, b]: [usize; 2]) -> Option<Measured> {
    let at = |t: usize| (a * tracks.frames + t, b * tracks.frames + t);
    let is_sure = |t: &usize| tracks.sure[at(*t).0] && tracks.sure[at(*t).1];
    let in_frame = |t: usize| {
        let (a, b) = at(t);
        let spread = tracks.spread[a] + tracks.spread[b];
        let d = points[a] - points[b];
        let (length, u) = (d.norm(), d.normalize());
        let variance = u.dot(&(spread * u));
        let known = tracks.active[a] && tracks.active[b] && variance.is_finite();
        let weight = 1.0 / (variance + LEAST_SPREAD * LEAST_SPREAD);
        known.then_some(InFrame { length, weight, variance })
    };
    let sure: Vec<InFrame> = (0..tracks.frames).filter(is_sure).filter_map(in_frame).collect();
    let well = sure.len() >= LEAST;
    let mut seen = if well { sure } else { (0..tracks.frames).filter_map(in_frame).collect() };
    if seen.is_empty() {
        return None;
    }
    let mean = weighted_median(&mut seen);
    let mut off: Vec<InFrame> =
        seen.iter().map(|s| InFrame { length: (s.length - mean).abs(), ..*s }).collect();
    let scatter = 1.4826 * weighted_median(&mut off);
    let total: f64 = seen.iter().map(|s| s.weight).sum();
    let noise = seen.iter().map(|s| s.weight * s.variance).sum::<f64>() / total;
    let own = (scatter * scatter - noise).max(0.0).sqrt();
    let length = Length { mean, sigma: own.max(LEAST_SPREAD).max(LEAST_SHARE * mean) };
    let variance = if well { LASTING * noise } else { noise + scatter * scatter };
    Some(Measured { length, variance, well })
}

fn weighted_median(seen: &mut [InFrame]) -> f64 {
    seen.sort_by(|a, b| a.length.total_cmp(&b.length));
    let half = 0.5 * seen.iter().map(|s| s.weight).sum::<f64>();
    let mut sum = 0.0;
    let above = |s: &&InFrame| {
        sum += s.weight;
        sum >= half
    };
    seen.iter().find(above).map_or(f64::NAN, |s| s.length)
}

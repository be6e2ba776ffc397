//! What a recording shows: what is the same for every window, and how long its bones are.

use nalgebra::Vector3;

use super::lasting::{Memory, USUAL_SHARE};
use super::solver::{Common, UNSURE_REACH};
use super::tracks::Tracks;
use crate::bones::expected::{Expected, Shown, stature};
use crate::bones::population::Proportion;
use crate::bones::{Length, REACH};
use crate::statistics::weighted_median;

/// Frames needed for an estimate.
pub(super) const LEAST: usize = 12;
/// Least standard deviation of a bone's length, mm.
pub(super) const LEAST_SPREAD: f64 = 6.0;
/// Multiple of the population's spread: less errs where frames see a bone badly
/// (docs/decisions.md).
const LOOSE: f64 = 3.0;

/// What is known of a recording from a sample of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Known {
    /// The body's size in multiples of a person's.
    pub(super) size: f64,
    /// Before the path of the sample was found: windows look for their path with the same
    /// knowledge.
    pub(super) first: Common,
    /// Along its path under wide kernels.
    pub(super) wide: Common,
    /// Along the path.
    pub(super) learnt: Learnt,
}

/// What is learnt along the path of a sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Learnt {
    /// What all frames have in common.
    pub common: Common,
    /// How long the errors of each joint's detections last.
    pub memory: Vec<Memory>,
    /// Whether the sample shows each bone.
    pub shown: Vec<bool>,
}

impl Known {
    /// Number of joints.
    pub(super) fn n_joints(&self) -> usize {
        self.first.noise.kernel.sigma.len()
    }
}

/// The length of every bone at `points` `(N, T)`: what the frames show, with what is expected as
/// its prior. σ is infinite for a bone that no frame shows and of which nothing is known.
/// A length that no person has is not believed.
pub fn lengths(
    tracks: &Tracks,
    points: &[Vector3<f64>],
    bones: &[[usize; 2]],
    expected: &Expected,
) -> Vec<Length> {
    let measured: Vec<Option<MeasuredLength>> =
        bones.iter().map(|b| measure(tracks, points, *b, expected.given(*b))).collect();
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
    let joined = |(b, m): (&[usize; 2], &Option<MeasuredLength>)| {
        let own = of_population(*b);
        let possible = |m: &MeasuredLength| {
            own.is_none_or(|own| (m.length.mean - own.mean).abs() <= REACH * own.sigma)
        };
        combined(m.filter(possible), expected.given(*b).or(own))
    };
    bones.iter().zip(&measured).map(joined).collect()
}

/// Whether any frame sees both ends of each bone well.
pub fn shown(tracks: &Tracks, bones: &[[usize; 2]]) -> Vec<bool> {
    bones.iter().map(|bone| (0..tracks.frames).any(|t| tracks.see_bone(*bone, t))).collect()
}

/// What the frames show of a bone.
#[derive(Debug, Clone, Copy)]
struct MeasuredLength {
    /// The length and its spread over the frames.
    length: Length,
    /// Variance of the mean length, mm²: most errors last.
    variance: f64,
    /// Whether enough frames see both ends well.
    well: bool,
}

/// A measured length with a prior, by their precisions. Of two lengths that contradict each other,
/// the frames' one counts if they see the bone well.
fn combined(measured: Option<MeasuredLength>, prior: Option<Length>) -> Length {
    let (m, prior) = match (measured, prior) {
        (None, None) => return Length { mean: 0.0, sigma: f64::INFINITY },
        (None, Some(prior)) => return prior,
        (Some(m), None) => return m.length,
        (Some(m), Some(prior)) => (m, prior),
    };
    let square = prior.sigma * prior.sigma;
    let off = m.length.mean - prior.mean;
    if m.well && off * off > UNSURE_REACH * UNSURE_REACH * (m.variance + square) {
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

fn measure(
    tracks: &Tracks,
    points: &[Vector3<f64>],
    bone: [usize; 2],
    given: Option<Length>,
) -> Option<MeasuredLength> {
    let in_frame = |t: usize| {
        let (a, b) = (tracks.at(bone[0], t), tracks.at(bone[1], t));
        let spread = tracks.spread[a] + tracks.spread[b];
        let d = points[a] - points[b];
        let (length, u) = (d.norm(), d.normalize());
        let variance = u.dot(&(spread * u));
        let known = tracks.active[a] && tracks.active[b] && variance.is_finite();
        let weight = 1.0 / (variance + LEAST_SPREAD * LEAST_SPREAD);
        known.then_some(InFrame { length, weight, variance })
    };
    let sure = (0..tracks.frames).filter(|t| tracks.see_bone(bone, *t));
    let sure: Vec<InFrame> = sure.filter_map(in_frame).collect();
    let well = sure.len() >= LEAST;
    let mut seen = if well { sure } else { (0..tracks.frames).filter_map(in_frame).collect() };
    if seen.is_empty() {
        return None;
    }
    let mean = weighted_median(&mut seen, |s| (s.length, s.weight));
    let total: f64 = seen.iter().map(|s| s.weight).sum();
    let noise = seen.iter().map(|s| s.weight * s.variance).sum::<f64>() / total;
    let off = |s: &InFrame| ((s.length - mean).abs(), s.weight);
    let scatter = 1.4826 * weighted_median(&mut seen, off);
    let own = (scatter * scatter - noise).max(0.0).sqrt();
    let least = given.map_or(LEAST_SPREAD, |given| given.sigma.min(LEAST_SPREAD));
    let length = Length { mean, sigma: own.max(least) };
    let variance = if well { USUAL_SHARE * noise } else { noise + scatter * scatter };
    Some(MeasuredLength { length, variance, well })
}

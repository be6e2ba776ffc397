//! What a recording shows about its bones: how long they are.

use nalgebra::Vector3;

use super::tracks::Tracks;
use crate::bones::Length;

/// Frames needed for an estimate.
const LEAST: usize = 12;
/// Least standard deviation of a bone's length, mm and share of its length.
pub(super) const LEAST_SPREAD: f64 = 6.0;
pub(super) const LEAST_SHARE: f64 = 0.02;

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

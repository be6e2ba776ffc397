//! Left and right swapped in a view of a recording: the path decides, and a swap lasts.
//!
//! The frames alone have corrected what three views show. Along the path that all frames agree on, two views suffice, and
//! since a swap lasts for some frames, a frame's neighbours vote as well.

use super::solver::{Common, frames_in};
use super::tracks::Tracks;
use crate::annealed::swaps::Chain;
use nalgebra::Vector3;

/// Detections of mean weight by which a swap explains more: in the frame, and in the mean over the frames around it.
const OWN_GAIN: f64 = 0.5;
const MEAN_GAIN: f64 = 1.0;
/// Half of the time over which the gain is averaged, s.
const AROUND: f64 = 0.05;

/// A chain of joints swapped in a view of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Swap {
    pub(super) frame: usize,
    pub(super) view: usize,
    pub(super) chain: usize,
}

/// The swaps that the path `points` `(N, T)` shows.
pub(super) fn find(
    tracks: &Tracks,
    chains: &[Chain],
    points: &[Vector3<f64>],
    common: &Common,
) -> Vec<Swap> {
    let unit = common.weight;
    let around = frames_in(AROUND, common.fps);
    let mut found = Vec::new();
    for (chain, pairs) in chains.iter().enumerate() {
        for view in 0..tracks.views {
            let gains: Vec<f64> = (0..tracks.frames)
                .map(|t| {
                    pairs.iter().map(|pair| gain(tracks, points, common, view, t, *pair)).sum()
                })
                .collect();
            for (frame, own) in gains.iter().enumerate().filter(|(_, g)| **g >= OWN_GAIN * unit) {
                let near =
                    &gains[frame.saturating_sub(around)..(frame + around + 1).min(gains.len())];
                if near.iter().sum::<f64>() >= MEAN_GAIN * unit * near.len() as f64 && *own > 0.0 {
                    found.push(Swap { frame, view, chain });
                }
            }
        }
    }
    found
}

/// Σ c k of the pair's detections with sides swapped, less that with sides as they are.
fn gain(
    tracks: &Tracks,
    points: &[Vector3<f64>],
    common: &Common,
    view: usize,
    t: usize,
    [l, r]: [usize; 2],
) -> f64 {
    let at = |j: usize| j * tracks.frames + t;
    if !(tracks.active[at(l)] && tracks.active[at(r)]) {
        return 0.0;
    }
    let agrees = |ray_of: usize, x_of: usize| {
        let ray = &tracks.rays(ray_of, t)[view];
        let k = if ray.is_there() {
            ray.offset(&points[at(x_of)]).weight(common.sigma[x_of])
        } else {
            0.0
        };
        ray.weight * k
    };
    agrees(l, r) + agrees(r, l) - agrees(l, l) - agrees(r, r)
}

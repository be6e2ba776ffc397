//! Left and right swapped in a view of a recording: the path decides, and a swap lasts.
//!
//! The frames alone have corrected what three views show. Along the path that all frames agree on,
//! two views suffice, and since a swap lasts for some frames, a frame's neighbours vote as well.
//!
//! Where as many views are swapped as are not, the frames alone may have exchanged the sides in the
//! wrong half. Then the chain jumps and comes back: its sides are those with which it goes on.

use super::solver::Common;
use super::times::{AROUND, SHORT, around, frames_in};
use super::tracks::Tracks;
use crate::annealed::frame::SWAP_EVIDENCE;
use crate::annealed::swaps::{Chain, GAIN};
use nalgebra::Vector3;

/// A chain of joints swapped in a view of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct FrameSwap {
    pub(super) frame: usize,
    pub(super) view: usize,
    pub(super) chain: usize,
}

/// The swaps in all views of the frames that have exchanged the sides of a chain wrongly.
pub(super) fn exchanged(tracks: &Tracks, chains: &[Chain], common: &Common) -> Vec<FrameSwap> {
    let mut found = Vec::new();
    for (chain, pairs) in chains.iter().enumerate() {
        let sides = sides(tracks, pairs, common);
        for frame in (0..tracks.frames).filter(|t| sides[*t]) {
            found.extend((0..tracks.views).map(|view| FrameSwap { frame, view, chain }));
        }
    }
    found
}

/// Whether the sides of a chain are exchanged in each frame: the cheapest sequence, by dynamic
/// programming.
fn sides(tracks: &Tracks, pairs: &Chain, common: &Common) -> Vec<bool> {
    let places = |t: usize| {
        let unsure = Vector3::repeat(f64::NAN);
        let at = move |j: usize| {
            let k = j * tracks.frames + t;
            if tracks.sure[k] { tracks.alone[k] } else { unsure }
        };
        pairs.iter().map(move |[l, r]| [at(*l), at(*r)])
    };
    let is_known = |p: [Vector3<f64>; 2]| p.iter().all(|x| x.x.is_finite());
    let known: Vec<usize> = (0..tracks.frames).filter(|t| places(*t).any(is_known)).collect();
    let (mut costs, mut from) = ([0.0; 2], Vec::with_capacity(known.len()));
    for (k, t) in known.iter().enumerate() {
        let before = k.checked_sub(1).map(|k| known[k]);
        let near =
            before.filter(|b| t - b <= frames_in(AROUND, common.fps) && !tracks.is_cut(*b, *t));
        let crossed = near.and_then(|b| crossing(places(b), places(*t))).unwrap_or(0.5);
        let stay = |s: usize| costs[s] + SWAP_EVIDENCE * crossed;
        let turn = |s: usize| costs[1 - s] + SWAP_EVIDENCE * (1.0 - crossed);
        let kept = [0, 1].map(|s| stay(s) <= turn(s));
        let own = against(tracks, pairs, *t).map(|views| SWAP_EVIDENCE / common.fps * views);
        costs = [0, 1].map(|s| if kept[s] { stay(s) } else { turn(s) } + own[s]);
        from.push(kept);
    }
    let mut out = vec![false; tracks.frames];
    let mut side = usize::from(costs[1] < costs[0]);
    for (t, kept) in known.iter().zip(&from).rev() {
        out[*t] = side == 1;
        side = if kept[side] { side } else { 1 - side };
    }
    out
}

/// Number of views that, with sides as they are detected, agree with the other side's position: if
/// the frame is as it is, and if it is exchanged.
fn against(tracks: &Tracks, pairs: &Chain, t: usize) -> [f64; 2] {
    let mut views = [0.0; 2];
    let most = (2 * pairs.len()) as f64;
    for i in 0..tracks.views {
        // Whether the frame alone has exchanged these sides.
        let turned = pairs.iter().any(|[j, _]| tracks.turned[tracks.at(*j, t) * tracks.views + i]);
        for [l, r] in pairs {
            let k = |ray_of: usize, x_of: usize| {
                let x = &tracks.alone[x_of * tracks.frames + t];
                tracks.trust(ray_of * tracks.frames + t, i, x, 1.0)
            };
            let (own, other) = (k(*l, *l) + k(*r, *r), k(*l, *r) + k(*r, *l));
            let against = if turned { [own, other] } else { [other, own] };
            let against = against.map(|k| if k.is_finite() { k / most } else { 0.0 });
            views = [views[0] + against[0], views[1] + against[1]];
        }
    }
    // What exchanges the sides in all views is one cause, and counts as one of them.
    [views[0].min(1.0 + views[1]), views[1].min(1.0 + views[0])]
}

/// How little farther the sides move if they cross, from 0 (much farther) to 1 (they do cross): the
/// mean over the pairs that are known in both frames.
fn crossing(
    before: impl Iterator<Item = [Vector3<f64>; 2]>,
    after: impl Iterator<Item = [Vector3<f64>; 2]>,
) -> Option<f64> {
    let (mut sum, mut n) = (0.0, 0.0);
    for ([l, r], [to_l, to_r]) in before.zip(after) {
        let as_is = (to_l - l).norm_squared() + (to_r - r).norm_squared();
        let crossed = (to_r - l).norm_squared() + (to_l - r).norm_squared();
        let share = as_is / (as_is + crossed);
        if share.is_finite() {
            (sum, n) = (sum + share, n + 1.0);
        }
    }
    (n > 0.0).then(|| sum / n)
}

/// The swaps that the path `points` `(N, T)` shows.
pub(super) fn find(
    tracks: &Tracks,
    chains: &[Chain],
    points: &[Vector3<f64>],
    common: &Common,
) -> Vec<FrameSwap> {
    let reach = frames_in(SHORT, common.fps);
    let mut found = Vec::new();
    for (chain, pairs) in chains.iter().enumerate() {
        for view in 0..tracks.views {
            let gains: Vec<f64> = (0..tracks.frames)
                .map(|t| {
                    pairs.iter().map(|pair| gain(tracks, points, common, view, t, *pair)).sum()
                })
                .collect();
            for (frame, _) in gains.iter().enumerate().filter(|(_, g)| **g >= GAIN) {
                let near = &gains[around(frame, reach, gains.len())];
                if near.iter().sum::<f64>() >= GAIN * near.len() as f64 {
                    found.push(FrameSwap { frame, view, chain });
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
        let confidence = tracks.rays(ray_of, t)[view].weight / common.noise.confidence[view];
        confidence * tracks.trust(at(ray_of), view, &points[at(x_of)], 1.0)
    };
    agrees(l, r) + agrees(r, l) - agrees(l, l) - agrees(r, r)
}

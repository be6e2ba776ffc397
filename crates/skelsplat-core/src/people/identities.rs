//! Who is who over a whole recording: what a look at single frames cannot know.
//!
//! The lengths of bones, medians over many frames, tell people apart who were followed for a while.
//! They say whether somebody who appears is the one who was lost there before, and whether two who
//! met went on as each other.

use std::ops::Range;

use super::associate::{DIFFERENCE, KEEP, PAUSE};
use super::body::apart;
use super::doubles::drop_doubles;
use super::known::BodyModel;
use super::tracks::Track;
use crate::annealed::places::LEAP;
use crate::sequence::live::filter::ANY_SPEED;
use crate::statistics::median;

/// Distance, in kernels, within which two people meet.
const MEET: f64 = 8.0;
/// Standard deviation of a measured bone, relative to its length.
const SPREAD: f64 = 0.03;
/// Evidence for an exchange, in log-likelihood: a chance of one in four hundred.
const EVIDENCE: f64 = 6.0;
/// Frames at either end in which somebody who was absent is looked for.
const ENDS: usize = 10;
/// Most frames from which bones are measured.
const SAMPLES: usize = 60;

/// Removes people who are others, exchanges those who went on as each other, and joins the parts of
/// one.
pub(super) fn settle(tracks: &mut Vec<Track>, known: &BodyModel, fps: f64) {
    drop_doubles(tracks, known, fps);
    for a in 0..tracks.len() {
        for b in a + 1..tracks.len() {
            for at in exchanges([&tracks[a], &tracks[b]], known, fps) {
                let (head, tail) = tracks.split_at_mut(b);
                exchange(&mut head[a], &mut tail[0], at);
            }
        }
    }
    join(tracks, known, fps);
}

/// The frames that both have.
fn both(a: &Track, b: &Track) -> Range<usize> {
    let first = a.first.max(b.first);
    first..a.end().min(b.end()).max(first)
}

/// The frames from which on two people went on as each other.
fn exchanges([a, b]: [&Track; 2], known: &BodyModel, fps: f64) -> Vec<usize> {
    let frames = |seconds: f64| (seconds * fps).round() as usize;
    let (around, least) = (frames(KEEP), frames(PAUSE).max(3));
    let meetings = meetings(a, b, MEET * known.sigma, frames(PAUSE));
    let mut found = Vec::new();
    let mut crossed = false;
    for (k, (meeting, closest)) in meetings.iter().enumerate() {
        let from = if k == 0 { both(a, b).start } else { meetings[k - 1].0.end };
        let to = meetings.get(k + 1).map_or(both(a, b).end, |next| next.0.start);
        let before = from.max(meeting.start.saturating_sub(around))..meeting.start;
        let after = meeting.end..to.min(meeting.end + around);
        if before.len() < least || after.len() < least {
            continue;
        }
        let bones = |track: &Track, frames: &Range<usize>| lengths(track, frames, known);
        let [mut a0, mut b0] = [bones(a, &before), bones(b, &before)];
        let [a1, b1] = [bones(a, &after), bones(b, &after)];
        // What came before may have been exchanged already.
        if crossed {
            std::mem::swap(&mut a0, &mut b0);
        }
        let of_a = misfit(&a0, &a1) - misfit(&a0, &b1);
        let of_b = misfit(&b0, &b1) - misfit(&b0, &a1);
        // The bones of both must say the same: one person measured wrongly is no evidence.
        let sure = of_a * of_b > 0.0 && of_a.abs().min(of_b.abs()) > 0.25 * EVIDENCE;
        if sure && (of_a + of_b).abs() > EVIDENCE && (of_a > 0.0) != crossed {
            found.push(*closest);
            crossed = !crossed;
        }
    }
    found
}

/// Frames in which two people are close to each other, and the one in which they are closest.
fn meetings(a: &Track, b: &Track, near: f64, pause: usize) -> Vec<(Range<usize>, usize)> {
    let mut out: Vec<(Range<usize>, usize, f64)> = Vec::new();
    for t in both(a, b) {
        let far = a.pose(t).zip(b.pose(t)).map_or(f64::INFINITY, |(x, y)| apart(x, y));
        if far >= near {
            continue;
        }
        match out.last_mut() {
            Some((meeting, closest, least)) if t <= meeting.end + pause => {
                meeting.end = t + 1;
                if far < *least {
                    (*closest, *least) = (t, far);
                }
            }
            _ => out.push((t..t + 1, t, far)),
        }
    }
    out.into_iter().map(|(meeting, closest, _)| (meeting, closest)).collect()
}

/// Exchanges what two people have from frame `t` on.
fn exchange(a: &mut Track, b: &mut Track, t: usize) {
    let tail = a.frames.split_off(t - a.first);
    a.frames.extend(b.frames.drain(t - b.first..));
    b.frames.extend(tail);
}

/// Median length of each limb in some of the frames, mm; NaN where unknown.
fn lengths(track: &Track, frames: &Range<usize>, known: &BodyModel) -> Vec<f64> {
    let step = frames.len().div_ceil(SAMPLES).max(1);
    let poses: Vec<_> = frames.clone().step_by(step).filter_map(|t| track.pose(t)).collect();
    let length = |[i, j]: &[usize; 2]| {
        let all = poses.iter().map(|pose| (pose[*i] - pose[*j]).norm());
        let all: Vec<f64> = all.filter(|l| l.is_finite() && *l > 0.0).collect();
        if all.len() < 3 { f64::NAN } else { median(all) }
    };
    known.limbs.iter().map(length).collect()
}

/// Minus the log-likelihood that these are the bones of one person.
fn misfit(a: &[f64], b: &[f64]) -> f64 {
    let ratios = a.iter().zip(b).map(|(x, y)| (x / y).ln()).filter(|r| r.is_finite());
    // A bone that is measured wrongly says no more than this.
    ratios.map(|r| (r / (2.0 * SPREAD)).powi(2).min(2.0)).sum()
}

/// Joins tracks that begin to those that ended nearby, the pairs most like one person first.
fn join(tracks: &mut Vec<Track>, known: &BodyModel, fps: f64) {
    let bones = |track: &Track| lengths(track, &(track.first..track.end()), known);
    let mut all: Vec<Option<(Track, Vec<f64>)>> =
        tracks.drain(..).map(|track| (bones(&track), track)).map(|(b, t)| Some((t, b))).collect();
    let cost = |all: &[Option<(Track, Vec<f64>)>], a: usize, b: usize| {
        let (lost, new) = (all[a].as_ref()?, all[b].as_ref()?);
        (a != b).then(|| parted(lost, new, known, fps)).flatten().map(|cost| (cost, a, b))
    };
    let pairs = (0..all.len()).flat_map(|a| (0..all.len()).map(move |b| (a, b)));
    let mut found: Vec<(f64, usize, usize)> = pairs.filter_map(|(a, b)| cost(&all, a, b)).collect();
    let order = |x: &&(f64, usize, usize), y: &&(f64, usize, usize)| {
        x.0.total_cmp(&y.0).then((x.1, x.2).cmp(&(y.1, y.2)))
    };
    while let Some(&(_, a, b)) = found.iter().min_by(order) {
        if let (Some((new, _)), Some((track, own))) = (all[b].take(), all[a].as_mut()) {
            track.append(new);
            *own = bones(track);
        }
        found.retain(|(_, c, d)| ![*c, *d].iter().any(|k| *k == a || *k == b));
        let others = (0..all.len()).flat_map(|k| [(a, k), (k, a)]);
        found.extend(others.filter_map(|(c, d)| cost(&all, c, d)));
    }
    tracks.extend(all.into_iter().flatten().map(|(track, _)| track));
}

/// How little two tracks, with the lengths of their bones, look like the parts of one person;
/// `None` if they cannot be.
fn parted(
    (lost, a): &(Track, Vec<f64>),
    (new, b): &(Track, Vec<f64>),
    known: &BodyModel,
    fps: f64,
) -> Option<f64> {
    let gap = (new.first as f64 - lost.end() as f64) / fps;
    let in_time = (-PAUSE..=KEEP).contains(&gap);
    if !in_time || new.first <= lost.first || new.end() <= lost.end() {
        return None;
    }
    let reach = LEAP + ANY_SPEED * gap.max(0.0);
    let ends = lost.frames.iter().rev().take(ENDS);
    let starts = || new.frames.iter().take(ENDS);
    let near =
        |(_, a): &(_, Vec<_>)| starts().map(|(_, b)| apart(a, b)).fold(f64::INFINITY, f64::min);
    let far = ends.map(near).fold(f64::INFINITY, f64::min) / reach;
    let ratios = a.iter().zip(b).map(|(x, y)| (x / y).ln().abs());
    let ratios: Vec<f64> = ratios.filter(|r| r.is_finite()).collect();
    // Whoever was not seen long enough to be measured can only be known by the place.
    if ratios.len() < known.limbs.len().min(3) && gap > PAUSE {
        return None;
    }
    let differs = if ratios.is_empty() { 0.5 * DIFFERENCE } else { median(ratios) } / DIFFERENCE;
    (far < 1.0 && differs < 1.0).then_some(far + differs)
}

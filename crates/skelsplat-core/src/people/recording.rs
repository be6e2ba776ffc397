//! A recording of several people: one pass to find them, each solved in time, and a second look at who has which figure.

use std::collections::BTreeMap;
use std::ops::Range;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::associate::{Associator, Known, absorb};
use super::births::{FITS, Free};
use super::body::{Claims, apart};
use super::crowd::Crowd;
use super::score::{assign, at_body};
use crate::batch::Progress;
use crate::detections::Detections;
use crate::error::{Error, Result};
use crate::layout::Layout;
use crate::refine::{Frame, Refiner};
use crate::sequence::{Sequence, refine_sequence};
use crate::threads;

/// Frames whose rays are in memory together.
const CHUNK: usize = 256;
/// Time for which two views must see a person, s, and the most frames.
const LEAST_TIME: f64 = 0.2;
const MOST_FRAMES: usize = 12;
/// Share of their common frames in which two people are in one place, if they are one.
const DOUBLE: f64 = 0.5;
/// Distance within which, in kernels.
const SAME: f64 = 1.5;

/// A person of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Person {
    /// Counted from 0 in the order of appearance.
    pub id: usize,
    /// From the first to the last frame in which two views see the person.
    pub frames: Range<usize>,
    /// Slot of the person's figure `(F, M)`; `None` in a view that does not see them.
    pub slots: Vec<Option<usize>>,
    /// Slot of another figure that has more of the person's joints `(F, M)`.
    pub more: Vec<Option<usize>>,
    /// The person's frames, solved in time.
    pub sequence: Sequence,
}

/// Finds and refines everybody whom at least two views see.
///
/// `people` has the slots of every frame, `P` times one figure per view `(M, N)`; empty slots have no detections, and slots are not
/// identities. At most `max_people` are returned, those whom the views see most.
///
/// # Errors
/// As [`refine_sequence`], and [`Error::InvalidInput`] if slots do not match.
pub fn track(
    refiner: &Refiner,
    layout: &Layout,
    people: &[Vec<Detections>],
    fps: f64,
    max_people: Option<usize>,
    progress: &Progress,
) -> Result<Vec<Person>> {
    if max_people == Some(0) {
        return Err(Error::invalid("max_people", "at least 1, or None for any number", "0"));
    }
    crate::sequence::check(refiner, fps, "'annealed' for several people")?;
    threads::install(refiner.config().n_threads, |_| {
        let known = Known::new(refiner, layout);
        let recording = Recording { refiner, layout, people, fps, known, progress };
        recording.solve(max_people)
    })
}

struct Recording<'a> {
    refiner: &'a Refiner,
    layout: &'a Layout,
    people: &'a [Vec<Detections>],
    fps: f64,
    known: Known,
    progress: &'a Progress,
}

/// A person's figures in every frame of a range.
#[derive(Debug, Clone, PartialEq)]
struct Track {
    first: usize,
    claims: Vec<Claims>,
}

impl Track {
    fn end(&self) -> usize {
        self.first + self.claims.len()
    }

    /// Number of figures.
    fn figures(&self) -> usize {
        self.claims.iter().flatten().filter(|claim| claim[0].is_some()).count()
    }
}

fn views(claims: &Claims) -> usize {
    claims.iter().filter(|claim| claim[0].is_some()).count()
}

impl Recording<'_> {
    fn solve(&self, max_people: Option<usize>) -> Result<Vec<Person>> {
        let mut tracks = self.tracks()?;
        let mut solved = self.solved(&tracks)?;
        self.drop_doubles(&mut tracks, &mut solved);
        let again = self.assigned_again(&tracks, &solved)?;
        let changed: Vec<usize> = (0..tracks.len()).filter(|q| tracks[*q] != again[*q]).collect();
        let kept: Vec<Option<Track>> = again.iter().map(|track| self.trimmed(track)).collect();
        let renewed: Result<Vec<Option<Sequence>>> = changed
            .par_iter()
            .map(|q| kept[*q].as_ref().map(|track| self.sequence(track)).transpose())
            .collect();
        for (q, sequence) in changed.into_iter().zip(renewed?) {
            if let Some(sequence) = sequence {
                solved[q] = sequence;
            }
        }
        let mut found: Vec<(Track, Sequence)> =
            kept.into_iter().zip(solved).filter_map(|(t, s)| Some((t?, s))).collect();
        if let Some(most) = max_people {
            found.sort_by_key(|(track, _)| std::cmp::Reverse(track.figures()));
            found.truncate(most);
        }
        found.sort_by_key(|(track, _)| track.first);
        Ok(found.into_iter().enumerate().map(|(id, (t, s))| person(id, &t, s)).collect())
    }

    /// The rays of frames.
    fn crowds(&self, frames: Range<usize>) -> Result<Vec<Crowd>> {
        self.progress.check()?;
        self.people[frames].par_iter().map(|slots| Crowd::new(self.refiner, slots)).collect()
    }

    fn chunks(&self) -> impl Iterator<Item = Range<usize>> {
        let n = self.people.len();
        (0..n).step_by(CHUNK).map(move |first| first..(first + CHUNK).min(n))
    }

    /// Everybody who is seen by two views for long enough, followed from frame to frame.
    fn tracks(&self) -> Result<Vec<Track>> {
        let mut associator = Associator::new(self.refiner, self.layout, self.fps);
        let mut seen: BTreeMap<usize, Track> = BTreeMap::new();
        for chunk in self.chunks() {
            for (t, crowd) in chunk.clone().zip(self.crowds(chunk)?) {
                for sighting in associator.step(&crowd) {
                    let nobody = vec![[None, None]; crowd.views.len()];
                    let track = seen
                        .entry(sighting.id)
                        .or_insert_with(|| Track { first: t, claims: Vec::new() });
                    track.claims.resize(t - track.first, nobody);
                    track.claims.push(sighting.claims);
                }
                self.progress.advance();
            }
        }
        Ok(seen.values().filter_map(|track| self.trimmed(track)).collect())
    }

    /// From the first to the last frame that two views see; `None` if those are too few.
    fn trimmed(&self, track: &Track) -> Option<Track> {
        let two = |claims: &Claims| views(claims) >= 2;
        let n = track.claims.iter().filter(|claims| two(claims)).count();
        let least = (LEAST_TIME * self.fps).round().clamp(1.0, MOST_FRAMES as f64) as usize;
        if n < least.min(self.people.len()) {
            return None;
        }
        let first = track.claims.iter().position(two)?;
        let last = track.claims.iter().rposition(two)?;
        Some(Track { first: track.first + first, claims: track.claims[first..=last].to_vec() })
    }

    fn solved(&self, tracks: &[Track]) -> Result<Vec<Sequence>> {
        tracks.par_iter().map(|track| self.sequence(track)).collect()
    }

    fn sequence(&self, track: &Track) -> Result<Sequence> {
        let frame = |(k, claims): (usize, &Claims)| -> Frame {
            let slots = &self.people[track.first + k];
            let from = |i: usize, j: usize| {
                claims[i].iter().flatten().find_map(|slot| slots[*slot].get(i, j))
            };
            Detections::gathered(claims.len(), self.layout.n_joints(), from).into()
        };
        let frames: Vec<Frame> = track.claims.iter().enumerate().map(frame).collect();
        refine_sequence(self.refiner, &frames, self.fps, self.progress)
    }

    /// Joints of a person in a frame, mm.
    fn pose(&self, track: &Track, sequence: &Sequence, t: usize) -> Option<Vec<Vector3<f64>>> {
        let mm = self.refiner.unit().millimetres();
        let k = t.checked_sub(track.first).filter(|k| *k < track.claims.len())?;
        Some(sequence.frames[k].pose.iter().map(|x| x * mm).collect())
    }

    /// Removes people who are others: of two in one place, the one with fewer figures.
    fn drop_doubles(&self, tracks: &mut Vec<Track>, solved: &mut Vec<Sequence>) {
        let near = SAME * self.known.sigma;
        let is_double = |a: usize, b: usize| {
            let common = tracks[a].first.max(tracks[b].first)..tracks[a].end().min(tracks[b].end());
            let n = common.len();
            let together = common.filter(|t| {
                let pose = |q: usize| self.pose(&tracks[q], &solved[q], *t);
                pose(a).zip(pose(b)).is_some_and(|(x, y)| apart(&x, &y) < near)
            });
            n > 0 && together.count() as f64 > DOUBLE * n as f64
        };
        let mut kept = vec![true; tracks.len()];
        for a in 0..tracks.len() {
            for b in a + 1..tracks.len() {
                if kept[a] && kept[b] && is_double(a, b) {
                    let less = if tracks[a].figures() < tracks[b].figures() { a } else { b };
                    kept[less] = false;
                }
            }
        }
        let mut keep = kept.iter();
        tracks.retain(|_| *keep.next().unwrap_or(&true));
        let mut keep = kept.iter();
        solved.retain(|_| *keep.next().unwrap_or(&true));
    }

    /// Figures assigned once more, to the smooth poses.
    fn assigned_again(&self, tracks: &[Track], solved: &[Sequence]) -> Result<Vec<Track>> {
        let mut out: Vec<Track> = tracks
            .iter()
            .map(|track| Track { first: track.first, claims: Vec::with_capacity(track.claims.len()) })
            .collect();
        for chunk in self.chunks() {
            let crowds = self.crowds(chunk.clone())?;
            let frames: Vec<(usize, Crowd)> = chunk.zip(crowds).collect();
            let one = |(t, crowd): &(usize, Crowd)| {
                let there: Vec<(usize, Vec<Vector3<f64>>)> = (0..tracks.len())
                    .filter_map(|q| Some((q, self.pose(&tracks[q], &solved[q], *t)?)))
                    .collect();
                let claims = self.assigned(crowd, &there);
                there.into_iter().map(|(q, _)| q).zip(claims).collect::<Vec<_>>()
            };
            let assigned: Vec<Vec<(usize, Claims)>> = frames.par_iter().map(one).collect();
            for (q, claims) in assigned.into_iter().flatten() {
                out[q].claims.push(claims);
            }
        }
        Ok(out)
    }

    /// The figures of people at known places.
    fn assigned(&self, crowd: &Crowd, there: &[(usize, Vec<Vector3<f64>>)]) -> Vec<Claims> {
        let Known { sigma, mirror, .. } = &self.known;
        let mut claims = vec![vec![[None, None]; crowd.views.len()]; there.len()];
        let mut free: Free =
            crowd.views.iter().map(|view| view.iter().map(|f| f.joints > 0).collect()).collect();
        for (i, figures) in crowd.views.iter().enumerate() {
            let score = |pose: &[Vector3<f64>]| -> Vec<f64> {
                figures.iter().map(|figure| at_body(figure, pose, *sigma, mirror)).collect()
            };
            let scores: Vec<Vec<f64>> = there.iter().map(|(_, pose)| score(pose)).collect();
            for (k, slot) in assign(&scores, FITS).into_iter().enumerate() {
                if let Some(slot) = slot {
                    claims[k][i][0] = Some(slot);
                    free[i][slot] = false;
                }
            }
        }
        for ((_, pose), claims) in there.iter().zip(&mut claims) {
            absorb(crowd, pose, claims, &mut free, &self.known);
        }
        claims
    }
}

fn person(id: usize, track: &Track, sequence: Sequence) -> Person {
    let slots = |part: usize| track.claims.iter().flatten().map(|claim| claim[part]).collect();
    Person { id, frames: track.first..track.end(), slots: slots(0), more: slots(1), sequence }
}

//! A recording of several people: one pass to find them, a second look at who has which figure, and
//! each solved over time.

use std::collections::BTreeMap;
use std::ops::Range;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::agreement::Agreement;
use super::associate::{Associator, absorb, give_free};
use super::births::FITS;
use super::body::{Claims, claimed};
use super::crowd::{Crowd, Figure};
use super::identities;
use super::known::BodyModel;
use super::tracks::Track;
use crate::batch::Progress;
use crate::detections::Detections;
use crate::error::{Error, Result};
use crate::layout::Layout;
use crate::refine::{Frame, Refiner};
use crate::sequence::times::{INDEPENDENT, SHORT};
use crate::sequence::{Sequence, refine_sequence};
use crate::threads;

/// Frames whose rays are in memory together.
const CHUNK: usize = 256;
/// Most frames in which two views must see a person: those in which errors become independent.
const MOST_FRAMES: usize = 12;
/// Frames from which the size of bodies is measured.
const MEASURED: usize = 32;

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
    /// The person's frames, solved over time.
    pub sequence: Sequence,
}

/// Everybody in a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Everybody {
    /// In the order of their appearance.
    pub people: Vec<Person>,
    /// In how many frames there were too many people for all of them to be compared, or followed.
    pub cut: usize,
    /// Which views agree.
    pub agreement: Agreement,
}

/// A person's figures over a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct Identity {
    /// From the first to the last frame in which two views see the person.
    pub frames: Range<usize>,
    /// Slot of the person's figure `(F, M)`; `None` in a view that does not see them.
    pub slots: Vec<Option<usize>>,
}

/// Who is who in a recording.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Identities {
    /// In the order of their appearance.
    pub people: Vec<Identity>,
    /// Whether there were too many people in a frame for all of them to be compared, or followed
    /// `(T)`.
    pub cut: Vec<bool>,
}

/// Finds everybody whom at least two views see, however briefly, and whatever the unit of the
/// cameras: bodies are compared in a world in which they are as large as people.
///
/// # Errors
/// As [`track`].
pub fn identify(
    refiner: &Refiner,
    layout: &Layout,
    people: &[Vec<Detections>],
    fps: f64,
    progress: &Progress,
) -> Result<Identities> {
    crate::sequence::check(refiner, fps, "'annealed' for several people")?;
    threads::install(refiner.config().n_threads, |_| {
        let known = BodyModel::new(refiner, layout);
        let mut recording = CrowdRecording { refiner, layout, people, fps, known, progress };
        recording.measure()?;
        let (tracks, cut, _) = recording.who_is_who(1)?;
        let people = tracks
            .iter()
            .map(|track| Identity { frames: track.first..track.end(), slots: track.slots(0) });
        Ok(Identities { people: people.collect(), cut })
    })
}

/// Finds and refines everybody whom at least two views see.
///
/// `people` has the slots of every frame, `P` times one figure per view `(M, N)`; empty slots have
/// no detections, and slots are not identities. At most `max_people` are returned, those whom the
/// views see most.
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
) -> Result<Everybody> {
    if max_people == Some(0) {
        return Err(Error::invalid("max_people", "at least 1, or None for any number", "0"));
    }
    crate::sequence::check(refiner, fps, "'annealed' for several people")?;
    threads::install(refiner.config().n_threads, |_| {
        let known = BodyModel::new(refiner, layout);
        let mut recording = CrowdRecording { refiner, layout, people, fps, known, progress };
        if !layout.human {
            recording.measure()?;
        }
        recording.solve(max_people)
    })
}

struct CrowdRecording<'a> {
    refiner: &'a Refiner,
    layout: &'a Layout,
    people: &'a [Vec<Detections>],
    fps: f64,
    known: BodyModel,
    progress: &'a Progress,
}

impl CrowdRecording<'_> {
    fn solve(&self, max_people: Option<usize>) -> Result<Everybody> {
        let (mut tracks, cut, agreement) = self.who_is_who(self.least())?;
        if let Some(most) = max_people {
            tracks.sort_by_key(|track| std::cmp::Reverse(track.figures()));
            tracks.truncate(most);
            tracks.sort_by_key(|track| track.first);
        }
        self.progress.expect(tracks.iter().map(|track| track.frames.len()).sum());
        let solved = tracks.par_iter().map(|track| self.sequence(track));
        let solved: Vec<Sequence> = solved.collect::<Result<_>>()?;
        // Two views that saw figures without a joint in common have seen nobody.
        let is_seen = |sequence: &Sequence| sequence.frames.pose.iter().any(|x| x.is_finite());
        let found = tracks.iter().zip(solved).filter(|(_, sequence)| is_seen(sequence));
        let person = |(id, (track, sequence)): (usize, (&Track, Sequence))| {
            let (slots, more) = (track.slots(0), track.slots(1));
            Person { id, frames: track.first..track.end(), slots, more, sequence }
        };
        let people = (0..).zip(found).map(person);
        let cut = cut.into_iter().filter(|cut| *cut).count();
        Ok(Everybody { people: people.collect(), cut, agreement })
    }

    /// Everybody whom two views see in `least` frames, in the order of their appearance; and
    /// [`Identities::cut`].
    fn who_is_who(&self, least: usize) -> Result<(Vec<Track>, Vec<bool>, Agreement)> {
        let (mut tracks, cut) = self.tracks(least.min(2))?;
        identities::settle(&mut tracks, &self.known, self.fps);
        let (mut tracks, agreement) = self.assigned_again(&tracks, least)?;
        tracks.sort_by_key(|track| track.first);
        Ok((tracks, cut, agreement))
    }

    /// Scales the world until bodies are as large as people.
    fn measure(&mut self) -> Result<()> {
        let step = self.people.len().div_ceil(MEASURED).max(1);
        let some = self.people.par_iter().step_by(step);
        let some = some.map(|slots| Crowd::new(self.refiner, slots)).collect::<Result<Vec<_>>>()?;
        let scale = self.known.scale_of(&some);
        self.known = self.known.clone().scaled(scale);
        Ok(())
    }

    /// The rays of frames.
    fn crowds(&self, frames: Range<usize>) -> Result<Vec<Crowd>> {
        self.progress.check()?;
        let crowd = |slots: &Vec<Detections>| Crowd::new(self.refiner, slots);
        let scaled = |slots| Ok(crowd(slots)?.scaled(self.known.scale));
        self.people[frames].par_iter().map(scaled).collect()
    }

    fn chunks(&self) -> impl Iterator<Item = Range<usize>> {
        let n = self.people.len();
        (0..n).step_by(CHUNK).map(move |first| first..(first + CHUNK).min(n))
    }

    /// Everybody who is seen by two views for long enough, followed from frame to frame; and
    /// [`Identities::cut`].
    fn tracks(&self, least: usize) -> Result<(Vec<Track>, Vec<bool>)> {
        let mut associator = Associator::new(self.known.clone(), self.fps);
        let mut cut = Vec::with_capacity(self.people.len());
        let mut seen: BTreeMap<usize, Track> = BTreeMap::new();
        for chunk in self.chunks() {
            for (t, crowd) in chunk.clone().zip(self.crowds(chunk)?) {
                let before = associator.cut();
                for sighting in associator.step(&crowd) {
                    let track = seen.entry(sighting.id).or_insert_with(|| Track::new(t));
                    track.push(t, sighting.claims, sighting.pose);
                }
                cut.push(associator.cut() > before);
                self.progress.advance();
            }
        }
        let reach = (SHORT * self.fps).round() as usize;
        let smooth = |track: Track| Some(track.trimmed(least)?.smooth(reach));
        Ok((seen.into_values().filter_map(smooth).collect(), cut))
    }

    /// Least number of frames in which two views must see a person.
    fn least(&self) -> usize {
        let least = (INDEPENDENT * self.fps).round().clamp(1.0, MOST_FRAMES as f64) as usize;
        least.min(self.people.len())
    }

    fn sequence(&self, track: &Track) -> Result<Sequence> {
        let frame = |(k, (claims, _)): (usize, &(Claims, _))| -> Frame {
            let slots = &self.people[track.first + k];
            claimed(slots, claims, self.layout.n_joints()).into()
        };
        let frames: Vec<Frame> = track.frames.iter().enumerate().map(frame).collect();
        refine_sequence(self.refiner, &frames, self.fps, self.progress)
    }

    /// Figures assigned once more, to the smooth poses.
    fn assigned_again(&self, tracks: &[Track], least: usize) -> Result<(Vec<Track>, Agreement)> {
        let mut agreement = Agreement::default();
        let mut out = tracks.to_vec();
        for chunk in self.chunks() {
            let crowds = self.crowds(chunk.clone())?;
            let frames: Vec<(usize, Crowd)> = chunk.zip(crowds).collect();
            let assign_frame = |(t, crowd): &(usize, Crowd)| {
                let (there, poses): (Vec<usize>, Vec<&[Vector3<f64>]>) =
                    (0..tracks.len()).filter_map(|q| Some((q, tracks[q].pose(*t)?))).unzip();
                let (claims, agreement) = self.assigned(crowd, &poses);
                (there.into_iter().zip(claims).collect(), agreement)
            };
            let assigned: Vec<(Vec<(usize, Claims)>, Agreement)> =
                frames.par_iter().map(assign_frame).collect();
            for ((t, _), (people, of_frame)) in frames.iter().zip(assigned) {
                agreement.add(&of_frame);
                for (q, claims) in people {
                    out[q].frames[t - tracks[q].first].0 = claims;
                }
            }
        }
        Ok((out.into_iter().filter_map(|track| track.trimmed(least)).collect(), agreement))
    }

    /// The figures of people at known places, and which views agree on them.
    fn assigned(&self, crowd: &Crowd, there: &[&[Vector3<f64>]]) -> (Vec<Claims>, Agreement) {
        let mut claims = vec![vec![[None, None]; crowd.views.len()]; there.len()];
        let mut free = crowd.free();
        let score = |k: usize, figure: &Figure| self.known.fit(figure, there[k]);
        give_free(crowd, &mut claims, &mut free, FITS, score);
        for (pose, claims) in there.iter().zip(&mut claims) {
            absorb(crowd, pose, claims, &mut free, &self.known);
        }
        let people: Vec<_> = there.iter().copied().zip(&claims).collect();
        let agreement = Agreement::of_frame(crowd, &people, &free, &self.known);
        (claims, agreement)
    }
}

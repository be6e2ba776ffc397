//! Several people live: each known person has a causal refiner of their own.

use super::associate::{Associator, Sighting};
use super::body::{Claims, claimed};
use super::crowd::Crowd;
use super::known::BodyModel;
use crate::batch::Progress;
use crate::detections::Detections;
use crate::error::{Error, Result};
use crate::layout::Layout;
use crate::outcome::JointStatus;
use crate::refine::{Refinement, Refiner};
use crate::sequence::Live;

/// A person in one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackedPerson {
    /// Identity, counted from 0 in the order in which people became known.
    pub id: usize,
    /// By view, the slot of the person's figure and of another part of it.
    pub claims: Claims,
    /// The frame.
    pub refinement: Refinement,
}

/// Follows people frame by frame as they arrive.
#[derive(Debug, Clone)]
pub struct Tracker {
    associator: Associator,
    n_joints: usize,
    fps: f64,
    max_people: usize,
    /// Everybody who is followed.
    followed: Vec<Followed>,
    next: usize,
}

#[derive(Debug, Clone)]
struct Followed {
    /// That of the associator.
    body: usize,
    /// That of the answers, once known.
    id: Option<usize>,
    live: Live,
}

impl Tracker {
    /// Nobody is known yet, of frames at this rate.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if `fps` is not a positive number, for another method than
    /// `annealed`, or if nobody may be followed.
    pub fn new(
        refiner: &Refiner,
        layout: &Layout,
        fps: f64,
        max_people: Option<usize>,
    ) -> Result<Self> {
        if max_people == Some(0) {
            return Err(Error::invalid("max_people", "at least 1, or None for any number", "0"));
        }
        // Checks the rate and the method.
        Live::new(refiner, fps, 0)?;
        Ok(Self {
            associator: Associator::new(BodyModel::new(refiner, layout), fps),
            n_joints: layout.n_joints(),
            fps,
            max_people: max_people.unwrap_or(usize::MAX),
            followed: Vec::new(),
            next: 0,
        })
    }

    /// Forgets everybody; identities are not used again.
    pub fn reset(&mut self) {
        self.associator.reset();
        self.followed.clear();
    }

    /// Identities of everybody who is known and followed, also of those out of sight: an identity
    /// that has left these does not return.
    pub fn ids(&self) -> Vec<usize> {
        let mut ids: Vec<usize> = self.followed.iter().filter_map(|person| person.id).collect();
        ids.sort_unstable();
        ids
    }

    /// In how many frames so far there were too many people for all of them to be compared, or
    /// followed.
    pub fn cut(&self) -> usize {
        self.associator.cut()
    }

    /// Everybody who is known and followed in the next frame, in the order of their identities;
    /// also those who are bridged while no view sees them.
    ///
    /// # Errors
    /// As [`Refiner::refine`], and [`Error::InvalidInput`] if slots do not match.
    pub fn step(
        &mut self,
        refiner: &Refiner,
        slots: &[Detections],
        progress: &Progress,
    ) -> Result<Vec<TrackedPerson>> {
        progress.check()?;
        let crowd = Crowd::new(refiner, slots)?;
        let sightings = self.associator.step(&crowd);
        self.followed.retain(|person| self.associator.follows(person.body));
        for sighting in &sightings {
            self.follow(refiner, sighting)?;
        }
        let n_views = crowd.views.len();
        let nobody: Claims = vec![[None, None]; n_views];
        let mut seen = Vec::new();
        for person in &mut self.followed {
            let claims =
                sightings.iter().find(|s| s.id == person.body).map_or(&nobody, |s| &s.claims);
            let detections = claimed(slots, claims, self.n_joints);
            let refinement = person.live.step(refiner, detections, progress)?;
            // Beyond what is bridged there is nobody to tell of, though the identity is kept.
            let there = refinement.joint_status.iter().any(|s| *s != JointStatus::Unobserved);
            if let Some(id) = person.id.filter(|_| there) {
                seen.push(TrackedPerson { id, claims: claims.clone(), refinement });
            }
        }
        seen.sort_by_key(|person| person.id);
        Ok(seen)
    }

    /// Follows whoever is seen for the first time, and numbers whoever is known now.
    fn follow(&mut self, refiner: &Refiner, sighting: &Sighting) -> Result<()> {
        if !self.followed.iter().any(|person| person.body == sighting.id) {
            let live = Live::new(refiner, self.fps, 0)?;
            self.followed.push(Followed { body: sighting.id, id: None, live });
        }
        let known = self.followed.iter().filter(|person| person.id.is_some()).count();
        let person = self
            .followed
            .iter_mut()
            .find(|person| person.body == sighting.id && person.id.is_none());
        if let Some(person) = person.filter(|_| sighting.known && known < self.max_people) {
            person.id = Some(self.next);
            self.next += 1;
        }
        Ok(())
    }
}

//! One frame after the other: known bodies claim figures (`claims`), what is left gives newcomers
//! (`arrivals`).

mod arrivals;
mod claims;

use nalgebra::Vector3;

pub(super) use claims::{absorb, give_free};

use super::body::{Body, Claims};
use super::crowd::Crowd;
use super::known::BodyModel;
use crate::sequence::times::{BRIDGE, SHORT};

/// Time for which it then keeps its identity, and from which bones are measured before and after a
/// meeting, s.
pub(super) const KEEP: f64 = 5.0;
/// Time for which a body that no view sees claims figures, s; also between two meetings that are
/// one, the shortest from which bones are measured, and for which two can be there while one takes
/// over from the other.
pub(super) const PAUSE: f64 = 0.5;
/// Time for which one view alone keeps a body, s.
const ALONE: f64 = 3.0;
/// Largest median difference between the bones of one person, relative to their length.
pub(super) const DIFFERENCE: f64 = 0.12;
/// Number of bodies that are followed, and of those that are lost and remembered.
const MOST_BODIES: usize = 512;

/// Who is where in one frame.
#[derive(Debug, Clone)]
pub struct Sighting {
    /// Identity.
    pub id: usize,
    /// Its figures.
    pub claims: Claims,
    /// Joints `(N)`, mm; NaN where unknown.
    pub pose: Vec<Vector3<f64>>,
    /// Whether it has been seen long enough to be a person.
    pub known: bool,
}

/// Bodies that are followed from frame to frame.
#[derive(Debug, Clone)]
pub struct Associator {
    pub(super) known: BodyModel,
    pub(super) dt: f64,
    pub(super) bodies: Vec<Body>,
    /// Bodies that are lost, with their identities.
    lost: Vec<Body>,
    /// Pairs of bodies that may be one, and the log-odds that they are.
    pub(super) doubles: Vec<([usize; 2], f64)>,
    next: usize,
    /// Frames with too many people for all to be compared, or followed.
    cut: usize,
}

impl Associator {
    /// Nobody is known yet, of frames at this rate.
    pub fn new(known: BodyModel, fps: f64) -> Self {
        Self {
            known,
            dt: 1.0 / fps,
            bodies: Vec::new(),
            lost: Vec::new(),
            doubles: Vec::new(),
            next: 0,
            cut: 0,
        }
    }

    /// Forgets everybody; identities are not used again.
    pub fn reset(&mut self) {
        self.bodies.clear();
        self.lost.clear();
        self.doubles.clear();
    }

    /// Whether a body is still followed, seen or not; one that was lost keeps its identity for a
    /// while.
    pub fn follows(&self, id: usize) -> bool {
        self.bodies.iter().chain(&self.lost).any(|body| body.id == id)
    }

    /// In how many frames there were too many people for all of them to be compared, or followed.
    pub fn cut(&self) -> usize {
        self.cut
    }

    /// The next frame: everybody whom a view sees, in the order of their appearance.
    pub fn step(&mut self, crowd: &Crowd) -> Vec<Sighting> {
        let mut free = crowd.free();
        self.bodies.iter_mut().for_each(|body| body.predict(self.dt));
        let mut claims = self.claims(crowd, &mut free);
        let mut found = self.place(crowd, &mut claims, &mut free);
        self.claim_again(crowd, &mut claims, &mut free, &mut found);
        self.update(crowd, &mut claims, &mut free, &found);
        for (body, claims) in self.bodies.iter().zip(&mut claims) {
            absorb(crowd, &body.pose, claims, &mut free, &self.known);
        }
        let doubtful = self.released(crowd, &mut claims, &mut free);
        let (mut newcomers, mut cut) = self.known.newcomers(crowd, &mut free);
        self.confirm(doubtful, &mut newcomers, &mut claims, &mut free);
        let room = MOST_BODIES - self.bodies.len();
        cut |= newcomers.len() > room;
        newcomers.truncate(room);
        self.admit(crowd, newcomers, &mut claims);
        self.merge_doubles(&mut claims);
        let sightings = self.sightings(&claims);
        self.retire();
        self.cut += usize::from(cut);
        sightings
    }

    fn sightings(&self, claims: &[Claims]) -> Vec<Sighting> {
        let least = (SHORT / self.dt).round().clamp(1.0, 5.0) as usize;
        let all = self.bodies.iter().zip(claims);
        let seen = all.filter(|(_, claims)| claims.iter().any(|claim| claim[0].is_some()));
        let sighting = |(body, claims): (&Body, &Claims)| Sighting {
            id: body.id,
            claims: claims.clone(),
            pose: body.pose.clone(),
            known: body.seen >= least,
        };
        let mut found: Vec<Sighting> = seen.map(sighting).collect();
        found.sort_by_key(|sighting| sighting.id);
        found
    }

    /// Bodies that no view sees for as long as a joint is bridged are lost, later forgotten.
    fn retire(&mut self) {
        let frames = |seconds: f64| (seconds / self.dt).ceil().max(1.0) as usize;
        let (hold, keep, alone) = (frames(BRIDGE), frames(KEEP), frames(ALONE));
        let is_lost = |body: &Body| body.missed > hold || body.alone > alone;
        let lost = self.bodies.extract_if(.., |body| is_lost(body));
        self.lost.extend(lost);
        // Those that are lost for longest.
        self.lost.drain(..self.lost.len().saturating_sub(MOST_BODIES));
        self.lost.iter_mut().for_each(|body| body.alone += 1);
        self.lost.retain(|body| body.alone <= keep.max(alone) + hold);
    }
}

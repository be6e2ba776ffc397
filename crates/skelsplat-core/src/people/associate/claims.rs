//! Claims: figures of known bodies; also of a person whom one view detects twice, or in parts.

use nalgebra::Vector3;

use super::{Associator, DIFFERENCE, PAUSE};
use crate::people::births::{FITS, Free};
use crate::people::body::{Body, Claims, placed, views};
use crate::people::crowd::{Crowd, Figure};
use crate::people::known::BodyModel;
use crate::people::score::{assign, at_body};

/// Least score of a figure that no other view confirms: of a body that only one view sees, or at a
/// body that has one already. Figures that score less on average fit their body badly.
pub(super) const SHAPE: f64 = 0.5;

/// Unexpected acceleration of a body, mm/s²: about that of gravity.
const ACCELERATION: f64 = 10_000.0;

impl Associator {
    /// Kernel for a body that was last seen by two views so many frames ago, at most twice as wide.
    fn kernel(&self, alone: usize) -> f64 {
        let gap = self.dt * (alone + 1) as f64;
        let drift = 0.5 * ACCELERATION * gap * gap;
        self.known.sigma.hypot(drift).min(2.0 * self.known.sigma)
    }

    /// Figures that bodies claim from where they are expected.
    ///
    /// Those that two views saw in the frame before come first: where a body is that was lost from
    /// sight is not sure.
    pub(super) fn claims(&self, crowd: &Crowd, free: &mut Free) -> Vec<Claims> {
        let mut claims = vec![vec![[None, None]; crowd.views.len()]; self.bodies.len()];
        let recent = (PAUSE / self.dt).ceil() as usize;
        for first in [true, false] {
            let score = |b: usize, figure: &Figure| {
                let body = &self.bodies[b];
                if first != (body.alone == 0) || body.missed > recent {
                    return 0.0;
                }
                at_body(figure, &body.pose, self.kernel(body.alone), &self.known.mirror)
            };
            give_free(crowd, &mut claims, free, FITS, score);
        }
        claims
    }

    /// Joints of the bodies from their figures; figures that do not fit are handed back.
    pub(super) fn place(
        &self,
        crowd: &Crowd,
        claims: &mut [Claims],
        free: &mut Free,
    ) -> Vec<Option<Vec<Vector3<f64>>>> {
        let mut found = Vec::with_capacity(claims.len());
        for (body, claims) in self.bodies.iter().zip(claims) {
            if views(claims) < 2 {
                found.push(None);
                continue;
            }
            let pose = placed(crowd, claims, &body.pose, self.known.sigma);
            // What does not fit where the others are: unless nothing does.
            for (i, claim) in claims.iter_mut().enumerate() {
                let fits = |slot: usize| self.known.fit(&crowd.views[i][slot], &pose) >= FITS;
                if claim[0].is_some_and(|slot| !fits(slot)) {
                    hand_back(claim, &mut free[i]);
                }
            }
            let kept = views(claims);
            // Whoever is found again must have the same bones.
            let again = body.alone == 0
                || body.differs(&Body::new(0, pose.clone(), &self.known.limbs)) < 2.0 * DIFFERENCE;
            if kept >= 2 && !again {
                claims.iter_mut().zip(free.iter_mut()).for_each(|(c, free)| hand_back(c, free));
            }
            found.push((kept >= 2 && again).then_some(pose));
        }
        found
    }

    /// Free figures that fit a body where it is now known to be.
    pub(super) fn claim_again(
        &self,
        crowd: &Crowd,
        claims: &mut [Claims],
        free: &mut Free,
        found: &mut [Option<Vec<Vector3<f64>>>],
    ) {
        let score = |b: usize, figure: &Figure| match &found[b] {
            Some(pose) => self.known.fit(figure, pose),
            None => 0.0,
        };
        let changed = give_free(crowd, claims, free, FITS, score);
        for (b, pose) in found.iter_mut().enumerate().filter(|(b, _)| changed[*b]) {
            if let Some(pose) = pose {
                *pose = placed(crowd, &claims[b], pose, self.known.sigma);
            }
        }
    }

    /// Bodies where their figures show them, or where they are expected.
    pub(super) fn update(
        &mut self,
        crowd: &Crowd,
        claims: &mut [Claims],
        free: &mut Free,
        found: &[Option<Vec<Vector3<f64>>>],
    ) {
        for ((body, claims), found) in self.bodies.iter_mut().zip(claims).zip(found) {
            let only = claims.iter().enumerate().find_map(|(i, claim)| Some((i, claim[0]?)));
            match (found, only) {
                (Some(pose), _) => body.update(pose, self.dt, &self.known.limbs),
                (None, Some((i, slot))) => {
                    // One view cannot be checked by another: the figure must have the body's shape.
                    let figure = &crowd.views[i][slot];
                    let moved = body.follow(figure, self.dt, 2.0 * self.known.sigma);
                    if self.known.fit(figure, &moved) >= SHAPE {
                        body.pose = moved;
                    } else {
                        hand_back(&mut claims[i], &mut free[i]);
                        body.miss(self.dt);
                    }
                }
                (None, None) => body.miss(self.dt),
            }
        }
    }
}

/// Gives free figures to bodies that have none in a view, by the assignment with the largest sum of
/// scores above `least`; which bodies were given any.
pub(in crate::people) fn give_free(
    crowd: &Crowd,
    claims: &mut [Claims],
    free: &mut Free,
    least: f64,
    score: impl Fn(usize, &Figure) -> f64,
) -> Vec<bool> {
    let mut given = vec![false; claims.len()];
    for (i, figures) in crowd.views.iter().enumerate() {
        let row = |b: usize| -> Vec<f64> {
            let fits = |(slot, figure): (usize, &Figure)| match claims[b][i][0] {
                None if free[i][slot] => score(b, figure),
                _ => 0.0,
            };
            figures.iter().enumerate().map(fits).collect()
        };
        let scores: Vec<Vec<f64>> = (0..claims.len()).map(row).collect();
        for (b, slot) in assign(&scores, least).into_iter().enumerate() {
            if let Some(slot) = slot {
                claims[b][i][0] = Some(slot);
                free[i][slot] = false;
                given[b] = true;
            }
        }
    }
    given
}

/// Figures at a body that has one in the same view: another part of the person, or the person
/// detected twice.
pub(in crate::people) fn absorb(
    crowd: &Crowd,
    pose: &[Vector3<f64>],
    claims: &mut Claims,
    free: &mut Free,
    known: &BodyModel,
) {
    for (i, claim) in claims.iter_mut().enumerate() {
        let Some(first) = claim[0] else { continue };
        for (slot, figure) in crowd.views[i].iter().enumerate() {
            if !free[i][slot] || known.fit(figure, pose) < SHAPE {
                continue;
            }
            free[i][slot] = false;
            let rays = figure.rays.iter().zip(&crowd.views[i][first].rays);
            let common = rays.filter(|(a, b)| a.is_there() && b.is_there()).count();
            if claim[1].is_none() && 2 * common <= figure.joints {
                claim[1] = Some(slot);
            }
        }
    }
}

/// Gives the figures of a view back.
pub(super) fn hand_back(claim: &mut [Option<usize>; 2], free: &mut [bool]) {
    claim.iter().flatten().for_each(|slot| free[*slot] = true);
    *claim = [None, None];
}

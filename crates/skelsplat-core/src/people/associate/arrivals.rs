//! Arrivals: newcomers, bodies that are found again, and bodies that turn out to be one.

use super::claims::{SHAPE, hand_back};
use super::{Associator, DIFFERENCE};
use crate::annealed::places::LEAP;
use crate::people::births::{Free, Newcomer};
use crate::people::body::{Body, Claims, apart, views};
use crate::people::crowd::Crowd;
use crate::people::doubles::is_known;
use crate::sequence::live::filter::ANY_SPEED;
use crate::sequence::times::BRIDGE;

/// Support below which two views may have agreed by chance.
const DOUBTFUL: f64 = 1.0;
/// A body is taken for a newcomer that is nearer than this, in kernels, if its own figures fit it
/// badly.
const NEAR: f64 = 3.5;

impl Associator {
    /// Gives back the figures of bodies that only two views see, with little support, where there
    /// are others to choose from: a chance agreement of two views has to stand against every other
    /// pair.
    pub(super) fn released(
        &self,
        crowd: &Crowd,
        claims: &mut [Claims],
        free: &mut Free,
    ) -> Vec<(usize, Claims)> {
        let mut out = Vec::new();
        for (b, (body, claims)) in self.bodies.iter().zip(claims).enumerate() {
            let seen = |i: usize| claims[i][0].is_some();
            let others = (0..claims.len()).any(|i| seen(i) && free[i].iter().any(|f| *f));
            if body.alone > 0 || views(claims) != 2 || !others {
                continue;
            }
            let mut own: Free = crowd.views.iter().map(|view| vec![false; view.len()]).collect();
            for (i, claim) in claims.iter().enumerate() {
                claim.iter().flatten().for_each(|slot| own[i][*slot] = true);
            }
            if self.known.support(crowd, &own, &body.pose) > DOUBTFUL {
                continue;
            }
            out.push((b, claims.clone()));
            claims.iter_mut().zip(free.iter_mut()).for_each(|(c, free)| hand_back(c, free));
        }
        out
    }

    /// Settles bodies whose figures were given back. Each becomes the nearest newcomer that took
    /// one of its figures; without such a newcomer it keeps the figures that nobody took.
    pub(super) fn confirm(
        &mut self,
        doubtful: Vec<(usize, Claims)>,
        newcomers: &mut Vec<Newcomer>,
        claims: &mut [Claims],
        free: &mut Free,
    ) {
        for (b, before) in doubtful {
            let body = &mut self.bodies[b];
            let shares = |newcomer: &Newcomer| {
                newcomer.claims.iter().zip(&before).any(|(a, b)| a[0].is_some() && a[0] == b[0])
            };
            let far = |newcomer: &Newcomer| apart(&body.pose, &newcomer.pose);
            let all = newcomers.iter().enumerate().filter(|(_, newcomer)| shares(newcomer));
            let reach = NEAR * self.known.sigma;
            let near = all.map(|(k, newcomer)| (far(newcomer), k)).filter(|(far, _)| *far < reach);
            let nearest = near.min_by(|a, b| a.0.total_cmp(&b.0));
            match nearest {
                Some((_, k)) => {
                    let newcomer = newcomers.remove(k);
                    let same = newcomer.claims.iter().zip(&before).all(|(a, b)| a[0] == b[0]);
                    if !same {
                        body.appear(newcomer.pose);
                    }
                    claims[b] = if same { before } else { newcomer.claims };
                }
                None => {
                    for (i, claim) in before.into_iter().enumerate() {
                        if claim[0].is_some_and(|slot| free[i][slot]) {
                            claim.iter().flatten().for_each(|slot| free[i][*slot] = false);
                            claims[b][i] = claim;
                        }
                    }
                }
            }
        }
    }

    /// Newcomers: lost bodies that are found again, or new ones; none where a body is already.
    pub(super) fn admit(
        &mut self,
        crowd: &Crowd,
        newcomers: Vec<Newcomer>,
        claims: &mut Vec<Claims>,
    ) {
        for newcomer in newcomers {
            let mut all = self.bodies.iter().zip(claims.iter()).filter(|(body, _)| body.alone == 0);
            let (pose, own) = (&newcomer.pose, &newcomer.claims);
            if all.any(|(body, claims)| is_known(&self.known, body, claims, pose, own)) {
                continue;
            }
            let unseen = self.bodies.iter().enumerate().filter(|(_, body)| body.alone > 0);
            let misplaced = || self.misplaced(crowd, claims, &newcomer);
            if let Some(b) = self.nearest(unseen, &newcomer).or_else(misplaced) {
                self.bodies[b].appear(newcomer.pose);
                claims[b] = newcomer.claims;
                continue;
            }
            let body = match self.nearest(self.lost.iter().enumerate(), &newcomer) {
                Some(at) => {
                    let mut body = self.lost.remove(at);
                    body.appear(newcomer.pose);
                    body
                }
                None => {
                    self.next += 1;
                    Body::new(self.next - 1, newcomer.pose, &self.known.limbs)
                }
            };
            self.bodies.push(body);
            claims.push(newcomer.claims);
        }
    }

    /// The nearest body next to the newcomer whose own figures fit it badly.
    fn misplaced(&self, crowd: &Crowd, claims: &[Claims], newcomer: &Newcomer) -> Option<usize> {
        let fit = |(b, body): (usize, &Body)| {
            let own = claims[b].iter().enumerate().filter_map(|(i, claim)| Some((i, claim[0]?)));
            let scores = own.map(|(i, slot)| self.known.fit(&crowd.views[i][slot], &body.pose));
            let (n, sum) = scores.fold((0, 0.0), |(n, sum), score| (n + 1, sum + score));
            let far = apart(&body.pose, &newcomer.pose);
            (far < NEAR * self.known.sigma
                && n <= views(&newcomer.claims)
                && sum < SHAPE * f64::from(n as u32))
            .then_some((far, b))
        };
        let all = self.bodies.iter().enumerate().filter_map(fit);
        all.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, b)| b)
    }

    /// The nearest of these bodies, which two views do not see now, that can have come here.
    fn nearest<'a>(
        &self,
        bodies: impl Iterator<Item = (usize, &'a Body)>,
        newcomer: &Newcomer,
    ) -> Option<usize> {
        let body = Body::new(0, newcomer.pose.clone(), &self.known.limbs);
        let cost = |(at, lost): (usize, &Body)| {
            let gap = self.dt * (lost.alone + 1) as f64;
            let reach = LEAP + ANY_SPEED * gap;
            let far = apart(&lost.pose, &body.pose) / reach;
            // Bones of a single frame are no measure of them: they only tell apart after a while.
            let differs = lost.differs(&body) / DIFFERENCE;
            let agree = differs < 1.0 || (gap < BRIDGE && differs < 2.0);
            (far < 1.0 && agree).then_some((far + differs, at))
        };
        bodies.filter_map(cost).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, at)| at)
    }
}

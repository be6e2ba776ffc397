//! One frame after the other: known bodies claim figures, what is left gives newcomers.

use nalgebra::Vector3;

use super::births::{FITS, Free, Judge, Newcomer};
use super::body::{Body, Claims, apart, placed, views};
use super::crowd::Crowd;
use super::known::Known;
use super::score::{assign, at_body};
use crate::layout::Layout;
use crate::refine::Refiner;

/// Unexpected acceleration of a body, mm/s², and the largest factor by which it widens the kernel.
const ACCELERATION: f64 = 10_000.0;
const WIDEST: f64 = 2.0;
/// Time for which a body that no view sees claims figures, s.
const RECENT: f64 = 0.3;
/// Least score of the figure of a body that only one view sees.
const SHAPE: f64 = 0.5;
/// Distance, in kernels, from a newcomer, and mean score of its figures, below which a body is taken to be the newcomer.
const BESIDE: f64 = 3.5;
const MISFIT: f64 = 0.55;
/// Support below which two views may have agreed by chance.
const DOUBTFUL: f64 = 1.0;
/// Least score of a claim before the body is placed.
const CLAIM: f64 = 0.25;
/// Score from which a figure at a body that has one already is the same person again.
const AGAIN: f64 = 0.5;
/// Share of its joints that such a figure may have in common with the first, if it is another part of the body.
const PART: f64 = 0.3;
/// A newcomer this close to a body, in kernels, is the same person again.
const SAME: f64 = 1.5;
/// Time for which two bodies in one place are kept apart, s.
const DOUBLE: f64 = 0.2;
/// Time without any view after which a body is lost, and for which it then keeps its identity, s.
const HOLD: f64 = 1.0;
const KEEP: f64 = 5.0;
/// Time for which one view alone keeps a body, s.
const ALONE: f64 = 3.0;
/// How far a lost body can have moved: mm, and mm/s.
const REACH: [f64; 2] = [300.0, 2000.0];
/// Difference between the bones of a lost body and a newcomer, relative to their length.
const DIFFERENCE: f64 = 0.12;
/// Time for which two views must see a body before it is known, s.
const KNOWN: f64 = 0.1;

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
    known: Known,
    dt: f64,
    bodies: Vec<Body>,
    /// Bodies that are lost, with their identities.
    lost: Vec<Body>,
    /// Pairs of bodies in one place, and for how many frames.
    doubles: Vec<([usize; 2], usize)>,
    next: usize,
}

impl Associator {
    /// Nobody is known yet, of frames at this rate.
    #[must_use]
    pub fn new(refiner: &Refiner, layout: &Layout, fps: f64) -> Self {
        Self {
            known: Known::new(refiner, layout),
            dt: 1.0 / fps,
            bodies: Vec::new(),
            lost: Vec::new(),
            doubles: Vec::new(),
            next: 0,
        }
    }

    /// Forgets everybody; identities are not used again.
    pub fn reset(&mut self) {
        self.bodies.clear();
        self.lost.clear();
        self.doubles.clear();
    }

    /// Whether a body is still followed, seen or not; one that was lost keeps its identity for a while.
    #[must_use]
    pub fn follows(&self, id: usize) -> bool {
        self.bodies.iter().chain(&self.lost).any(|body| body.id == id)
    }

    /// The next frame: everybody whom a view sees, in the order of their appearance.
    pub fn step(&mut self, crowd: &Crowd) -> Vec<Sighting> {
        let mut free: Free =
            crowd.views.iter().map(|view| view.iter().map(|f| f.joints > 0).collect()).collect();
        self.bodies.iter_mut().for_each(|body| body.predict(self.dt));
        let mut claims = self.claims(crowd, &mut free);
        let mut found = self.place(crowd, &mut claims, &mut free);
        self.claim_again(crowd, &mut claims, &mut free, &mut found);
        self.update(crowd, &mut claims, &mut free, &found);
        for (body, claims) in self.bodies.iter().zip(&mut claims) {
            absorb(crowd, &body.pose, claims, &mut free, &self.known);
        }
        let judge = Judge { known: &self.known };
        let doubtful = self.released(&judge, crowd, &mut claims, &mut free);
        let mut newcomers = judge.newcomers(crowd, &mut free);
        self.confirm(doubtful, &mut newcomers, &mut claims, &mut free);
        self.admit(crowd, newcomers, &mut claims);
        self.merge_doubles(&mut claims);
        let sightings = self.sightings(&claims);
        self.retire();
        sightings
    }

    /// Kernel for a body that was last seen by two views so many frames ago.
    fn kernel(&self, alone: usize) -> f64 {
        let gap = self.dt * (alone + 1) as f64;
        let drift = 0.5 * ACCELERATION * gap * gap;
        self.known.sigma.hypot(drift).min(WIDEST * self.known.sigma)
    }

    /// Figures that bodies claim from where they are expected.
    ///
    /// Those that two views saw in the frame before come first: where a body is that was lost from sight is not sure.
    fn claims(&self, crowd: &Crowd, free: &mut Free) -> Vec<Claims> {
        let mut claims = vec![vec![[None, None]; crowd.views.len()]; self.bodies.len()];
        let recent = (RECENT / self.dt).ceil() as usize;
        for (i, figures) in crowd.views.iter().enumerate() {
            for first in [true, false] {
                let row = |body: &Body| match first == (body.alone == 0) && body.missed <= recent {
                    true => {
                        let kernel = self.kernel(body.alone);
                        let mut scores = body.scores(figures, kernel, &self.known.mirror);
                        scores.iter_mut().zip(&free[i]).for_each(|(s, free)| {
                            *s = if *free { *s } else { 0.0 };
                        });
                        scores
                    }
                    false => vec![0.0; figures.len()],
                };
                let scores: Vec<Vec<f64>> = self.bodies.iter().map(row).collect();
                for (b, slot) in assign(&scores, CLAIM).into_iter().enumerate() {
                    if let Some(slot) = slot {
                        claims[b][i][0] = Some(slot);
                        free[i][slot] = false;
                    }
                }
            }
        }
        claims
    }

    /// Joints of the bodies from their figures; figures that do not fit are handed back.
    fn place(
        &self,
        crowd: &Crowd,
        claims: &mut [Claims],
        free: &mut Free,
    ) -> Vec<Option<Vec<Vector3<f64>>>> {
        let mut found = Vec::with_capacity(claims.len());
        for (body, claims) in self.bodies.iter().zip(claims) {
            let views = claims.iter().filter(|claim| claim[0].is_some()).count();
            if views < 2 {
                found.push(None);
                continue;
            }
            let pose = placed(crowd, claims, &body.pose, self.known.sigma);
            // What does not fit where the others are: unless nothing does.
            let mut kept = 0;
            for (i, claim) in claims.iter_mut().enumerate() {
                if let Some(slot) = claim[0] {
                    if at_body(&crowd.views[i][slot], &pose, self.known.sigma, &self.known.mirror)
                        < FITS
                    {
                        *claim = [None, None];
                        free[i][slot] = true;
                    } else {
                        kept += 1;
                    }
                }
            }
            // Whoever is found again must have the same bones.
            let again = body.alone == 0
                || body.differs(&Body::new(0, pose.clone(), &self.known.limbs)) < 2.0 * DIFFERENCE;
            if kept >= 2 && !again {
                for (i, claim) in claims.iter_mut().enumerate() {
                    claim[0].into_iter().for_each(|slot| free[i][slot] = true);
                    *claim = [None, None];
                }
            }
            found.push((kept >= 2 && again).then_some(pose));
        }
        found
    }

    /// Free figures that fit a body where it is now known to be.
    fn claim_again(
        &self,
        crowd: &Crowd,
        claims: &mut [Claims],
        free: &mut Free,
        found: &mut [Option<Vec<Vector3<f64>>>],
    ) {
        let mut changed = vec![false; claims.len()];
        for (i, figures) in crowd.views.iter().enumerate() {
            if !free[i].iter().any(|f| *f) {
                continue;
            }
            let score = |b: usize, slot: usize| match &found[b] {
                Some(pose) if claims[b][i][0].is_none() && free[i][slot] => {
                    at_body(&figures[slot], pose, self.known.sigma, &self.known.mirror)
                }
                _ => 0.0,
            };
            let scores: Vec<Vec<f64>> = (0..claims.len())
                .map(|b| (0..figures.len()).map(|slot| score(b, slot)).collect())
                .collect();
            for (b, slot) in assign(&scores, FITS).into_iter().enumerate() {
                if let Some(slot) = slot {
                    claims[b][i][0] = Some(slot);
                    free[i][slot] = false;
                    changed[b] = true;
                }
            }
        }
        for (b, pose) in found.iter_mut().enumerate().filter(|(b, _)| changed[*b]) {
            if let Some(pose) = pose {
                *pose = placed(crowd, &claims[b], pose, self.known.sigma);
            }
        }
    }

    fn update(
        &mut self,
        crowd: &Crowd,
        claims: &mut [Claims],
        free: &mut Free,
        found: &[Option<Vec<Vector3<f64>>>],
    ) {
        let Known { sigma, mirror, limbs, .. } = &self.known;
        for ((body, claims), found) in self.bodies.iter_mut().zip(claims).zip(found) {
            let one = claims.iter().enumerate().find_map(|(i, claim)| Some((i, claim[0]?)));
            match (found, one) {
                (Some(pose), _) => body.update(pose, self.dt, limbs),
                (None, Some((i, slot))) => {
                    // One view cannot be checked by another: the figure must have the body's shape.
                    let figure = &crowd.views[i][slot];
                    let moved = body.follow(figure, self.dt, 2.0 * sigma);
                    if at_body(figure, &moved, *sigma, mirror) >= SHAPE {
                        body.pose = moved;
                    } else {
                        claims[i] = [None, None];
                        free[i][slot] = true;
                        body.miss(self.dt);
                    }
                }
                (None, None) => body.miss(self.dt),
            }
        }
    }

    /// Gives back the figures of bodies that only two views see, with little support, where there are others to choose from: a chance
    /// agreement of two views has to stand against every other pair.
    fn released(
        &self,
        judge: &Judge<'_>,
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
            if judge.support(crowd, &own, &body.pose) > DOUBTFUL {
                continue;
            }
            for (i, claim) in claims.iter().enumerate() {
                claim.iter().flatten().for_each(|slot| free[i][*slot] = true);
            }
            let nobody = vec![[None, None]; claims.len()];
            out.push((b, std::mem::replace(claims, nobody)));
        }
        out
    }

    /// Bodies whose figures were given back: the nearest newcomer that has one of them is the body; else it keeps what nobody took.
    fn confirm(
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
            let beside = BESIDE * self.known.sigma;
            let near = all.map(|(k, newcomer)| (far(newcomer), k)).filter(|(far, _)| *far < beside);
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
    fn admit(&mut self, crowd: &Crowd, newcomers: Vec<Newcomer>, claims: &mut Vec<Claims>) {
        for newcomer in newcomers {
            let near = |body: &Body| apart(&body.pose, &newcomer.pose) < SAME * self.known.sigma;
            if self.bodies.iter().any(|body| body.alone == 0 && near(body)) {
                continue;
            }
            let found = self
                .unseen_within_reach(&newcomer)
                .or_else(|| self.misplaced(crowd, claims, &newcomer));
            if let Some(b) = found {
                self.bodies[b].appear(newcomer.pose);
                claims[b] = newcomer.claims;
                continue;
            }
            let body = match self.lost_within_reach(&newcomer) {
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

    /// The nearest body that two views do not see now and that can have come here.
    fn unseen_within_reach(&self, newcomer: &Newcomer) -> Option<usize> {
        let all = self.bodies.iter().enumerate().filter(|(_, body)| body.alone > 0);
        self.nearest(all, newcomer)
    }

    /// The nearest body next to the newcomer whose own figures fit it badly.
    fn misplaced(&self, crowd: &Crowd, claims: &[Claims], newcomer: &Newcomer) -> Option<usize> {
        let Known { sigma, mirror, .. } = &self.known;
        let fit = |(b, body): (usize, &Body)| {
            let own = claims[b].iter().enumerate().filter_map(|(i, claim)| Some((i, claim[0]?)));
            let scores =
                own.map(|(i, slot)| at_body(&crowd.views[i][slot], &body.pose, *sigma, mirror));
            let (n, sum) = scores.fold((0, 0.0), |(n, sum), score| (n + 1, sum + score));
            let far = apart(&body.pose, &newcomer.pose);
            (far < BESIDE * sigma
                && n <= views(&newcomer.claims)
                && sum < MISFIT * f64::from(n as u32))
            .then_some((far, b))
        };
        let all = self.bodies.iter().enumerate().filter_map(fit);
        all.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, b)| b)
    }

    fn lost_within_reach(&self, newcomer: &Newcomer) -> Option<usize> {
        self.nearest(self.lost.iter().enumerate(), newcomer)
    }

    fn nearest<'a>(
        &self,
        bodies: impl Iterator<Item = (usize, &'a Body)>,
        newcomer: &Newcomer,
    ) -> Option<usize> {
        let body = Body::new(0, newcomer.pose.clone(), &self.known.limbs);
        let cost = |(at, lost): (usize, &Body)| {
            let gap = self.dt * (lost.alone + 1) as f64;
            let reach = REACH[0] + REACH[1] * gap;
            let far = apart(&lost.pose, &body.pose) / reach;
            // Bones of a single frame are no measure of them: they only tell apart after a while.
            let differs = lost.differs(&body) / DIFFERENCE;
            let agree = differs < 1.0 || (gap < HOLD && differs < 2.0);
            (far < 1.0 && agree).then_some((far + differs, at))
        };
        bodies.filter_map(cost).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, at)| at)
    }

    /// Of two bodies in one place the older one lives.
    fn merge_doubles(&mut self, claims: &mut Vec<Claims>) {
        let mut pairs = Vec::new();
        for (a, first) in self.bodies.iter().enumerate() {
            for second in &self.bodies[a + 1..] {
                if apart(&first.pose, &second.pose) < SAME * self.known.sigma {
                    let ids = [first.id.min(second.id), first.id.max(second.id)];
                    let before = self.doubles.iter().find(|(pair, _)| *pair == ids);
                    pairs.push((ids, before.map_or(0, |(_, n)| *n) + 1));
                }
            }
        }
        let least = (DOUBLE / self.dt).ceil() as usize;
        let gone: Vec<usize> =
            pairs.iter().filter(|(_, n)| *n >= least.max(2)).map(|(ids, _)| ids[1]).collect();
        self.doubles = pairs;
        let kept: Vec<bool> = self.bodies.iter().map(|body| !gone.contains(&body.id)).collect();
        let mut at = kept.iter();
        self.bodies.retain(|_| *at.next().unwrap_or(&true));
        let mut at = kept.iter();
        claims.retain(|_| *at.next().unwrap_or(&true));
    }

    fn sightings(&self, claims: &[Claims]) -> Vec<Sighting> {
        let least = (KNOWN / self.dt).round().clamp(1.0, 5.0) as usize;
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

    /// Bodies that were not seen for too long are lost, then forgotten.
    fn retire(&mut self) {
        let frames = |seconds: f64| (seconds / self.dt).ceil().max(1.0) as usize;
        let (hold, keep, alone) = (frames(HOLD), frames(KEEP), frames(ALONE));
        let is_lost = |body: &Body| body.missed > hold || body.alone > alone;
        let lost = self.bodies.extract_if(.., |body| is_lost(body));
        self.lost.extend(lost);
        self.lost.iter_mut().for_each(|body| body.alone += 1);
        self.lost.retain(|body| body.alone <= keep.max(alone) + hold);
    }
}

/// Figures at a body that has one in the same view: another part of the person, or the person detected twice.
pub(super) fn absorb(
    crowd: &Crowd,
    pose: &[Vector3<f64>],
    claims: &mut Claims,
    free: &mut Free,
    known: &Known,
) {
    for (i, claim) in claims.iter_mut().enumerate() {
        let Some(first) = claim[0] else { continue };
        for (slot, figure) in crowd.views[i].iter().enumerate() {
            if !free[i][slot] || at_body(figure, pose, known.sigma, &known.mirror) < AGAIN {
                continue;
            }
            free[i][slot] = false;
            let rays = figure.rays.iter().zip(&crowd.views[i][first].rays);
            let common = rays.filter(|(a, b)| a.is_there() && b.is_there()).count();
            if claim[1].is_none() && (common as f64) <= PART * figure.joints as f64 {
                claim[1] = Some(slot);
            }
        }
    }
}

//! Other places where joints may be, and the most likely combination of them.
//!
//! A joint on which neither all views that see it agree nor three and most of them is doubtful. It
//! may be where it is, where any two of its rays meet, or where a ray meets the sphere around the
//! other end of a bone: l_b = s ρ_b (1 + ε_b) with the population's ratio ρ_b and spread ε_b
//! ([`crate::bones::population`]) and a stature s of the person, which the frame's other bones
//! show, or the lengths that the user gives ([`crate::bones::expected`]). Each place has the
//! evidence of its detections ([`super::evidence`]), each combination that of the bones. On a tree
//! of bones the best combination follows from the leaves to the root (dynamic programming); bones
//! that close a circle are left out.

use nalgebra::Vector3;

use super::across::FourViews;
use super::consensus::{agrees, meeting_point, settled};
use super::evidence::{ASTRAY, Mixture};
use super::problem::{Prior, Solution};
use super::rays::{Ray, Rays, there};
use crate::bones::expected::{Expected, Shown, stature};
use crate::bones::population::Proportion;
use crate::bones::{Bone, Length, Pull, other_end};

/// Views that have to agree on a joint for it not to need its bones.
const ENOUGH: usize = 3;
/// Least number of joints on which two views agree, for a stature: others have nothing to hold on
/// to.
const LEAST_ANCHORS: usize = 3;
/// The same for given lengths.
const LEAST_GIVEN: usize = 1;
/// How far joints move from one frame to the next, mm per axis: a wrist at 2.5 m/s at 25 Hz.
const MOVED: f64 = 100.0;
/// The farthest that they may, mm: three standard deviations.
pub(crate) const LEAP: f64 = 3.0 * MOVED;

/// How many views agree on every joint at a solution, and how many see it.
pub(super) struct Votes {
    pub(super) agree: Vec<usize>,
    pub(super) seen: Vec<usize>,
}

impl Votes {
    pub(super) fn of(rays: &Rays, solution: &Solution) -> Self {
        let mut votes = Self { agree: vec![0; rays.n_joints()], seen: vec![0; rays.n_joints()] };
        for (j, x) in solution.points.iter().enumerate() {
            for ray in there(rays.of_joint(j)) {
                votes.seen[j] += 1;
                votes.agree[j] += usize::from(agrees(ray, x, solution.sigma[j]));
            }
        }
        votes
    }

    pub(super) fn is_doubtful(&self, j: usize) -> bool {
        let (agree, seen) = (self.agree[j], self.seen[j]);
        let all = agree == seen && agree > 1;
        seen > 0 && !all && (agree < ENOUGH || 2 * agree <= seen)
    }
}

/// The bones that take part: those of joints that need them.
pub(super) fn needed(expected: &Expected, solution: &Solution, votes: &Votes) -> Vec<Bone> {
    let anchors = votes.agree.iter().filter(|n| **n > 1).count();
    let least = if expected.given.is_empty() { LEAST_ANCHORS } else { LEAST_GIVEN };
    let doubtful = (0..votes.seen.len()).any(|j| votes.is_doubtful(j));
    if anchors < least || !doubtful {
        return Vec::new();
    }
    let needs = |bone: &Bone| bone.joints.iter().any(|j| votes.is_doubtful(*j));
    let seen = |bone: &Bone| bone.joints.iter().all(|j| votes.seen[*j] > 0);
    shown(expected, solution, votes).filter(|b| needs(b) && seen(b)).collect()
}

/// The bones of the layout, for the person that the frame shows.
pub(super) fn shown<'a>(
    expected: &'a Expected,
    solution: &Solution,
    votes: &Votes,
) -> impl Iterator<Item = Bone> + 'a {
    expected.bones(shown_stature(&expected.proportions, solution, votes))
}

/// −log p of the bones' lengths at a solution. To the variance of a length, each end adds that of
/// its own position in one direction, (Σk · ⅔/ŝ² + 1/W²)⁻¹, since I − d dᵀ has the mean eigenvalue
/// ⅔; `widest` is W, mm.
pub fn against_bones(bones: impl Iterator<Item = Bone>, solution: &Solution, widest: f64) -> f64 {
    let precision = 1.0 / (1.5 * solution.noise * solution.noise);
    let spread =
        |j: usize| 1.0 / (solution.residuals[j].support * precision + 1.0 / (widest * widest));
    let loss = |bone: Bone| {
        let [a, b] = bone.joints;
        let sigma = (bone.length.sigma.powi(2) + spread(a) + spread(b)).sqrt();
        let length = Length { sigma, ..bone.length };
        let pull = Pull::new(&solution.points[a], &solution.points[b], length);
        if pull.stiffness > 0.0 { pull.loss + sigma.ln() } else { 0.0 }
    };
    bones.map(loss).sum()
}

/// Where the joints of a frame are, and what says that they are elsewhere.
#[derive(Clone, Copy)]
pub(super) struct PlaceSearch<'a> {
    /// The detections.
    pub(super) rays: &'a Rays,
    /// Bones that take part.
    pub(super) bones: &'a [Bone],
    /// Where the joints are.
    pub(super) solution: &'a Solution,
    /// How many views agree.
    pub(super) votes: &'a Votes,
    /// How detections go wrong.
    pub(super) mixture: &'a Mixture,
    /// Priors `(N)`.
    pub(super) priors: Option<&'a [Prior]>,
    /// Where the joints were a moment ago, or are thought to be `(N)`.
    pub(super) past: Option<&'a [Option<Vector3<f64>>]>,
}

/// A place where a joint may be, and what speaks against it.
#[derive(Clone, Copy)]
struct Place {
    at: Vector3<f64>,
    cost: f64,
}

impl PlaceSearch<'_> {
    /// The most likely combination of places of the doubtful joints.
    pub(super) fn most_likely(&self) -> Vec<Vector3<f64>> {
        let points = &self.solution.points;
        let mut places: Vec<Vec<Place>> = (0..points.len()).map(|j| self.places(j)).collect();
        let order = tree(self.bones, points.len());
        // For each place of a parent the best place of the child.
        let mut choice: Vec<Vec<usize>> = vec![Vec::new(); points.len()];
        for (child, parent, length) in order.iter().rev() {
            let (child, parent) = (*child, *parent);
            let mut best = Vec::with_capacity(places[parent].len());
            for p in 0..places[parent].len() {
                let at = places[parent][p].at;
                let mut least = (0, f64::INFINITY);
                for (k, c) in places[child].iter().enumerate() {
                    // A bone only adds to the cost.
                    if c.cost < least.1 {
                        let cost = c.cost + Pull::new(&c.at, &at, *length).loss;
                        least = if cost < least.1 { (k, cost) } else { least };
                    }
                }
                best.push(least.0);
                places[parent][p].cost += if least.1 < f64::INFINITY { least.1 } else { 0.0 };
            }
            choice[child] = best;
        }
        let cheapest = |all: &Vec<Place>| {
            (0..all.len()).min_by(|a, b| all[*a].cost.total_cmp(&all[*b].cost)).unwrap_or(0)
        };
        let mut chosen: Vec<usize> = places.iter().map(cheapest).collect();
        for (child, parent, _) in &order {
            if let Some(k) = choice[*child].get(chosen[*parent]) {
                chosen[*child] = *k;
            }
        }
        let at = |j: usize| places[j].get(chosen[j]).map_or(points[j], |place| place.at);
        (0..points.len()).map(at).collect()
    }

    /// The places of joint `j`; only doubtful joints have others than their own.
    fn places(&self, j: usize) -> Vec<Place> {
        let x = self.solution.points[j];
        if !self.votes.is_doubtful(j) {
            return if x.x.is_finite() { vec![Place { at: x, cost: 0.0 }] } else { Vec::new() };
        }
        let views = FourViews::of(self.rays.of_joint(j));
        let mut found = self.elsewhere(j, &views, |end| self.votes.agree[end] > 1);
        // Every ray passes somewhere: a detection determines a place with another or with a bone.
        let has_bone = self.bones.iter().any(|bone| bone.joints.contains(&j));
        if found.is_empty() || self.votes.agree[j] > if has_bone { 0 } else { 1 } {
            // It would return from within its kernel.
            found.retain(|y| (y - x).norm() > self.solution.sigma[j]);
            found.insert(0, x);
        }
        found.retain(|x| x.x.is_finite());
        found.iter().map(|x| Place { at: *x, cost: self.against(j, &views, x) }).collect()
    }

    /// −log p of joint `j` with these `views` at `x`, without its bones.
    pub(super) fn against(&self, j: usize, views: &[FourViews], x: &Vector3<f64>) -> f64 {
        let prior = self.priors.map(|priors| &priors[j]);
        let past = self.past.and_then(|past| past[j]);
        let moved = past.map_or(0.0, |past| since(&(x - past)));
        moved - self.mixture.at(views, x, prior).0
    }

    /// Where two rays of joint `j` meet that do not both agree on where it is, and where a ray
    /// meets the sphere around the other end of a bone, of those `ends`.
    pub(super) fn elsewhere(
        &self,
        j: usize,
        views: &[FourViews],
        ends: impl Fn(usize) -> bool,
    ) -> Vec<Vector3<f64>> {
        let (rays, sigma) = (self.rays.of_joint(j), self.solution.sigma[j]);
        let x = &self.solution.points[j];
        let agrees = |ray: &Ray| agrees(ray, x, sigma);
        let mut found = Vec::with_capacity(rays.len() * (rays.len() + self.bones.len()));
        for (k, first) in rays.iter().enumerate().filter(|(_, ray)| ray.is_there()) {
            let others = there(&rays[k + 1..]).filter(|other| !(agrees(first) && agrees(other)));
            let meetings = others.filter_map(|other| meeting_point(first, other, sigma));
            found.extend(meetings.map(|x| settled(views, x, sigma)));
            for bone in self.bones {
                if let Some(end) = other_end(bone.joints, j).filter(|end| ends(*end)) {
                    let centre = &self.solution.points[end];
                    found.extend(meetings_with_sphere(first, centre, bone.length.mean));
                }
            }
        }
        found
    }
}

/// −log of the probability of having moved this far since the past frame.
fn since(moved: &Vector3<f64>) -> f64 {
    let near = (-0.5 * moved.norm_squared() / (MOVED * MOVED)).exp();
    -(ASTRAY + (1.0 - ASTRAY) * near).ln()
}

/// Bones as (child, parent, length) from the root of each tree outwards.
fn tree(bones: &[Bone], joints: usize) -> Vec<(usize, usize, Length)> {
    let mut order: Vec<(usize, usize, Length)> = Vec::with_capacity(bones.len());
    let mut reached = vec![false; joints];
    for root in 0..joints {
        if reached[root] || !bones.iter().any(|bone| bone.joints.contains(&root)) {
            continue;
        }
        reached[root] = true;
        let mut ends = vec![root];
        while let Some(parent) = ends.pop() {
            for bone in bones {
                if let Some(child) = other_end(bone.joints, parent).filter(|end| !reached[*end]) {
                    reached[child] = true;
                    order.push((child, parent, bone.length));
                    ends.push(child);
                }
            }
        }
    }
    order
}

/// The points of a ray at the distance `length` from `centre`, or the nearest one if it passes
/// farther away, in front of the camera.
fn meetings_with_sphere(
    ray: &Ray,
    centre: &Vector3<f64>,
    length: f64,
) -> impl Iterator<Item = Vector3<f64>> {
    let offset = ray.offset(centre);
    let half = (length * length - offset.across.norm_squared()).max(0.0).sqrt();
    let (from, along, range) = (ray.centre, ray.direction, offset.range);
    let ends = [range - half, range + half].into_iter().take(if half > 0.0 { 2 } else { 1 });
    ends.filter(|r| *r > 0.0).map(move |r| from + along * r)
}

/// The stature that the well-seen bones show, and its standard error.
fn shown_stature(proportions: &[Proportion], solution: &Solution, votes: &Votes) -> [f64; 2] {
    let noise = solution.noise * solution.noise;
    let shown = |p: &Proportion| {
        let [a, b] = p.joints;
        let agree = votes.agree[a].min(votes.agree[b]);
        let few = if agree < ENOUGH { 4.0 } else { 1.0 };
        let length = (solution.points[a] - solution.points[b]).norm();
        (agree > 1).then_some(Shown { proportion: *p, length, variance: few * 2.0 * noise })
    };
    stature(proportions.iter().filter_map(shown))
}

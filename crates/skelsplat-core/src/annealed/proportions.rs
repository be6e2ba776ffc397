//! Expected lengths in one frame: bones for joints that too few views see.
//!
//! Where fewer than three views agree on a joint, and not all that see it, the lengths of its bones
//! take part: l_b = s ρ_b (1 + ε_b) with the population's ratio ρ_b and spread ε_b
//! ([`crate::bones::population`]) and a stature s of the person, which the frame's other bones
//! show, or the lengths that the user gives ([`crate::bones::expected`]). The frame is then solved
//! twice with the bones' terms, from where it was and from wide kernels; the solution with the
//! lower objective counts. A joint that one view sees starts where its bone meets the ray.

use nalgebra::Vector3;

use super::consensus::{REJECTED, Rival, meeting_point, settled};
use super::rays::{Ray, Rays, there};
use super::solver::{Problem, Solution, solve};
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
/// Kernel of the joints that do, in the search from wide kernels, mm.
const WIDE: f64 = 160.0;
/// Distance in kernels within which a place is the same one.
const SAME: f64 = 1.0;
/// By how much the objective of another solution has to be lower than that of the nearest one.
const CLEARLY: f64 = 1.0;

/// How many views agree on every joint at a solution, and how many see it.
struct Votes {
    agree: Vec<usize>,
    seen: Vec<usize>,
}

impl Votes {
    fn of(rays: &Rays, solution: &Solution) -> Self {
        let count = |j: usize, counts: &dyn Fn(&Ray) -> bool| {
            there(rays.of_joint(j)).filter(|ray| counts(ray)).count()
        };
        let agree = |j: usize| {
            let (x, sigma) = (&solution.points[j], solution.sigma[j]);
            count(j, &|ray| x.x.is_finite() && ray.offset(x).weight(sigma) >= REJECTED)
        };
        let joints = 0..rays.n_joints();
        Self {
            agree: joints.clone().map(agree).collect(),
            seen: joints.map(|j| count(j, &|_| true)).collect(),
        }
    }

    fn needs_bones(&self, j: usize) -> bool {
        let all = self.agree[j] == self.seen[j] && self.agree[j] > 1;
        self.seen[j] > 0 && self.agree[j] < ENOUGH && !all
    }
}

/// A better solution of `problem` with the bones that its `solution` needs, and these bones; `None`
/// if it needs none. Without `search` it is the nearest one.
pub fn with_bones(
    problem: &Problem<'_>,
    expected: &Expected,
    solution: &Solution,
    search: bool,
) -> Option<(Solution, Vec<Bone>)> {
    let votes = Votes::of(problem.rays, solution);
    let bones = needed(expected, solution, &votes)?;
    let mut points = solution.points.clone();
    place(problem.rays, &bones, &mut points);
    let problem = Problem { bones: &bones, ..*problem };
    let end = problem.annealing.end.iter();
    let sigmas = solution.sigma.iter().zip(end);
    let narrow: Vec<f64> = sigmas.map(|(s, e)| if s.is_finite() { *s } else { *e }).collect();
    let here = solve(&problem, &points, &narrow);
    let best = if search { searched(&problem, &points, &narrow, here, &votes) } else { here };
    Some((best, bones))
}

/// The bones that take part, if any: those of joints that need them.
fn needed(expected: &Expected, solution: &Solution, votes: &Votes) -> Option<Vec<Bone>> {
    let anchors = votes.agree.iter().filter(|n| **n > 1).count();
    let least = if expected.given.is_empty() { LEAST_ANCHORS } else { LEAST_GIVEN };
    let doubtful = (0..votes.seen.len()).any(|j| votes.needs_bones(j));
    if anchors < least || !doubtful {
        return None;
    }
    let stature = shown_stature(&expected.proportions, solution, votes);
    let needs = |bone: &Bone| bone.joints.iter().any(|j| votes.needs_bones(*j));
    let seen = |bone: &Bone| bone.joints.iter().all(|j| votes.seen[*j] > 0);
    let bones: Vec<Bone> = expected.bones(stature).filter(|b| needs(b) && seen(b)).collect();
    (!bones.is_empty()).then_some(bones)
}

/// The best of the solution `here`, the one from wide kernels, and the one from the most likely
/// combination of places. Where that combination is both where `here` began and where it ended, the
/// others are hardly ever better (docs/decisions.md).
fn searched(
    problem: &Problem<'_>,
    points: &[Vector3<f64>],
    narrow: &[f64],
    here: Solution,
    votes: &Votes,
) -> Solution {
    let joints = 0..points.len();
    let doubtful: Vec<bool> = joints.clone().map(|j| votes.needs_bones(j)).collect();
    let placed = joints.clone().map(|j| votes.agree[j] > 1).collect();
    let variance = here.variance;
    let sigma = &problem.annealing.end;
    let Problem { rays, bones, .. } = *problem;
    let search = PlaceSearch { rays, bones, points, doubtful, placed, sigma, variance };
    let guess = most_likely(&search);
    let is_doubtful = |j: &usize| search.doubtful[*j];
    let near = |j: usize, x: &Vector3<f64>| (guess[j] - x).norm() <= SAME * narrow[j];
    let stays = |j: usize| near(j, &points[j]) && near(j, &here.points[j]);
    if joints.clone().filter(is_doubtful).all(stays) {
        return here;
    }
    let kernel = |j| if is_doubtful(&j) { narrow[j].max(WIDE) } else { narrow[j] };
    let wide: Vec<f64> = joints.map(kernel).collect();
    let mut best = here;
    for other in [solve(problem, points, &wide), solve(problem, &guess, narrow)] {
        if objective(problem, &other, variance) + CLEARLY < objective(problem, &best, variance) {
            best = other;
        }
    }
    best
}

/// What the search for the most likely combination of places starts from.
#[derive(Debug)]
pub struct PlaceSearch<'a> {
    /// The detections.
    pub rays: &'a Rays,
    /// Bones of known length.
    pub bones: &'a [Bone],
    /// Positions `(N)`, mm; NaN where there is none.
    pub points: &'a [Vector3<f64>],
    /// Joints that need their bones.
    pub doubtful: Vec<bool>,
    /// Joints on which two views agree.
    pub placed: Vec<bool>,
    /// Final kernel of each joint, mm.
    pub sigma: &'a [f64],
    /// ŝ², mm².
    pub variance: f64,
}

/// A place where a joint may be, and what its detections say against it.
#[derive(Clone, Copy)]
struct Place {
    at: Vector3<f64>,
    cost: f64,
}

/// The most likely combination of places of the doubtful joints: where two of a joint's rays meet,
/// where one meets the sphere around the other end of a bone, and where it is. On a tree of bones,
/// the best combination follows from the leaves to the root (dynamic programming); bones that close
/// a circle are left out.
pub fn most_likely(search: &PlaceSearch<'_>) -> Vec<Vector3<f64>> {
    let points = search.points;
    let mut places: Vec<Vec<Place>> = Vec::with_capacity(points.len());
    for (j, x) in points.iter().enumerate() {
        let mut found = vec![*x];
        if search.doubtful[j] {
            hypotheses(search, j, &mut found);
        }
        found.retain(|x| x.x.is_finite());
        let (rays, sigma) = (search.rays.of_joint(j), search.sigma[j]);
        let cost = |x: &Vector3<f64>| cost_of_rays(rays, x, sigma, search.variance);
        let place = |x: &Vector3<f64>| Place { at: *x, cost: cost(x) };
        places.push(found.iter().map(place).collect());
    }
    let order = tree(search.bones, points.len());
    // For each place of a parent the best place of the child.
    let mut choice: Vec<Vec<usize>> = vec![Vec::new(); points.len()];
    for (child, parent, length) in order.iter().rev() {
        let (child, parent) = (*child, *parent);
        let mut best = Vec::with_capacity(places[parent].len());
        for p in 0..places[parent].len() {
            let at = places[parent][p].at;
            let cost = |c: &Place| c.cost + Pull::new(&c.at, &at, *length).loss;
            let costs = places[child].iter().map(cost).enumerate();
            let least = costs.min_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((k, cost)) = least {
                places[parent][p].cost += cost;
                best.push(k);
            }
        }
        choice[child] = best;
    }
    let mut chosen: Vec<usize> = places
        .iter()
        .map(|all| (0..all.len()).min_by(|a, b| all[*a].cost.total_cmp(&all[*b].cost)).unwrap_or(0))
        .collect();
    for (child, parent, _) in &order {
        if let Some(k) = choice[*child].get(chosen[*parent]) {
            chosen[*child] = *k;
        }
    }
    let at = |j: usize| places[j].get(chosen[j]).map_or(points[j], |place| place.at);
    (0..points.len()).map(at).collect()
}

fn hypotheses(search: &PlaceSearch<'_>, j: usize, found: &mut Vec<Vector3<f64>>) {
    let (rays, sigma) = (search.rays.of_joint(j), search.sigma[j]);
    for (k, first) in rays.iter().enumerate().filter(|(_, ray)| ray.is_there()) {
        let meetings =
            there(&rays[k + 1..]).filter_map(|second| meeting_point(first, second, sigma));
        found.extend(meetings.map(|x| settled(rays, x, sigma)));
        for bone in search.bones {
            if let Some(other) = other_end(bone.joints, j).filter(|end| search.placed[*end]) {
                found.extend(meetings_with_sphere(first, &search.points[other], bone.length.mean));
            }
        }
    }
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

/// F of a joint's detections at `x`.
fn cost_of_rays(rays: &[Ray], x: &Vector3<f64>, sigma: f64, variance: f64) -> f64 {
    let cost = |ray: &Ray| {
        ray.weight * 2.0 * sigma * sigma * (1.0 - ray.offset(x).weight(sigma)) / variance
    };
    there(rays).map(cost).sum()
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

/// Places joints without a position on their rays, where their bone from a placed joint ends.
fn place(rays: &Rays, bones: &[Bone], points: &mut [Vector3<f64>]) {
    for _ in 0..bones.len() {
        let mut moved = false;
        for bone in bones {
            let [a, b] = bone.joints;
            let (from, to) = match (points[a].x.is_finite(), points[b].x.is_finite()) {
                (true, false) => (a, b),
                (false, true) => (b, a),
                _ => continue,
            };
            let ray = rays.of_joint(to).iter().find(|ray| ray.is_there());
            let first = ray
                .and_then(|ray| meetings_with_sphere(ray, &points[from], bone.length.mean).next());
            if let Some(x) = first {
                points[to] = x;
                moved = true;
            }
        }
        if !moved {
            break;
        }
    }
}

/// F of the detections, priors and bones at a solution, all under one variance.
fn objective(problem: &Problem<'_>, solution: &Solution, variance: f64) -> f64 {
    let mut sum = 0.0;
    for (j, x) in solution.points.iter().enumerate().filter(|(_, x)| x.x.is_finite()) {
        sum += cost_of_rays(problem.rays.of_joint(j), x, problem.annealing.end[j], variance);
        if let Some(prior) = problem.priors.map(|priors| &priors[j]) {
            let off = x - prior.mean;
            sum += 0.5 * off.dot(&(prior.precision * off));
        }
    }
    let at = |j: usize| &solution.points[j];
    let bones =
        problem.bones.iter().map(|b| Pull::new(at(b.joints[0]), at(b.joints[1]), b.length).loss);
    sum + bones.filter(|loss| loss.is_finite()).sum::<f64>()
}

/// The other place on the ray of joint `j`, which only this ray determines: its bone has the same
/// length there. With the share of the probability of both that it has.
pub fn other_place(problem: &Problem<'_>, solution: &Solution, j: usize) -> Option<Rival> {
    let x = &solution.points[j];
    let ray = there(problem.rays.of_joint(j)).min_by(|a, b| {
        let apart = |ray: &Ray| ray.offset(x).across.norm_squared();
        apart(a).total_cmp(&apart(b))
    })?;
    let of_joint = || problem.bones.iter().filter(|bone| bone.joints.contains(&j));
    let end = |bone: &Bone| &solution.points[bone.joints[usize::from(bone.joints[0] == j)]];
    let known = of_joint().filter(|bone| end(bone).x.is_finite());
    let bone = known.min_by(|a, b| a.length.sigma.total_cmp(&b.length.sigma))?;
    let back = ray.offset(end(bone)).range - ray.offset(x).range;
    let at = x + ray.direction * (2.0 * back);
    if ray.offset(&at).range <= 0.0 {
        return None;
    }
    let against = |x: &Vector3<f64>| {
        let bones: f64 = of_joint().map(|bone| Pull::new(x, end(bone), bone.length).loss).sum();
        let (rays, sigma) = (problem.rays.of_joint(j), problem.annealing.end[j]);
        bones + cost_of_rays(rays, x, sigma, solution.variance)
    };
    Some(Rival { at, share: 1.0 / (1.0 + (against(&at) - against(x)).exp()) })
}

//! A body between frames: where its joints are, how they move, how long its bones are.

use nalgebra::Vector3;

use super::crowd::{Crowd, Figure};
use crate::annealed::rays::{Meeting, Ray};
use crate::detections::Detections;
use crate::sequence::times::SHORT;
use crate::statistics::median;

/// Kernels under which a joint settles, in multiples of σ.
const SETTLE: [f64; 3] = [1.5, 0.75, 0.5];
/// Weight of the expected place, as a share of that of all rays.
const PRIOR: f64 = 0.01;
/// Least weight k of each of two rays that meet, and of those along which one view moves a body.
const MEETS: f64 = 0.1;
/// Least weight k of a ray that fits.
const FIT: f64 = 0.3;
/// Time in which a velocity fades when nothing is seen, s.
const FADE: f64 = 0.25;
/// Fastest motion of a joint, mm/s.
const FASTEST: f64 = 10_000.0;
/// Smallest share with which a frame changes the mean length of a bone.
const LEAST_SHARE: f64 = 0.02;

/// The figures of one body: by view, the slot of its figure and of another part of the same person.
pub type Claims = Vec<[Option<usize>; 2]>;

/// The detections in the `slots` of a frame that one body has claimed.
pub fn claimed(slots: &[Detections], claims: &Claims, n_joints: usize) -> Detections {
    let from =
        |i: usize, j: usize| claims[i].iter().flatten().find_map(|slot| slots[*slot].get(i, j));
    Detections::gathered(claims.len(), n_joints, from)
}

/// Number of views that see a body.
pub fn views(claims: &Claims) -> usize {
    claims.iter().filter(|claim| claim[0].is_some()).count()
}

/// Joints from the figures of one body: those with a place of their own.
pub fn placed(
    crowd: &Crowd,
    claims: &Claims,
    near: &[Vector3<f64>],
    sigma: f64,
) -> Vec<Vector3<f64>> {
    let mut rays = Vec::with_capacity(claims.len());
    let place = |j: usize| {
        rays.clear();
        rays.extend(claims.iter().enumerate().filter_map(|(i, claim)| {
            let ray = |slot: &usize| crowd.views[i][*slot].rays[j];
            claim.iter().flatten().map(ray).find(Ray::is_there)
        }));
        settled(&rays, &near[j], sigma).unwrap_or(Vector3::repeat(f64::NAN))
    };
    (0..near.len()).map(place).collect()
}

/// The point near `start` (NaN: anywhere) that the rays agree on, under narrowing kernels.
///
/// Where rays are nearly parallel, as those of opposite cameras, the expected place decides along
/// them: it counts as [`PRIOR`] of a ray.
fn settled(rays: &[Ray], start: &Vector3<f64>, sigma: f64) -> Option<Vector3<f64>> {
    if rays.len() < 2 {
        return None;
    }
    let prior = (!start.x.is_nan()).then_some(start);
    let all = nearest(rays, prior, |ray| ray.weight)?;
    // Two rays cannot outvote each other: they meet, or they do not.
    if rays.len() == 2 {
        let meets = |ray: &Ray| ray.offset(&all).weight(sigma) > MEETS;
        return rays.iter().all(meets).then_some(all);
    }
    let mut x = if start.x.is_nan() { all } else { *start };
    for kernel in SETTLE {
        let weight = |ray: &Ray| ray.weight * ray.offset(&x).weight(kernel * sigma);
        x = match nearest(rays, prior, weight) {
            Some(next) => next,
            None if kernel == SETTLE[0] => all,
            None => return Some(x),
        };
    }
    let fits = rays.iter().filter(|ray| ray.offset(&x).weight(sigma) > FIT).count();
    (fits >= 2).then_some(x)
}

/// The point with the least Σ w |e|² + [`PRIOR`] |x − x⁰|²; without x⁰ `None` if the rays are
/// parallel.
fn nearest(
    rays: &[Ray],
    prior: Option<&Vector3<f64>>,
    weight: impl Fn(&Ray) -> f64,
) -> Option<Vector3<f64>> {
    let mut sums = Meeting::default();
    rays.iter().for_each(|ray| sums.add(ray, weight(ray)));
    // The trace of Σ w (I − d dᵀ) is 2 Σ w.
    prior.iter().for_each(|start| sums.tie(start, 2.0 * PRIOR));
    sums.point()
}

/// A person who is followed.
#[derive(Debug, Clone)]
pub struct Body {
    /// Identity, counted from 0 in the order of appearance.
    pub id: usize,
    /// Joints `(N)`, mm; NaN where never seen.
    pub pose: Vec<Vector3<f64>>,
    velocity: Vec<Vector3<f64>>,
    /// Mean length of each limb, mm, and in how many frames it was measured.
    lengths: Vec<(f64, usize)>,
    /// Frames in which two views saw it.
    pub seen: usize,
    /// Frames since two views saw it.
    pub alone: usize,
    /// Frames since any view saw it.
    pub missed: usize,
}

impl Body {
    /// Appears at `pose`.
    pub fn new(id: usize, pose: Vec<Vector3<f64>>, limbs: &[[usize; 2]]) -> Self {
        let mut body = Self {
            id,
            velocity: vec![Vector3::zeros(); pose.len()],
            lengths: vec![(0.0, 0); limbs.len()],
            pose,
            seen: 1,
            alone: 0,
            missed: 0,
        };
        body.measure(limbs);
        body
    }

    /// Moves on by a frame of `dt` seconds.
    pub fn predict(&mut self, dt: f64) {
        for (x, v) in self.pose.iter_mut().zip(&self.velocity) {
            *x += v * dt;
        }
    }

    /// Takes over the joints `found` by its rays; the others move along with them.
    pub fn update(&mut self, found: &[Vector3<f64>], dt: f64, limbs: &[[usize; 2]]) {
        let steps: Vec<Vector3<f64>> = self
            .pose
            .iter()
            .zip(found)
            .map(|(x, y)| y - x)
            .filter(|step| !step.x.is_nan())
            .collect();
        let common = median_of(&steps);
        let share = (dt / SHORT).min(1.0);
        let shared = median_of(&self.velocity);
        for ((x, v), y) in self.pose.iter_mut().zip(&mut self.velocity).zip(found) {
            if y.x.is_nan() {
                // Without news the joint follows the body.
                *x += common;
                *v += (shared - *v) * share;
            } else if x.x.is_nan() {
                (*x, *v) = (*y, shared);
            } else {
                *v += (y - *x) / dt * share;
                *x = *y;
            }
            if v.norm() > FASTEST {
                *v = Vector3::zeros();
            }
        }
        (self.seen, self.alone, self.missed) = (self.seen + 1, 0, 0);
        self.measure(limbs);
    }

    /// Is found again at `pose` after having been lost.
    pub fn appear(&mut self, pose: Vec<Vector3<f64>>) {
        self.velocity = vec![Vector3::zeros(); pose.len()];
        self.pose = pose;
        // It may have been seen elsewhere in this frame, wrongly.
        self.seen += usize::from(self.alone > 0);
        (self.alone, self.missed) = (0, 0);
    }

    /// Follows the one view that sees it, across its rays: the joints there.
    pub fn follow(&mut self, figure: &Figure, dt: f64, sigma: f64) -> Vec<Vector3<f64>> {
        let across: Vec<Vector3<f64>> = figure
            .rays
            .iter()
            .zip(&self.pose)
            .filter(|(ray, x)| ray.is_there() && !x.x.is_nan())
            .map(|(ray, x)| ray.offset(x))
            .filter(|offset| offset.weight(sigma) > MEETS)
            .map(|offset| -offset.across)
            .collect();
        let step = median_of(&across);
        let share = (dt / SHORT).min(1.0);
        self.velocity.iter_mut().for_each(|v| *v += step / dt * share);
        (self.alone, self.missed) = (self.alone + 1, 0);
        self.fade(dt);
        self.pose.iter().map(|x| x + step).collect()
    }

    /// No view sees it.
    pub fn miss(&mut self, dt: f64) {
        (self.alone, self.missed) = (self.alone + 1, self.missed + 1);
        self.fade(dt);
    }

    fn fade(&mut self, dt: f64) {
        self.velocity.iter_mut().for_each(|v| *v *= (-dt / FADE).exp());
    }

    fn measure(&mut self, limbs: &[[usize; 2]]) {
        for ((mean, n), [a, b]) in self.lengths.iter_mut().zip(limbs) {
            let long = (self.pose[*a] - self.pose[*b]).norm();
            if long.is_finite() {
                *n += 1;
                *mean += (long - *mean) * (1.0 / *n as f64).max(LEAST_SHARE);
            }
        }
    }

    /// Median difference of the lengths of bones, relative to the length; 0 if they have none in
    /// common.
    pub fn differs(&self, other: &Self) -> f64 {
        let both = self.lengths.iter().zip(&other.lengths).filter(|(a, b)| a.1 > 0 && b.1 > 0);
        median(both.map(|(a, b)| (a.0 / b.0).ln().abs())).max(0.0)
    }
}

/// Median distance of the joints that two poses have in common, mm; infinite if those are fewer
/// than three.
pub fn apart(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    let between = a.iter().zip(b).map(|(x, y)| (x - y).norm());
    let known: Vec<f64> = between.filter(|d| d.is_finite()).collect();
    let least = 3.min(a.len());
    if known.len() < least { f64::INFINITY } else { median(known).min(f64::INFINITY) }
}

/// Coordinate-wise median of those that are known; zero of nothing.
fn median_of(values: &[Vector3<f64>]) -> Vector3<f64> {
    let axis = |k: usize| median(values.iter().map(|v| v[k]).filter(|v| v.is_finite()));
    let middle = Vector3::from_fn(|k, _| axis(k));
    if middle.iter().any(|v| v.is_nan()) { Vector3::zeros() } else { middle }
}

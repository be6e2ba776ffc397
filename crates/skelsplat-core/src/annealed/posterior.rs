//! The posterior covariance of a pose: its error bars.
//!
//! Σ_post = (Σ_i c k (I − d dᵀ)/ŝ_j² + Π + I/ρ² + symmetry)⁻¹ at the solution. ŝ_j² is the frame's
//! noise, corrected by the joint's own residuals as a scaled inverse χ²: a joint with views that
//! disagree has a wider bar. Along a ray that no other crosses only ρ contributes: the joint
//! belongs to a body, with joints at distance s (root mean square) from its centre, and lies in
//! front of the camera. Where x is more than 2 s from the centre, the distance beyond is added in
//! squares: wherever the joint lies on such a ray, the bar reaches back to the body. Joints closer
//! together than twice the noise are not treated as a body.

use nalgebra::{Matrix3, Vector3};

use super::couplings::{of_bone, of_pair};
use super::depth::is_fixed;
use super::equations::covariances;
use super::places::PlaceSearch;
use super::problem::Solution;
use super::rays::{Ray, Rays};
use super::rivals::{Rival, rivals};
use crate::bones::other_end;
use crate::matrix3::{Symmetric, symmetrised};
use crate::outcome::{ErrorBars, JointStatus};
use crate::symmetry::LimbPair;

/// Weight of the frame's noise for one joint, in degrees of freedom (measured, docs/decisions.md).
const SHARED_DOF: f64 = 5.0;
/// Least sum of the weights of views that locate a joint, two of them: before it, the length of its
/// limb is not used for it, and it does not show the noise.
pub(crate) const PLACED: f64 = 1.5;
/// All joints lie within this multiple of the body's spread.
const BODY: f64 = 2.0;
/// Minimum spread of a body, in multiples of the noise: closer joints cannot be distinguished from
/// one point.
pub(crate) const LEAST_SPREAD: f64 = 2.0;
/// Largest standard deviation of an inferred joint, as a share of the body's spread.
pub(crate) const INFERRED: f64 = 0.25;
/// Minimum number of joints of a body.
const LEAST_JOINTS: usize = 3;
/// Probability of all other places, with the frame's noise, from which a joint is not determined.
const UNSURE: f64 = 0.025;
/// A solution and everything it rests on.
#[derive(Clone, Copy)]
pub(super) struct Explanation<'a> {
    /// The joints, their detections and bones.
    pub(super) search: PlaceSearch<'a>,
    /// Limbs of equal length.
    pub(super) pairs: &'a [LimbPair],
    /// σ_sym, mm.
    pub(super) symmetry_sigma: f64,
    /// Share of the residuals' variance that is noise; the rest are wrong detections that the
    /// kernel lets through.
    pub(super) noise_share: f64,
    /// Whether a joint may have more noise than the others.
    pub(super) own_noise: bool,
}

/// Posterior, weights of the detections and status of every joint at the solution.
pub(super) fn error_bars(of: &Explanation<'_>) -> ErrorBars {
    let PlaceSearch { rays, bones, solution, votes, .. } = of.search;
    let (m, n) = (rays.n_views(), rays.n_joints());
    let believed = believed(rays, solution);
    let k = |j: usize| &believed[j * m..(j + 1) * m];
    let deep: Vec<bool> = (0..n).map(|j| is_fixed(rays.of_joint(j), j, solution, k(j))).collect();
    let body = BodyExtent::of(&solution.points, &deep);
    let mut covariances = posterior(of, body, &believed);
    let mut status: Vec<JointStatus> = (0..n)
        .map(|j| match votes.seen[j] {
            0 => JointStatus::Unobserved,
            _ if votes.agree[j] < 2 || !deep[j] => JointStatus::Weak,
            _ => JointStatus::Ok,
        })
        .collect();
    let spread = body.map_or(0.0, |body| body.square_spread.sqrt());
    for j in 0..n {
        let (mut here, mut elsewhere, mut more) = (1.0, 0.0, Matrix3::zeros());
        for Rival { at, share, spread } in rivals(&of.search, j, of.own_noise) {
            let off = at - solution.points[j];
            more += (off * off.transpose() + spread.unwrap_or(covariances[j])) * share;
            here -= share;
            elsewhere += if spread.is_none() { share } else { 0.0 };
        }
        if here < 1.0 {
            covariances[j] = positive(symmetrised(&(covariances[j] * here + more)));
        }
        if elsewhere > UNSURE * (here + elsewhere) {
            status[j] = JointStatus::Weak;
        }
    }
    let is_held = |j: &usize| {
        let mut ends = bones.iter().filter_map(|bone| other_end(bone.joints, *j));
        ends.any(|end| status[end] == JointStatus::Ok)
    };
    let is_weak = |j: &usize| votes.agree[*j] < 2 && status[*j] == JointStatus::Weak;
    let widest = |j: &usize| covariances[*j].symmetric_eigenvalues().max().sqrt();
    let is_near = |j: &usize| widest(j) <= INFERRED * spread;
    let inferred: Vec<usize> = (0..n).filter(|j| is_weak(j) && is_held(j) && is_near(j)).collect();
    inferred.iter().for_each(|j| status[*j] = JointStatus::Inferred);
    // Without detections the noise is that of the prior, not a measurement.
    let is_seen = status.iter().any(|s| *s != JointStatus::Unobserved);
    let noise = if is_seen { solution.noise } else { f64::NAN };
    ErrorBars { covariances, noise, believed, status }
}

/// k of every ray `(N, M)` at the solution; NaN where missing.
fn believed(rays: &Rays, solution: &Solution) -> Vec<f64> {
    let mut believed = Vec::with_capacity(rays.n_joints() * rays.n_views());
    for (j, x) in solution.points.iter().enumerate() {
        let k = |ray: &Ray| ray.trust(x, solution.sigma[j]).unwrap_or(f64::NAN);
        believed.extend(rays.of_joint(j).iter().map(k));
    }
    believed
}

/// Posterior covariances `(N)`, mm²; NaN where unobserved. `k` are the rays' weights `(N, M)`.
fn posterior(of: &Explanation<'_>, body: Option<BodyExtent>, k: &[f64]) -> Vec<Matrix3<f64>> {
    let PlaceSearch { rays, bones, solution, priors, .. } = of.search;
    let least = LEAST_SPREAD * solution.noise;
    let body = body.filter(|body| body.square_spread > least * least);
    let block = |(j, x): (usize, &Vector3<f64>)| {
        let residuals = &solution.residuals[j];
        let variance = of.noise_share * (SHARED_DOF * solution.variance + residuals.squares)
            / (SHARED_DOF + residuals.freedom);
        let (mut outer, mut weight, mut nearest) = (Symmetric::default(), 0.0, f64::INFINITY);
        let of_joint = rays.of_joint(j);
        let weights = &k[j * of_joint.len()..];
        for (ray, k) in of_joint.iter().zip(weights).filter(|(ray, _)| ray.is_there()) {
            let w = ray.weight * k / variance;
            outer.add_outer(w, &ray.direction.into());
            weight += w;
            nearest = nearest.min((x - ray.centre).norm());
        }
        let reach = square_reach(body, x, nearest);
        let least = if nearest.is_finite() { 1.0 / reach } else { 0.0 };
        let block = outer.below(weight, 1.0, least).matrix();
        block + priors.map_or_else(Matrix3::zeros, |priors| priors[j].precision)
    };
    let blocks: Vec<Matrix3<f64>> = solution.points.iter().enumerate().map(block).collect();
    let at = |j: usize| solution.points[j];
    // Equal limbs allow two positions on the ray of a joint that one view sees, which is not a
    // normal distribution.
    let is_placed = |j: &usize| solution.residuals[*j].support >= PLACED;
    let pairs = of.pairs.iter().filter(|(l, r)| l.iter().chain(r).all(is_placed));
    let pairs = pairs.filter_map(|pair| of_pair(pair, of.symmetry_sigma, at));
    let couplings: Vec<_> =
        pairs.chain(bones.iter().filter_map(|bone| of_bone(bone, at))).collect();
    let known = |m: Matrix3<f64>| {
        if m.trace() > 0.0 { positive(symmetrised(&m)) } else { Matrix3::repeat(f64::NAN) }
    };
    covariances(&blocks, &couplings).into_iter().map(known).collect()
}

/// `m` without the negative eigenvalues due to rounding where the largest exceeds the smallest by
/// 10⁸ or more.
fn positive(m: Matrix3<f64>) -> Matrix3<f64> {
    if m.cholesky().is_some() {
        return m;
    }
    let mut eigen = m.symmetric_eigen();
    let least = f64::EPSILON * eigen.eigenvalues.max();
    eigen.eigenvalues.apply(|v| *v = v.max(4.0 * least));
    symmetrised(&eigen.recompose())
}

/// Position and extent of a body.
#[derive(Clone, Copy)]
pub(crate) struct BodyExtent {
    middle: Vector3<f64>,
    /// s², mm².
    pub(crate) square_spread: f64,
}

impl BodyExtent {
    /// From the joints with a known depth, if there are at least three, else from all that have a
    /// position.
    fn of(points: &[Vector3<f64>], deep: &[bool]) -> Option<Self> {
        let finite = |x: &&Vector3<f64>| x.iter().all(|v| v.is_finite());
        let sure = || points.iter().zip(deep).filter(|(_, deep)| **deep).map(|(x, _)| x);
        if sure().filter(finite).count() >= LEAST_JOINTS {
            return Some(Self::around(&sure().filter(finite).collect::<Vec<_>>()));
        }
        let known: Vec<_> = points.iter().filter(finite).collect();
        (known.len() >= LEAST_JOINTS).then(|| Self::around(&known))
    }

    /// Root mean square distance of the joints from their centre, mm; `None` with fewer than three.
    pub(crate) fn spread(points: &[Vector3<f64>]) -> Option<f64> {
        Self::of(points, &[]).map(|body| body.square_spread.sqrt())
    }

    /// That of these joints, whatever their number.
    pub(crate) fn around(points: &[&Vector3<f64>]) -> Self {
        let n = points.len() as f64;
        let middle = points.iter().copied().sum::<Vector3<f64>>() / n;
        let square_spread = points.iter().map(|x| (*x - middle).norm_squared()).sum::<f64>() / n;
        Self { middle, square_spread }
    }
}

/// ρ² of a joint at `x`, at the distance `nearest` from the nearest camera.
fn square_reach(body: Option<BodyExtent>, x: &Vector3<f64>, nearest: f64) -> f64 {
    let (spread, off) = body
        .map_or((f64::INFINITY, 0.0), |body| (body.square_spread.sqrt(), (x - body.middle).norm()));
    let beyond = (off - BODY * spread).max(0.0);
    (nearest.min(spread).powi(2) + beyond * beyond).max(f64::MIN_POSITIVE)
}

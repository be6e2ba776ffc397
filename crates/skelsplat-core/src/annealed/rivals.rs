//! Other explanations of a joint, with their probabilities.
//!
//! A joint that detections reject may be where two other rays meet, or its detections may have more
//! noise than the frame's: three rays that nearly meet and one that does not, or four rays with
//! four times the noise. A place has the evidence of its rays and bones ([`super::places`]), a
//! level of the noise that of the same rays around the place that it moves to.

use nalgebra::{Matrix3, Vector3};

use super::across::FourViews;
use super::consensus::settled;
use super::equations::inverse_of;
use super::places::PlaceSearch;
use crate::bones::{Pull, other_end};

/// Places nearer to each other than this multiple of the kernel are one.
const APART: f64 = 4.0;
/// Detections that must agree on a place, besides those that reject it, for no other place to
/// matter: few rays pass through two places, so that two of them may agree on another as well.
const SURE: usize = 4;
/// Noise of one joint in multiples of the frame's, with prior probabilities: of a wrist that moves
/// fast, or of what the detector never learnt.
const LEVELS: [(f64, f64); 3] = [(2.0, 0.03), (4.0, 0.03), (8.0, 0.03)];

/// Another explanation of a joint.
pub(super) struct Rival {
    pub(super) at: Vector3<f64>,
    /// Its probability, before they are compared its logarithm.
    pub(super) share: f64,
    /// Its covariance if it is more noise; `None` for another place.
    pub(super) spread: Option<Matrix3<f64>>,
}

/// Other explanations of joint `j`, if there are detections that may be right and reject it, or few
/// besides its bone, or larger residuals than those of the others.
pub(super) fn rivals(of: &PlaceSearch<'_>, j: usize, own_noise: bool) -> Vec<Rival> {
    let (agree, seen) = (of.votes.agree[j], of.votes.seen[j]);
    let has_bone = of.bones.iter().any(|bone| bone.joints.contains(&j));
    let is_contradicted = agree < seen && agree < seen - agree + SURE;
    let may_move = is_contradicted || agree < 2 && has_bone;
    let may_be_noisier = own_noise && agree > 1 && (is_contradicted || of.solution.is_loud(j));
    if !(may_move || may_be_noisier) {
        return Vec::new();
    }
    let views = FourViews::of(of.rays.of_joint(j));
    let mut found = if may_move { elsewhere(of, j, &views) } else { Vec::new() };
    if may_be_noisier {
        let mut at = of.solution.points[j];
        found.extend(LEVELS.map(|level| noisier(of, j, &views, level, &mut at)));
    }
    let here = log_p(of, j, &views, &of.solution.points[j]);
    let most = found.iter().map(|rival| rival.share).fold(here, f64::max);
    found.iter_mut().for_each(|rival| rival.share = (rival.share - most).exp());
    let all = found.iter().map(|rival| rival.share).sum::<f64>() + (here - most).exp();
    found.iter_mut().for_each(|rival| rival.share /= all);
    found
}

/// Other places, the likeliest first, so that the order of the views does not matter.
fn elsewhere(of: &PlaceSearch<'_>, j: usize, views: &[FourViews]) -> Vec<Rival> {
    let (x, sigma) = (&of.solution.points[j], of.solution.sigma[j]);
    let is_apart = |a: &Vector3<f64>, b: &Vector3<f64>| (a - b).norm() > APART * sigma;
    let places = of.elsewhere(j, views, |end| is_firm(of, end)).into_iter();
    let places = places.filter(|y| is_apart(x, y));
    let mut weighed: Vec<Rival> =
        places.map(|at| Rival { at, share: log_p(of, j, views, &at), spread: None }).collect();
    weighed.sort_by(|a, b| b.share.total_cmp(&a.share));
    let mut found: Vec<Rival> = Vec::new();
    for place in weighed {
        if found.iter().all(|other| is_apart(&other.at, &place.at)) {
            found.push(place);
        }
    }
    found
}

/// The joint with more noise, `at` the place to which its rays then move it from that with less.
fn noisier(
    of: &PlaceSearch<'_>,
    j: usize,
    views: &[FourViews],
    (times, probability): (f64, f64),
    at: &mut Vector3<f64>,
) -> Rival {
    let sigma = times * of.solution.sigma[j];
    let prior = of.priors.map(|priors| &priors[j]);
    *at = settled(views, *at, sigma);
    let (log, information) = of.mixture.noisier(times * times).at(views, at, prior);
    let share = log - against_bones(of, j, at) + probability.ln();
    Rival { at: *at, share, spread: Some(inverse_of(&information.matrix())) }
}

fn log_p(of: &PlaceSearch<'_>, j: usize, views: &[FourViews], x: &Vector3<f64>) -> f64 {
    -of.against(j, views, x) - against_bones(of, j, x)
}

/// −log p of the bones from firm joints to joint `j` at `x`: the rivals of a doubtful end would
/// satisfy the bone elsewhere.
fn against_bones(of: &PlaceSearch<'_>, j: usize, x: &Vector3<f64>) -> f64 {
    let ends = of.bones.iter().filter_map(|bone| Some((other_end(bone.joints, j)?, bone)));
    let ends = ends.filter(|(end, _)| is_firm(of, *end));
    ends.map(|(end, bone)| Pull::new(x, &of.solution.points[end], bone.length).loss).sum()
}

fn is_firm(of: &PlaceSearch<'_>, joint: usize) -> bool {
    of.votes.agree[joint] > 1 && !of.votes.is_doubtful(joint)
}

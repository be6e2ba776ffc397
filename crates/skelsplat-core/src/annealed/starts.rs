//! The start of annealed splatting: from the detections, a prior or, for what the detections do not
//! determine, a given pose.

use nalgebra::Vector3;

use super::consensus::{NEAR_TIE, rivals};
use super::locate::{Located, locate, nearest_to_all};
use super::rays::Rays;
use super::solver::{Annealing, Prior, Solution, Widening};

/// Prior knowledge of a pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Before {
    /// The initial pose `(N)`, mm; `None` for a joint without one.
    pub pose: Vec<Option<Vector3<f64>>>,
    /// Priors `(N)`, if the pose is independent of these detections; otherwise it is only a
    /// starting point.
    pub priors: Option<Vec<Prior>>,
    /// Whether it is the pose of the previous frame: it then decides between positions with equal
    /// votes.
    pub past: bool,
}

impl Before {
    pub(super) fn priors(&self) -> Option<&[Prior]> {
        self.priors.as_deref()
    }
}

/// The start of a search.
pub(super) struct Start {
    pub(super) init: Vec<Vector3<f64>>,
    pub(super) points: Vec<Vector3<f64>>,
    pub(super) sigma: Vec<f64>,
    pub(super) widening: Widening,
}

/// Common to all assignments of left and right of one frame.
pub(super) struct Given<'a> {
    pub(super) priors: Option<&'a [Prior]>,
    pub(super) annealing: Annealing,
    /// [`super::Problem::widening`] where there are priors.
    pub(super) widening: Widening,
}

impl Given<'_> {
    pub(super) fn without_priors(annealing: Annealing) -> Self {
        Self { priors: None, annealing, widening: Widening::NONE }
    }
}

/// Kernel under which positions compete where the past decides, in multiples of the final one: two
/// views that agree somewhat less well than two others are not outvoted by them.
const PAST_KERNEL: f64 = 2.0;
/// Standard deviations of a prior that the first kernel covers.
const PRIOR_REACH: f64 = 2.0;

/// The initial pose, the start and the initial kernels.
///
/// Where two views see a joint, the detections determine its start; an initial pose without a prior
/// is used for the other joints. With a prior, the search starts there under a kernel that covers
/// its spread.
pub(super) fn start(before: Option<&Before>, rays: &Rays, given: &Given<'_>) -> Start {
    match (before, given.priors) {
        (None, _) => {
            let found = locate(rays, &given.annealing);
            let Solution { points, sigma, .. } = found.solution;
            Start { init: points.clone(), points, sigma, widening: found.widening }
        }
        (Some(before), Some(priors)) => start_at_prior(before, priors, rays, given),
        (Some(before), None) => start_beside(before, rays, &given.annealing),
    }
}

fn start_at_prior(before: &Before, priors: &[Prior], rays: &Rays, given: &Given<'_>) -> Start {
    let (n, annealing) = (priors.len(), &given.annealing);
    let is_wide = |j: usize| PRIOR_REACH * priors[j].spread > annealing.start;
    let init: Vec<_> =
        (0..n).map(|j| before.pose[j].unwrap_or_else(|| nearest_to_all(rays, j))).collect();
    let mut points = init.clone();
    if (0..n).any(is_wide) {
        // Wider than any kernel: the detections give a better start.
        let found = locate(rays, annealing).solution.points;
        for j in (0..n).filter(|j| is_wide(*j) && found[*j].x.is_finite()) {
            points[j] = found[j];
        }
    }
    Start { init, points, sigma: vec![annealing.start; n], widening: given.widening }
}

/// The start with an initial pose that is not a prior: from the detections where possible. Of two
/// positions with equal votes the past decides.
fn start_beside(before: &Before, rays: &Rays, annealing: &Annealing) -> Start {
    let Located { solution: found, widening, .. } = locate(rays, annealing);
    let init = before.pose.iter().zip(&found.points).map(|(p, x)| p.unwrap_or(*x)).collect();
    let (mut points, mut sigma) = (found.points, found.sigma);
    for (j, p) in before.pose.iter().enumerate().filter_map(|(j, p)| Some((j, (*p)?))) {
        if points[j].x.is_nan() {
            (points[j], sigma[j]) = (p, f64::INFINITY);
        }
        if !before.past {
            continue;
        }
        let wide = PAST_KERNEL * sigma[j];
        for rival in rivals(rays.of_joint(j), &points[j].clone(), wide, NEAR_TIE) {
            if (rival.at - p).norm() < (points[j] - p).norm() {
                points[j] = rival.at;
            }
        }
    }
    Start { init, points, sigma, widening }
}

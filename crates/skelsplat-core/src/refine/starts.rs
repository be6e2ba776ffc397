//! Where annealed splatting begins: at the detections, at a prior, and for what the detections leave open at a given pose.

use nalgebra::{Matrix3, Vector3};

use super::refiner::{Frame, Refiner};
use crate::annealed::consensus::{NEAR_TIE, rivals};
use crate::annealed::{Annealing, Prior, Rays, Solution, Widening};
use crate::triangulate::robust::{Located, locate, start};

/// Where a search begins.
pub(super) struct Start {
    pub(super) init: Vec<Vector3<f64>>,
    pub(super) points: Vec<Vector3<f64>>,
    pub(super) sigma: Vec<f64>,
    pub(super) widening: Widening,
}

/// What holds for all assignments of left and right of one frame.
pub(super) struct Given<'a> {
    pub(super) priors: Option<&'a [Prior]>,
    pub(super) annealing: Annealing,
    /// [`Problem::widening`] where there are priors.
    pub(super) widening: Widening,
}

/// Kernel under which places compete where the past decides, in multiples of the final one: two views that agree somewhat
/// less well than two others are not outvoted by them.
const PAST_KERNEL: f64 = 2.0;
/// Standard deviations of a prior that the first kernel covers.
const PRIOR_REACH: f64 = 2.0;

impl Refiner {
    /// The initial pose, where to begin and with which kernels, mm.
    ///
    /// Where two views see a joint the detections place it, whatever the start; a start that is no more than that places
    /// the others. A prior is where the search begins, under a kernel that covers its spread.
    pub(super) fn annealed_start(&self, frame: &Frame, rays: &Rays, given: &Given<'_>) -> Start {
        let Some(pose) = &frame.init_pose else {
            let found = locate(rays, &given.annealing);
            let Solution { points, sigma, .. } = found.solution;
            return Start { init: points.clone(), points, sigma, widening: found.widening };
        };
        let mm = self.unit.millimetres();
        let known = |p: &Vector3<f64>| p.iter().all(|v| v.is_finite()).then_some(p * mm);
        let pose: Vec<Option<Vector3<f64>>> = pose.iter().map(known).collect();
        match &frame.init_covariance {
            Some(covariances) => self.start_at_prior(&pose, covariances, rays, given),
            None => start_beside(&pose, frame.past, rays, &given.annealing),
        }
    }

    fn start_at_prior(
        &self,
        pose: &[Option<Vector3<f64>>],
        covariances: &[Matrix3<f64>],
        rays: &Rays,
        given: &Given<'_>,
    ) -> Start {
        let (n, annealing, mm) = (pose.len(), &given.annealing, self.unit.millimetres());
        let reach = |j: usize| {
            let widest = covariances[j].diagonal().max();
            if widest.is_finite() { PRIOR_REACH * mm * widest.sqrt() } else { 0.0 }
        };
        let init: Vec<_> = (0..n).map(|j| pose[j].unwrap_or_else(|| start(rays, j))).collect();
        let mut points = init.clone();
        if (0..n).any(|j| reach(j) > annealing.start) {
            // Wider than any kernel: the detections know better where to begin.
            let found = locate(rays, annealing).solution.points;
            for j in (0..n).filter(|j| reach(*j) > annealing.start && found[*j].x.is_finite()) {
                points[j] = found[j];
            }
        }
        Start { init, points, sigma: vec![annealing.start; n], widening: given.widening }
    }

    /// The precision of the initial pose, mm⁻²; none for a joint that the initial pose does not have.
    pub(super) fn priors(&self, frame: &Frame) -> Option<Vec<Prior>> {
        let (pose, covariance) = (frame.init_pose.as_ref()?, frame.init_covariance.as_ref()?);
        let mm = self.unit.millimetres();
        let prior = |(p, c): (&Vector3<f64>, &Matrix3<f64>)| match (c * (mm * mm)).cholesky() {
            Some(factor) if p.iter().all(|v| v.is_finite()) => {
                Prior { mean: p * mm, precision: factor.inverse() }
            }
            _ => Prior { mean: Vector3::zeros(), precision: Matrix3::zeros() },
        };
        Some(pose.iter().zip(covariance).map(prior).collect())
    }
}

/// Where to begin with an initial pose `(N)` that is no prior: the detections place what they can. Of two places that have
/// as many votes the `past` decides.
fn start_beside(
    pose: &[Option<Vector3<f64>>],
    past: bool,
    rays: &Rays,
    annealing: &Annealing,
) -> Start {
    let Located { solution: found, widening, .. } = locate(rays, annealing);
    let init = pose.iter().zip(&found.points).map(|(p, x)| p.unwrap_or(*x)).collect();
    let (mut points, mut sigma) = (found.points, found.sigma);
    for (j, p) in pose.iter().enumerate().filter_map(|(j, p)| Some((j, (*p)?))) {
        if points[j].x.is_nan() {
            (points[j], sigma[j]) = (p, f64::INFINITY);
        }
        if !past {
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

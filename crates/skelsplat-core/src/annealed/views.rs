//! How far the confidences of different views can be compared.
//!
//! A detector compares what it sees in one image; that another view, or another detector, says 0.9
//! where this one says 0.3 is a claim about their noise, on which the residuals have a say. With
//! the weights w_ij = c_ij (c̄_i/c̄)^(γ−1) of the detections that agree, the joints integrated out
//! and the noise at its most likely value,
//!
//! ```text
//! log p(γ) = Σ log w_ij − ½ Σ_j log det H_j − ½ f log Σ w_ij |e_ij|²
//!            − γ²/2τ² Σ_i (log c̄_i − mean)²
//! ```
//!
//! with H_j = Σ_i w_ij (I − d dᵀ), the residuals e of least squares under w, f degrees of freedom,
//! 2 per detection less 3 per joint (restricted maximum likelihood, H. D. Patterson and
//! R. Thompson, 1971), and the prior of the noise included in both. At γ = 1 views are taken at
//! their word, at 0 each view's confidences count only among themselves.

use nalgebra::Matrix3;

use super::consensus::agrees;
use super::evidence::averaged;
use super::noise::{NoiseModel, PRIOR_DOF};
use super::problem::Solution;
use super::rays::{Meeting, Ray, Rays};

/// The exponents γ.
const EXPONENTS: [f64; 3] = [1.0, 0.5, 0.0];
/// τ: usual differences of the logarithm of the noise's variance from view to view.
const USUAL: f64 = 0.7;
/// Ratio of mean confidences up to which views are taken at their word.
const ALIKE: f64 = 1.5;

/// Factors on the weights of every view; `None` where views are taken at their word.
pub fn factors(rays: &Rays, solution: &Solution) -> Option<Vec<f64>> {
    let logs: Vec<f64> = (0..rays.n_views()).map(|i| mean_weight(rays, i).ln()).collect();
    let known = || logs.iter().copied().filter(|log| log.is_finite());
    let mean = known().sum::<f64>() / known().count() as f64;
    if !known().any(|a| known().any(|b| b - a > ALIKE.ln())) {
        return None;
    }
    let squares: f64 = known().map(|log| (log - mean).powi(2)).sum();
    let of = |gamma: f64| -> Vec<f64> {
        logs.iter().map(|log| ((gamma - 1.0) * (log - mean)).exp()).collect()
    };
    let log_p = |gamma: f64| {
        let against = 0.5 * squares * (gamma / USUAL).powi(2);
        log_likelihood(&rays.weighed(&of(gamma)), solution).map(|log| log - against)
    };
    let [Some(a), Some(b), Some(c)] = EXPONENTS.map(log_p) else { return None };
    let (_, shares) = averaged([a, b, c]);
    Some(of(EXPONENTS.iter().zip(shares).map(|(gamma, share)| gamma * share).sum()))
}

/// Mean weight of the detections of view `i`.
fn mean_weight(rays: &Rays, i: usize) -> f64 {
    let weights = (0..rays.n_joints()).map(|j| rays.of_joint(j)[i].weight).filter(|w| *w > 0.0);
    let (sum, count) = weights.fold((0.0, 0.0), |(sum, count), w| (sum + w, count + 1.0));
    sum / count
}

/// log p of the detections that agree with the solution, whatever their noise and the joints are;
/// `None` if three views agree on no joint, since two rays do not tell which is noisier.
fn log_likelihood(rays: &Rays, solution: &Solution) -> Option<f64> {
    let prior = rays.mean_weight() * (NoiseModel::PRIOR_PX * solution.pixel).powi(2);
    let (mut log, mut squares, mut freedom) = (0.0, PRIOR_DOF * prior, PRIOR_DOF);
    for (j, x) in solution.points.iter().enumerate() {
        let agreeing = |ray: &&Ray| ray.is_there() && agrees(ray, x, solution.sigma[j]);
        let agreeing = || rays.of_joint(j).iter().filter(agreeing);
        if agreeing().count() < 3 {
            continue;
        }
        let mut meeting = Meeting::default();
        agreeing().for_each(|ray| meeting.add(ray, ray.weight));
        let Some((x, _)) = meeting.point() else { continue };
        let mut information = Matrix3::zeros();
        for ray in agreeing() {
            log += ray.weight.ln();
            squares += ray.weight * ray.offset(&x).across.norm_squared();
            information += ray.information() * ray.weight;
            freedom += 2.0;
        }
        freedom -= 3.0;
        log -= 0.5 * information.determinant().ln();
    }
    (freedom > PRIOR_DOF).then(|| log - 0.5 * freedom * squares.ln())
}

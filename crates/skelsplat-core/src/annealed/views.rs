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

use std::f64::consts::LN_2;

use super::consensus::agrees;
use super::evidence::averaged;
use super::noise::{NoiseModel, PRIOR_DOF};
use super::problem::Solution;
use super::rays::{Meeting, Ray, Rays};

/// The exponents γ.
const EXPONENTS: [f64; 3] = [1.0, 0.5, 0.0];
/// Ratio of mean confidences up to which views are taken at their word.
const ALIKE: f64 = 1.5;

/// Factors on the weights of every view; `None` where views are taken at their word.
pub fn factors(rays: &Rays, solution: &Solution) -> Option<Vec<f64>> {
    // The weights of every view added up, and their number.
    let mut totals = vec![[0.0; 2]; rays.n_views()];
    for j in 0..rays.n_joints() {
        for (total, ray) in totals.iter_mut().zip(rays.of_joint(j)) {
            *total = [total[0] + ray.weight, total[1] + f64::from(ray.is_there())];
        }
    }
    let logs = totals.iter().map(|[sum, count]| (sum / count).ln());
    let known = || logs.clone().filter(|log| log.is_finite());
    let mean = known().sum::<f64>() / known().count() as f64;
    let agreeing = agreeing(rays, solution);
    if agreeing.is_empty() || !known().any(|a| known().any(|b| b - a > ALIKE.ln())) {
        return None;
    }
    let squares: f64 = known().map(|log| (log - mean).powi(2)).sum();
    let of = |gamma: f64| logs.clone().map(move |log| (gamma - 1.0) * (log - mean));
    let log_p = |gamma: f64| {
        let factors: Vec<[f64; 2]> = of(gamma).map(|log| [log, log.exp()]).collect();
        let all = totals.iter().zip(&factors).filter(|([_, count], _)| *count > 0.0);
        let [weight, count] = all.fold([0.0; 2], |[weight, count], ([w, n], [_, factor])| {
            [weight + w * factor, count + n]
        });
        let prior = weight / count * (NoiseModel::PRIOR_PX * solution.pixel).powi(2);
        // From view to view the noise's variance usually differs by a doubling, as in recordings.
        log_likelihood(&agreeing, &factors, prior) - 0.5 * squares * (gamma / LN_2).powi(2)
    };
    let (_, shares) = averaged(EXPONENTS.map(log_p));
    let gamma = EXPONENTS.iter().zip(shares).map(|(gamma, share)| gamma * share).sum();
    Some(of(gamma).map(f64::exp).collect())
}

/// Joint, view and ray of the detections that agree with the solution, of joints on which three
/// views agree: two rays do not tell which is noisier.
fn agreeing<'a>(rays: &'a Rays, solution: &Solution) -> Vec<(usize, usize, &'a Ray)> {
    let mut found = Vec::with_capacity(rays.n_joints() * rays.n_views());
    for (j, x) in solution.points.iter().enumerate() {
        let before = found.len();
        let seen = rays.of_joint(j).iter().enumerate().filter(|(_, ray)| ray.is_there());
        let agreeing = seen.filter(|(_, ray)| agrees(ray, x, solution.sigma[j]));
        found.extend(agreeing.map(|(i, ray)| (j, i, ray)));
        if found.len() < before + 3 {
            found.truncate(before);
        }
    }
    found
}

/// log p of these detections, whatever their noise and the joints are, up to a constant; `factors`
/// on the weights of the views, each after its logarithm.
fn log_likelihood(agreeing: &[(usize, usize, &Ray)], factors: &[[f64; 2]], prior: f64) -> f64 {
    let (mut log, mut squares, mut freedom) = (0.0, PRIOR_DOF * prior, PRIOR_DOF);
    for rays in agreeing.chunk_by(|a, b| a.0 == b.0) {
        let mut meeting = Meeting::default();
        rays.iter().for_each(|(_, i, ray)| meeting.add(ray, ray.weight * factors[*i][1]));
        let Some(x) = meeting.point() else { continue };
        for (_, i, ray) in rays {
            log += factors[*i][0];
            squares += ray.weight * factors[*i][1] * ray.offset(&x).across.norm_squared();
        }
        freedom += 2.0 * rays.len() as f64 - 3.0;
        log -= 0.5 * meeting.determinant().ln();
    }
    log - 0.5 * freedom * squares.ln()
}

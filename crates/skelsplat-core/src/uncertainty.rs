//! The posterior covariance of a pose: what a user can call an error bar.
//!
//! Σ_post = (Σ_i c k (I − d dᵀ)/ŝ_j² + Π + I/ρ² + symmetry)⁻¹ at the solution. ŝ_j² is the frame's noise, corrected by the
//! joint's own residuals as a scaled inverse χ²: a joint whose views disagree has a wider bar. Along a ray that nothing
//! crosses only ρ speaks: the joint belongs to a body, whose joints lie ρ (root mean square) from its middle, and in front
//! of the camera.

use nalgebra::{Matrix3, Vector3};

use crate::annealed::{Problem, Solution};

/// Degrees of freedom that the frame's noise is worth for one joint (measured, docs/decisions.md).
const SHARED_DOF: f64 = 5.0;
/// Share of the residuals' variance that is noise; the rest are wrong detections that the kernel lets through
/// (measured, docs/decisions.md).
const NOISE_SHARE: f64 = 0.87;

/// Views whose weights have to place a joint before the length of its limb says something of it.
const PLACED: f64 = 1.5;

/// Posterior covariances `(N)` in mm²; NaN for a joint of which nothing is known.
#[must_use]
pub fn posterior(problem: &Problem<'_>, solution: &mut Solution) -> Vec<Matrix3<f64>> {
    let shared = solution.variance;
    let spread = spread(&solution.points);
    for (j, x) in solution.points.iter().enumerate() {
        let residuals = &solution.residuals[j];
        let variance = NOISE_SHARE * (SHARED_DOF * shared + residuals.squares)
            / (SHARED_DOF + residuals.freedom);
        let mut block = Matrix3::zeros();
        let mut nearest = f64::INFINITY;
        for ray in problem.rays.of_joint(j).iter().filter(|ray| ray.is_there()) {
            let offset = ray.offset(x);
            let w = ray.weight * offset.weight(solution.sigma[j]);
            block += ray.information() * (w / variance);
            nearest = nearest.min(offset.range.abs());
        }
        if nearest.is_finite() {
            block += Matrix3::from_diagonal_element(nearest.min(spread).powi(-2));
        }
        if let Some(priors) = problem.priors {
            block += priors[j].precision;
        }
        solution.equations.set_block(j, block);
    }
    // Equal limbs leave two places on the ray of a joint that one view sees: that is no normal distribution.
    let residuals = &solution.residuals;
    solution
        .equations
        .retain_couplings(|joints| joints.iter().all(|j| residuals[*j].support >= PLACED));
    solution.equations.factorise(|_| 0.0);
    let known = |m: Matrix3<f64>| if m.trace() > 0.0 { m } else { Matrix3::repeat(f64::NAN) };
    (0..solution.points.len()).map(|j| known(solution.equations.covariance(j))).collect()
}

/// Root mean square distance of the joints from their mean, mm; infinite for fewer than three joints.
fn spread(points: &[Vector3<f64>]) -> f64 {
    let known = || points.iter().filter(|x| x.iter().all(|v| v.is_finite()));
    let n = known().count();
    if n < 3 {
        return f64::INFINITY;
    }
    let mean = known().sum::<Vector3<f64>>() / n as f64;
    (known().map(|x| (x - mean).norm_squared()).sum::<f64>() / n as f64).sqrt()
}

//! The posterior covariance of a pose: what a user can call an error bar.
//!
//! Σ_post = (Σ_i c k (I − d dᵀ)/ŝ_j² + Π + symmetry)⁻¹ at the solution. ŝ_j² is the frame's noise, corrected by the joint's
//! own residuals as a scaled inverse χ² of a few degrees of freedom: a joint whose views disagree has a wider bar.
//! Along a ray that nothing else crosses the joint is anywhere up to twice as far from the camera: that is the
//! prior 1/range².

use nalgebra::Matrix3;

use crate::annealed::{Problem, Solution};

/// Degrees of freedom that the frame's noise is worth for one joint.
const SHARED_DOF: f64 = 4.0;

/// Posterior covariances `(N)` in mm²; NaN for a joint that has no position.
#[must_use]
pub fn posterior(problem: &Problem<'_>, solution: &mut Solution) -> Vec<Matrix3<f64>> {
    let shared = solution.noise * solution.noise;
    for (j, x) in solution.points.iter().enumerate() {
        let residuals = &solution.residuals[j];
        let variance =
            (SHARED_DOF * shared + residuals.squares) / (SHARED_DOF + residuals.freedom);
        let mut block = Matrix3::zeros();
        let mut nearest = f64::INFINITY;
        for ray in problem.rays.of_joint(j).iter().filter(|ray| ray.is_there()) {
            let offset = ray.offset(x);
            let w = ray.weight * offset.weight(solution.sigma[j]);
            block += ray.information() * (w / variance);
            nearest = nearest.min(offset.range.abs());
        }
        if let Some(priors) = problem.priors {
            block += priors[j].precision;
        }
        if nearest.is_finite() {
            block += Matrix3::from_diagonal_element(nearest.powi(-2));
        }
        solution.equations.set_block(j, block);
    }
    solution.equations.factorise(|_| 0.0);
    let unknown = |m: Matrix3<f64>| if m.trace() > 0.0 { m } else { Matrix3::repeat(f64::NAN) };
    (0..solution.points.len()).map(|j| unknown(solution.equations.covariance(j))).collect()
}

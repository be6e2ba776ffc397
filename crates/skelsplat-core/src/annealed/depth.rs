//! Whether the rays of a joint determine its depth.
//!
//! Cameras close together see a joint along nearly the same ray: a point at infinity fits them as
//! well as any nearer one. The residual |e| in mm does not show this, since it shrinks towards the
//! cameras; angles do. With a the noise of a ray's direction (the detection noise in pixels times
//! the angle of a pixel) the rays prefer x to infinity by
//!
//! ```text
//! Δχ² = Σ_i c k |d_i − u|²/a_i² − Σ_i c k (|e_i|/r_i)²/a_i²          u ∝ Σ_i c k d_i/a_i²
//! ```
//!
//! with the range r. Two rays at the angle φ give Δχ² = φ²/2a², and a standard deviation of the
//! depth of r/√Δχ².

use nalgebra::Vector3;

use super::noise::NoiseModel;
use super::problem::Solution;
use super::rays::Ray;

/// Five standard deviations, squared. Of a depth: it is known to a fifth of its value, and twice
/// the usual noise is not mistaken for it.
pub(crate) const DISTINCT: f64 = 25.0;

/// Δχ² of `rays` at `x`, of which ray i counts `k(i)` times; `variance` is that of a detection of
/// weight 1, px². Σ w |d − u|² = 2 (Σ w − |Σ w d|), since u is a unit vector along Σ w d.
fn over_infinity(rays: &[Ray], x: &Vector3<f64>, variance: f64, k: impl Fn(usize) -> f64) -> f64 {
    let (mut weight, mut along, mut at_x) = (0.0, Vector3::zeros(), 0.0);
    for (i, ray) in rays.iter().enumerate().filter(|(_, ray)| ray.is_there()) {
        let w = ray.weight * k(i) / (variance * ray.pixel * ray.pixel);
        if w > 0.0 {
            let from = x - ray.centre;
            weight += w;
            along += w * ray.direction;
            at_x += w * ray.offset(x).across.norm_squared() / from.norm_squared();
        }
    }
    2.0 * (weight - along.norm()) - at_x
}

/// Whether the rays that agree on `x` under a kernel of standard deviation `sigma` (infinite: all
/// rays) determine its depth, assuming the usual detection noise. If not, the joint gets no
/// position.
pub fn may_be_fixed(rays: &[Ray], x: &Vector3<f64>, sigma: f64) -> bool {
    let k = |ray: &Ray| if sigma.is_finite() { ray.offset(x).weight(sigma) } else { 1.0 };
    over_infinity(rays, x, NoiseModel::PRIOR_PX.powi(2), |i| k(&rays[i]) / rays[i].weight)
        >= DISTINCT
}

/// Whether the rays of joint `j`, with weights `k`, determine its depth at the solution, given the
/// frame's noise.
pub fn is_fixed(rays: &[Ray], j: usize, solution: &Solution, k: &[f64]) -> bool {
    let least =
        NoiseModel::PRIOR_PX.powi(2) * solution.variance / (solution.noise * solution.noise);
    let variance = (solution.variance / (solution.pixel * solution.pixel)).max(least);
    over_infinity(rays, &solution.points[j], variance, |i| k[i]) >= DISTINCT
}

/// Whether rays with weights `k` determine the depth of `x`; `variance` is that of a detection of
/// weight 1, px², and `weight` the mean weight of a detection. The noise is taken to be at least
/// the usual one.
pub fn determine(
    rays: &[Ray],
    x: &Vector3<f64>,
    variance: f64,
    weight: f64,
    k: impl Fn(usize) -> f64,
) -> bool {
    over_infinity(rays, x, variance.max(NoiseModel::PRIOR_PX.powi(2) * weight), k) >= DISTINCT
}

/// Whether two rays are far enough from parallel to determine the depth of their meeting point.
pub fn have_parallax(a: &Ray, b: &Ray) -> bool {
    let noise = NoiseModel::PRIOR_PX * (a.pixel + b.pixel) / 2.0;
    (a.direction - b.direction).norm_squared() >= 2.0 * DISTINCT * noise * noise
}

//! `OpenCV`'s fisheye: `θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)` with θ = atan r.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix2, Vector2};

use super::fold;

/// Below this r² the series of atan(r)/r takes over: closed form and series then both hold to
/// 1e-13.
const SERIES_BELOW: f64 = 1e-3;

/// The equidistant polynomial of `cv::fisheye`, for rays in front of the camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Fisheye {
    k: [f64; 4],
    theta_max: f64,
}

impl Fisheye {
    /// From finite k1..k4.
    pub(super) fn new(k: [f64; 4]) -> Self {
        let slope = [1.0, 3.0 * k[0], 5.0 * k[1], 7.0 * k[2], 9.0 * k[3]];
        let theta_max =
            fold::first_sign_change(&slope, FRAC_PI_2 * FRAC_PI_2).map_or(FRAC_PI_2, f64::sqrt);
        Self { k, theta_max }
    }

    /// k1..k4.
    pub fn coefficients(&self) -> [f64; 4] {
        self.k
    }

    /// `θ_d/θ` and its derivative, both as functions of θ².
    fn polynomial(&self, t: f64) -> (f64, f64) {
        let [k1, k2, k3, k4] = self.k;
        let value = 1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4)));
        let slope = k1 + t * (2.0 * k2 + t * (3.0 * k3 + t * 4.0 * k4));
        (value, slope)
    }

    /// x' = s(q) x with q = r², so the Jacobian is s I + 2 s'(q) x xᵀ.
    pub(super) fn distort_with_jacobian(&self, x: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let q = x.norm_squared();
        let (a, da) = atan_ratio(q);
        let (p, dp) = self.polynomial(q * a * a);
        // d θ² / d q = a / (1 + q)
        let slope = dp * a * a / (1.0 + q) + p * da;
        let jacobian = Matrix2::identity() * (p * a) + x * x.transpose() * (2.0 * slope);
        (x * (p * a), jacobian)
    }

    /// Inverse of [`Fisheye::distort_with_jacobian`]; `None` beyond the fold or at 90° and more.
    pub(super) fn undistort(&self, y: &Vector2<f64>) -> Option<Vector2<f64>> {
        let rd = y.norm();
        if rd == 0.0 {
            return Some(*y);
        }
        let theta_d = |t: f64| {
            let (p, dp) = self.polynomial(t * t);
            (t * p, p + 2.0 * t * t * dp)
        };
        let theta = fold::invert_rising(theta_d, self.theta_max, rd)?;
        (theta < FRAC_PI_2).then(|| y * (theta.tan() / rd))
    }
}

/// atan(r)/r and its derivative by q = r².
fn atan_ratio(q: f64) -> (f64, f64) {
    if q > SERIES_BELOW {
        let a = q.sqrt().atan() / q.sqrt();
        return (a, (1.0 / (1.0 + q) - a) / (2.0 * q));
    }
    let a = 1.0 - q * (1.0 / 3.0 - q * (1.0 / 5.0 - q * (1.0 / 7.0 - q / 9.0)));
    let da = -1.0 / 3.0 + q * (2.0 / 5.0 - q * (3.0 / 7.0 - q * (4.0 / 9.0 - q * 5.0 / 11.0)));
    (a, da)
}

//! What is known of cameras beforehand.

use nalgebra::{DMatrix, DVector};

use super::placed::{RADIAL, ZOOM};

/// Standard deviation of the prior of a turn, rad.
const PRIOR_TURN: f64 = 0.35;
/// That of a shift, relative to the distance of the joints.
const PRIOR_SHIFT: f64 = 0.25;
/// That of a clock, frames.
const PRIOR_CLOCK: f64 = 30.0;
/// That of k₁: lenses of 60 to 90° have −0.3 to 0.1.
const PRIOR_RADIAL: f64 = 0.15;

/// What is known of focal lengths beforehand.
#[derive(Debug, Clone, PartialEq)]
pub struct Lenses {
    /// Standard deviation of the logarithm of a focal length,
    pub(super) sigma: f64,
    /// and how those of cameras are correlated, of one kind or make; `None`: not at all. Radial
    /// coefficients are alike, too.
    alike: Option<DMatrix<f64>>,
}

/// Of cameras with a calibration: another zoom.
pub static CALIBRATED: Lenses = Lenses { sigma: 0.1, alike: None };

impl Lenses {
    /// Of cameras that are unknown, with this covariance of the logarithms.
    pub fn unknown(covariance: &DMatrix<f64>) -> Self {
        let variance = covariance[(0, 0)];
        Self { sigma: variance.sqrt(), alike: Some(covariance / variance) }
    }

    /// Precision of the prior of unknowns, camera and parameter, in units of the noise of a
    /// detection; `reach` is how far each camera is from the joints.
    pub fn precision(&self, free: &[(usize, usize)], noise: f64, reach: &[f64]) -> DMatrix<f64> {
        let even = |(i, k): &(usize, usize)| (noise / self.sigma_of(*k, reach[*i])).powi(2);
        let mut prior =
            DMatrix::from_diagonal(&DVector::from_iterator(free.len(), free.iter().map(even)));
        let Some(alike) = &self.alike else { return prior };
        for lens in [ZOOM, RADIAL] {
            let own: Vec<usize> = (0..free.len()).filter(|q| free[*q].1 == lens).collect();
            let of = |a: usize| free[own[a]].0;
            let own_alike = DMatrix::from_fn(own.len(), own.len(), |a, b| alike[(of(a), of(b))]);
            let Some(factor) = own_alike.cholesky() else { continue };
            let precision = factor.inverse();
            for (a, b) in (0..own.len()).flat_map(|a| (0..own.len()).map(move |b| (a, b))) {
                prior[(own[a], own[b])] = precision[(a, b)] * even(&free[own[a]]);
            }
        }
        prior
    }

    /// Standard deviation of the prior of a parameter of a camera at this distance.
    pub fn sigma_of(&self, k: usize, reach: f64) -> f64 {
        match k {
            0..3 => PRIOR_TURN,
            3..6 => PRIOR_SHIFT * reach,
            ZOOM => self.sigma,
            RADIAL => PRIOR_RADIAL,
            _ => PRIOR_CLOCK,
        }
    }
}

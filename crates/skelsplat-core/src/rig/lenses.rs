//! Lenses that are given, or said to be the same, and may be wrong: how likely that is, and what it
//! would change.

use nalgebra::DVector;

use super::gauge::{SharedZoom, Sureness};

/// The probability that the lens of one camera, or of all, is not the one that was given,
const WRONG_LENS: f64 = 0.05;
/// and the standard deviation of the logarithm of its focal length if it is, and if it is not:
/// another zoom, and another focus.
const OTHER_LENS: [f64; 2] = [0.1, 0.01];

/// Odds that a lens is wrong.
fn wrong_lens(shared: &SharedZoom) -> f64 {
    let density = |sigma: f64| {
        let all = shared.variance + sigma.powi(2);
        (-0.5 * shared.zoom.powi(2) / all).exp() / all.sqrt()
    };
    WRONG_LENS * density(OTHER_LENS[0]) / density(OTHER_LENS[1])
}

/// Focal lengths that may be wrong.
pub(super) struct OtherLens {
    /// Odds of this against all being right.
    odds: f64,
    /// Of which cameras.
    which: DVector<f64>,
    shared: SharedZoom,
}

impl OtherLens {
    /// Of so large a `part` of all ways to be wrong.
    pub(super) fn new(part: f64, which: DVector<f64>, shared: SharedZoom) -> Self {
        Self { odds: part * wrong_lens(&shared), which, shared }
    }

    /// Mean square of the logarithm of the zoom if this is so, z² + v of its posterior.
    fn square(&self) -> f64 {
        let prior = OTHER_LENS[0].powi(2);
        let held = prior / (prior + self.shared.variance);
        (held * self.shared.zoom).powi(2) + held * self.shared.variance
    }
}

/// Adds to the errors of a rig what other lenses would change, by their probabilities p: it is off
/// by b z with the mean square p (z² + v) b bᵀ.
pub(super) fn widen(known: &mut Sureness, lenses: &[OtherLens]) {
    let any: f64 = 1.0 + lenses.iter().map(|lens| lens.odds).sum::<f64>();
    for lens in lenses {
        known.widen(&lens.shared.by, lens.odds / any * lens.square());
    }
}

/// By which factors the focal lengths of the likeliest of these differ, if it is likelier than
/// none.
pub(super) fn zooms(lenses: &[OtherLens], m: usize) -> Vec<f64> {
    let likely = lenses.iter().filter(|lens| lens.odds > 1.0);
    match likely.max_by(|a, b| a.odds.total_cmp(&b.odds)) {
        Some(OtherLens { which, shared, .. }) => {
            which.iter().map(|u| (u * shared.zoom).exp()).collect()
        }
        None => vec![1.0; m],
    }
}

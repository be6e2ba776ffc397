//! How large the body of a recording is.
//!
//! A person's kernels, noise and floors, in mm, are wrong for a rat, a hand or a horse. So a
//! recording is solved in a unit in which its body has about a person's size, and everything in mm
//! is that of such a body. The size is a power of two, so that noise does not decide it, and that
//! of a body that may be a person's is 1.

use crate::annealed::posterior::BodyExtent;
use crate::annealed::rays::nearest;
use crate::bones::population::{Proportion, STATURE};
use crate::error::Result;
use crate::refine::{Frame, Refiner};
use crate::statistics::median;
use nalgebra::Vector3;

/// The spread where nothing is known, mm.
pub(super) const USUAL_SPREAD: f64 = 500.0;
/// Frames that are looked at, evenly spread.
const FRAMES: usize = 25;

/// The body's size in multiples of a person's, from the least-squares positions of some frames; NaN
/// where these show none.
///
/// # Errors
/// [`crate::Error::InvalidInput`] if views or joints do not match.
pub(super) fn body_size<'a>(refiner: &Refiner, stretches: &[&'a [Frame]]) -> Result<f64> {
    let all: Vec<&'a Frame> = stretches.iter().copied().flatten().collect();
    let mut sizes = Vec::new();
    for frame in all.iter().step_by(all.len().div_ceil(FRAMES).max(1)) {
        let rays = refiner.rays(&frame.detections)?;
        let at = |j: usize| {
            let found = nearest(rays.of_joint(j), |ray| f64::from(ray.is_there()));
            found.unwrap_or_else(|| Vector3::repeat(f64::NAN))
        };
        let points: Vec<_> = (0..rays.n_joints()).map(at).collect();
        sizes.extend(shown_sizes(&refiner.expected.proportions, &points));
    }
    Ok(median(sizes).log2().trunc().exp2())
}

/// A body's sizes in multiples of a person's that a pose shows: by each bone of known
/// `proportions`, or, if there are none, by the spread of the joints.
pub(crate) fn shown_sizes(proportions: &[Proportion], pose: &[Vector3<f64>]) -> Vec<f64> {
    if proportions.is_empty() {
        return BodyExtent::spread(pose).map(|spread| spread / USUAL_SPREAD).into_iter().collect();
    }
    let sizes = proportions.iter().map(|bone| bone.stature(pose) / STATURE[0]);
    sizes.filter(|size| size.is_finite()).collect()
}

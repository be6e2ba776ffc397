//! How large the body of a recording is.
//!
//! A person's kernels, noise and floors, in mm, are wrong for a rat, a hand or a horse. So a
//! recording is solved in a unit in which its body has about a person's size, and everything in mm
//! is that of such a body. The size is a power of two, so that noise does not decide it, and that
//! of a body that may be a person's is 1.

use crate::annealed::posterior::BodyExtent;
use crate::annealed::rays::nearest_with_spread;
use crate::bones::population::STATURE;
use crate::error::Result;
use crate::refine::{Frame, Refiner};
use crate::statistics::median;
use nalgebra::Vector3;

/// Least spread of a body in multiples of the noise.
pub(super) const LEAST_SPREAD: f64 = 2.0;
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
            let found = nearest_with_spread(rays.of_joint(j), |ray| f64::from(ray.is_there()));
            found.map_or(Vector3::repeat(f64::NAN), |(x, _)| x)
        };
        let points: Vec<_> = (0..rays.n_joints()).map(at).collect();
        let proportions = &refiner.expected.proportions;
        match proportions.is_empty() {
            true => sizes.extend(BodyExtent::spread(&points).map(|s| s / USUAL_SPREAD)),
            false => {
                let of_bone = proportions.iter().map(|bone| bone.stature(&points) / STATURE[0]);
                sizes.extend(of_bone.filter(|size| size.is_finite()));
            }
        }
    }
    Ok(median(sizes).log2().trunc().exp2())
}

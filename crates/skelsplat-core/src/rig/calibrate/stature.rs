//! The stature of a person in a rig without a scale.

use nalgebra::Vector3;

use crate::bones::expected::{Shown, stature};
use crate::bones::population::{Proportion, STATURE, proportions};
use crate::layout::Layout;
use crate::statistics::median;

/// Stature by the population's proportions, and its standard error. Lengths are compared at the
/// size of people, whatever their scale.
pub(super) fn stature_of(points: &[Vector3<f64>], layout: &Layout) -> [f64; 2] {
    let proportions = proportions(layout);
    let limb = |pose: &[Vector3<f64>], [a, b]: [usize; 2]| (pose[a] - pose[b]).norm();
    let length = |p: &Proportion| {
        let each = points.chunks(layout.n_joints()).map(|pose| limb(pose, p.joints));
        median(each.filter(|length| length.is_finite()))
    };
    let rough = median(
        proportions.iter().map(|p| length(p) / p.ratio).filter(|stature| stature.is_finite()),
    );
    let scale = STATURE[0] / rough;
    let shown = |proportion: &Proportion| {
        let length = scale * length(proportion);
        let shown = Shown { proportion: *proportion, length, variance: 0.0 };
        length.is_finite().then_some(shown)
    };
    stature(proportions.iter().filter_map(shown)).map(|mm| mm / scale)
}

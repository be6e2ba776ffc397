//! A person whom one view detects twice, or in parts.

use nalgebra::Vector3;

use super::births::Free;
use super::body::Claims;
use super::crowd::Crowd;
use super::known::BodyModel;
use super::score::at_body;

/// Score from which a figure at a body that has one already is the same person again.
const AGAIN: f64 = 0.5;
/// Share of its joints that such a figure may have in common with the first, if it is another part
/// of the body.
const PART: f64 = 0.3;

/// Figures at a body that has one in the same view: another part of the person, or the person
/// detected twice.
pub(super) fn absorb(
    crowd: &Crowd,
    pose: &[Vector3<f64>],
    claims: &mut Claims,
    free: &mut Free,
    known: &BodyModel,
) {
    for (i, claim) in claims.iter_mut().enumerate() {
        let Some(first) = claim[0] else { continue };
        for (slot, figure) in crowd.views[i].iter().enumerate() {
            if !free[i][slot] || at_body(figure, pose, known.sigma, &known.mirror) < AGAIN {
                continue;
            }
            free[i][slot] = false;
            let rays = figure.rays.iter().zip(&crowd.views[i][first].rays);
            let common = rays.filter(|(a, b)| a.is_there() && b.is_there()).count();
            if claim[1].is_none() && (common as f64) <= PART * figure.joints as f64 {
                claim[1] = Some(slot);
            }
        }
    }
}

//! Scalar residuals that couple joints: limbs of equal length, and bones.
//!
//! With H = D + G Λ Gᵀ and the multipliers λ of the couplings, the step is D⁻¹(b − G λ) where λ =
//! (Λ⁻¹ + Gᵀ D⁻¹ G)⁻¹ (r + Gᵀ D⁻¹ b).

use nalgebra::{Cholesky, DMatrix, DMatrixViewMut, Vector3};

use super::equations::{Coupling, RIDGE};
use super::joints::Joints;
use super::lanes::{LANES, exp_of_one, lane, set_lane};
use crate::bones::{Bone, Pull, REACH};
use crate::matrix3::Symmetric;
use crate::symmetry::LimbPair;

/// A coupling during a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Link {
    pub(super) coupling: Coupling,
    /// Where its joints are.
    slots: [usize; 4],
    /// Where they are as bits, modulo 64.
    reach: u64,
    /// D⁻¹ ∂r/∂x.
    moves: [Vector3<f64>; 4],
}

/// The coupling of a pair of limbs at these positions; `None` if they have none or it has faded:
/// its kernel reaches half as far as that of bones, as two limbs differ.
pub(super) fn of_pair(
    pair: &LimbPair,
    sigma: f64,
    at: impl Fn(usize) -> Vector3<f64>,
) -> Option<Coupling> {
    let ([l1, l2], [r1, r2]) = *pair;
    let (left, right) = (at(l1) - at(l2), at(r1) - at(r2));
    let (ll, lr) = (left.norm(), right.norm());
    if !(ll > 0.0 && lr > 0.0) {
        return None;
    }
    let (residual, el, er) = (ll - lr, left / ll, right / lr);
    let kept = exp_of_one(-0.5 * (residual / (0.5 * REACH * sigma)).powi(2));
    let precision = kept / (sigma * sigma);
    (kept > f64::EPSILON).then_some(Coupling {
        joints: [l1, l2, r1, r2],
        gradient: [el, -el, -er, er],
        residual,
        precision,
        length: if residual > 0.0 { ll } else { lr },
    })
}

/// The coupling of a bone at these positions.
pub(super) fn of_bone(bone: &Bone, at: impl Fn(usize) -> Vector3<f64>) -> Option<Coupling> {
    let [a, b] = bone.joints;
    let (from, to) = (at(a), at(b));
    let pull = Pull::new(&from, &to, bone.length);
    let none = Vector3::zeros();
    (pull.stiffness > f64::EPSILON).then(|| Coupling {
        joints: [a, b, a, b],
        gradient: [pull.along, -pull.along, none, none],
        residual: pull.slope / pull.stiffness,
        precision: pull.stiffness,
        length: (from - to).norm(),
    })
}

impl Link {
    /// The coupling, bent into the blocks of `joints`.
    pub(super) fn new(coupling: Coupling, joints: &mut Joints) -> Self {
        if let Some((ends, bent)) = coupling.bend() {
            for j in ends {
                let (g, l) = joints.place_of(j);
                for (a, v) in joints.groups[g].block.0.iter_mut().zip(Symmetric::of(&bent).0) {
                    set_lane(a, l, lane(a, l) + v);
                }
            }
        }
        let (slots, moves) = (coupling.joints.map(|j| joints.slot[j]), [Vector3::zeros(); 4]);
        let reach = slots.iter().fold(0, |all, s| all | 1 << (s % 64));
        Self { coupling, slots, reach, moves }
    }

    /// Takes D⁻¹ of `joints`.
    fn prepare(&mut self, joints: &Joints) {
        let ends = self.slots.iter().zip(&self.coupling.gradient);
        for ((s, gradient), moves) in ends.zip(&mut self.moves) {
            let inverse = &joints.groups[s / LANES].inverse.0;
            let inverse = Symmetric(std::array::from_fn(|a| lane(&inverse[a], s % LANES)));
            *moves = inverse.times(&(*gradient).into()).into();
        }
    }

    /// ∂rᵀ v, with v of the joint in each slot.
    pub(super) fn along(&self, v: impl Fn(usize) -> Vector3<f64>) -> f64 {
        self.slots.iter().zip(&self.coupling.gradient).map(|(s, g)| g.dot(&v(*s))).sum()
    }
}

/// Scratch space of [`couple`].
#[derive(Debug, Clone, Default)]
pub(super) struct Scratch {
    q: Vec<f64>,
    multipliers: Vec<f64>,
    /// D⁻¹ ∂r/∂x of one coupling in each slot.
    moved: Vec<Vector3<f64>>,
}

/// The steps of all joints, from those without couplings.
pub(super) fn couple(links: &mut [Link], joints: &mut Joints, scratch: &mut Scratch) {
    let (n, Scratch { q, multipliers, moved }) = (links.len(), scratch);
    links.iter_mut().for_each(|link| link.prepare(joints));
    q.clear();
    q.resize(n * n, 0.0);
    multipliers.clear();
    moved.resize(joints.n_joints, Vector3::zeros());
    for (b, link) in links.iter().enumerate() {
        link.slots.iter().zip(&link.moves).for_each(|(s, v)| moved[*s] += v);
        for (a, other) in links.iter().enumerate().skip(b) {
            if other.reach & link.reach != 0 {
                q[n * b + a] = other.along(|s| moved[s]);
            }
        }
        link.slots.iter().for_each(|s| moved[*s] = Vector3::zeros());
        q[(n + 1) * b] = RIDGE * (q[(n + 1) * b] + 1.0 / link.coupling.precision);
        multipliers.push(link.coupling.residual + link.along(|s| joints.step(s)));
    }
    let Some(factor) = Cholesky::new(DMatrix::from_vec(n, n, std::mem::take(q))) else { return };
    factor.solve_mut(&mut DMatrixViewMut::from_slice(multipliers, n, 1));
    *q = factor.unpack_dirty().data.into();
    for (link, by) in links.iter().zip(multipliers) {
        for (s, moves) in link.slots.iter().zip(&link.moves) {
            for (step, moves) in joints.groups[s / LANES].step.iter_mut().zip(moves.iter()) {
                let v = lane(step, s % LANES);
                set_lane(step, s % LANES, v - moves * *by);
            }
        }
    }
}

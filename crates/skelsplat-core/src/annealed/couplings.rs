//! Scalar residuals that couple joints: limbs of equal length, and bones.
//!
//! With H = D + G Λ Gᵀ and the multipliers λ of the couplings, the step is D⁻¹(b − G λ) where λ =
//! (Λ⁻¹ + Gᵀ D⁻¹ G)⁻¹ (r + Gᵀ D⁻¹ b).

use nalgebra::{Cholesky, DMatrix, DMatrixViewMut, Vector3};

use super::equations::{Coupling, RIDGE};
use super::joints::Joints;
use super::lanes::{LANES, lane, set_lane};
use crate::bones::{Bone, Pull};
use crate::matrix3::Symmetric;
use crate::symmetry::LimbPair;

/// Reach of the kernel of limb pairs, in σ_sym: pairs that differ by more lose their influence like
/// outlying detections.
const SYMMETRY_REACH: f64 = 3.0;
/// Precision relative to that of σ_sym, or of 1 mm for a bone, below which a coupling is left out.
const LEAST: f64 = 1e-12;

/// A coupling during a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Link {
    pub(super) coupling: Coupling,
    /// Where its joints are.
    slots: [usize; 4],
    /// D⁻¹ ∂r/∂x.
    moves: [Vector3<f64>; 4],
}

/// The coupling of a pair of limbs at these positions; `None` if they have none or it has faded.
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
    let kept = (-0.5 * (residual / (SYMMETRY_REACH * sigma)).powi(2)).exp();
    let precision = kept / (sigma * sigma);
    (kept >= LEAST).then_some(Coupling {
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
    (pull.stiffness > LEAST).then(|| Coupling {
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
        Self { coupling, slots, moves }
    }

    /// The places of its joints, each with ∂r/∂x.
    fn ends(&self) -> impl Iterator<Item = (usize, &Vector3<f64>)> {
        let n = if self.coupling.is_bone() { 2 } else { 4 };
        self.slots[..n].iter().copied().zip(&self.coupling.gradient)
    }

    /// Takes D⁻¹ of `joints`.
    fn prepare(&mut self, joints: &Joints) {
        let mut moves = [Vector3::zeros(); 4];
        for ((s, gradient), moves) in self.ends().zip(&mut moves) {
            let inverse = &joints.groups[s / LANES].inverse;
            let inverse = Symmetric(inverse.0.map(|a| lane(&a, s % LANES)));
            *moves = inverse.times(&(*gradient).into()).into();
        }
        self.moves = moves;
    }

    /// ∂rᵀ D⁻¹ ∂r of two couplings.
    fn times(&self, other: &Self) -> f64 {
        let shared = |(s, gradient): (usize, &Vector3<f64>)| {
            let moves = other.ends().zip(&other.moves).filter(|((o, _), _)| *o == s);
            moves.map(|(_, moves)| gradient.dot(moves)).sum::<f64>()
        };
        self.ends().map(shared).sum()
    }
}

/// The steps of all joints, from those without couplings. `q` and `multipliers` are scratch space.
pub(super) fn couple(
    links: &mut [Link],
    joints: &mut Joints,
    q: &mut Vec<f64>,
    multipliers: &mut Vec<f64>,
) {
    links.iter_mut().for_each(|link| link.prepare(joints));
    q.clear();
    multipliers.clear();
    for (b, link) in links.iter().enumerate() {
        q.resize((links.len() + 1) * b, 0.0);
        q.extend(links[b..].iter().map(|other| other.times(link)));
        q[(links.len() + 1) * b] =
            RIDGE * (q[(links.len() + 1) * b] + 1.0 / link.coupling.precision);
        let along = |(s, gradient): (usize, &Vector3<f64>)| {
            gradient.dot(&Vector3::from(joints.groups[s / LANES].step.map(|v| lane(&v, s % LANES))))
        };
        multipliers.push(link.coupling.residual + link.ends().map(along).sum::<f64>());
    }
    let n = links.len();
    let Some(factor) = Cholesky::new(DMatrix::from_vec(n, n, std::mem::take(q))) else { return };
    factor.solve_mut(&mut DMatrixViewMut::from_slice(multipliers, n, 1));
    *q = factor.unpack_dirty().data.into();
    for (link, by) in links.iter().zip(multipliers) {
        for ((s, _), moves) in link.ends().zip(&link.moves) {
            for (step, moves) in joints.groups[s / LANES].step.iter_mut().zip(moves.iter()) {
                let v = lane(step, s % LANES);
                set_lane(step, s % LANES, v - moves * *by);
            }
        }
    }
}

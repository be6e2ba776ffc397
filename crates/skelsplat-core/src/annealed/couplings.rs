//! Scalar residuals that couple joints: limbs of equal length, and bones.
//!
//! With H = D + G Λ Gᵀ and the multipliers λ of the couplings, the step is D⁻¹(b − G λ) where λ =
//! Λ (Gᵀ δ + r). Few couplings overlap, so that solving for one multiplier after another (Gauss and
//! Seidel, on the dual) ends after a few sweeps.

use nalgebra::Vector3;

use super::equations::Coupling;
use super::joints::{Group, Joints};
use super::lanes::{LANES, lane, set_lane, set_lanes};
use crate::bones::{Bone, Pull};
use crate::matrix3::Symmetric;
use crate::symmetry::LimbPair;

/// Reach of the kernel of limb pairs, in σ_sym: pairs that differ by more lose their influence like
/// outlying detections.
const SYMMETRY_REACH: f64 = 3.0;
/// Precision relative to that of σ_sym, or of 1 mm for a bone, below which a coupling is left out.
const LEAST: f64 = 1e-12;
/// Most sweeps over the multipliers.
const SWEEPS: usize = 50;

/// A coupling during a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Link {
    coupling: Coupling,
    /// Where its joints are.
    slots: [usize; 4],
    /// D⁻¹ ∂r/∂x.
    moves: [Vector3<f64>; 4],
    /// 1/Λ + ∂rᵀ D⁻¹ ∂r.
    resistance: f64,
    /// λ.
    multiplier: f64,
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
        Self { coupling, slots, moves, resistance: 0.0, multiplier: 0.0 }
    }

    pub(super) fn coupling(&self) -> &Coupling {
        &self.coupling
    }

    /// The places of its joints, each with ∂r/∂x.
    fn ends(&self) -> impl Iterator<Item = (usize, &Vector3<f64>)> {
        let n = if self.coupling.is_bone() { 2 } else { 4 };
        self.slots[..n].iter().copied().zip(&self.coupling.gradient)
    }

    /// Takes D⁻¹ of `joints`.
    fn prepare(&mut self, joints: &Joints) {
        self.multiplier = 0.0;
        self.resistance = 1.0 / self.coupling.precision;
        let mut moves = [Vector3::zeros(); 4];
        for ((s, gradient), moves) in self.ends().zip(&mut moves) {
            let inverse = &joints.groups[s / LANES].inverse;
            let inverse = Symmetric(inverse.0.map(|a| lane(&a, s % LANES)));
            *moves = inverse.times(&(*gradient).into()).into();
        }
        self.moves = moves;
        let along = self.coupling.gradient.iter().zip(&moves).map(|(g, moves)| g.dot(moves));
        self.resistance += along.sum::<f64>();
    }

    /// Solves for the multiplier, given the other ones, and moves the joints' `steps` along;
    /// returns by how much at most, mm.
    #[inline]
    fn relax(&mut self, steps: &mut [Vector3<f64>]) -> f64 {
        let off = self.ends().map(|(s, gradient)| gradient.dot(&steps[s])).sum::<f64>();
        let off = off + self.coupling.residual - self.multiplier / self.coupling.precision;
        let by = off / self.resistance;
        self.multiplier += by;
        let mut farthest = 0.0_f64;
        for ((s, _), moves) in self.ends().zip(&self.moves) {
            farthest = farthest.max(moves.norm_squared());
            steps[s] -= moves * by;
        }
        farthest.sqrt() * by.abs()
    }
}

/// The steps of all joints, from those without couplings, to `exact` mm. `steps` is scratch space.
pub(super) fn couple(
    links: &mut [Link],
    joints: &mut Joints,
    steps: &mut Vec<Vector3<f64>>,
    exact: f64,
) {
    links.iter_mut().for_each(|link| link.prepare(joints));
    steps.clear();
    for group in &joints.groups {
        steps.extend(Group::lanes().map(|l| Vector3::from(group.step.map(|s| lane(&s, l)))));
    }
    for _ in 0..SWEEPS {
        let moved = links.iter_mut().map(|link| link.relax(steps)).fold(0.0, f64::max);
        if moved <= exact {
            break;
        }
    }
    for (s, step) in steps.iter().enumerate() {
        set_lanes(&mut joints.groups[s / LANES].step, s % LANES, step.as_slice());
    }
}

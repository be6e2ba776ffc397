//! Scalar residuals that couple joints: limbs of equal length, and bones.
//!
//! With H = D + G Λ Gᵀ and the multipliers λ of the couplings, the step is D⁻¹(b − G λ) where λ =
//! Λ (Gᵀ δ + r). Few couplings overlap, so that solving for one multiplier after another (Gauss and
//! Seidel, on the dual) ends after a few sweeps.

use nalgebra::Vector3;

use super::equations::Coupling;
use super::joints::Joints;
use super::lanes::{lane, set_lane};
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
        let moves = [Vector3::zeros(); 4];
        Self { coupling, moves, resistance: 0.0, multiplier: 0.0 }
    }

    pub(super) fn coupling(&self) -> &Coupling {
        &self.coupling
    }

    /// Takes D⁻¹ of `joints`.
    fn prepare(&mut self, joints: &Joints) {
        self.multiplier = 0.0;
        self.resistance = 1.0 / self.coupling.precision;
        for ((j, gradient), moves) in self.coupling.ends().zip(&mut self.moves) {
            let (g, l) = joints.place_of(j);
            let inverse = Symmetric(joints.groups[g].inverse.0.map(|a| lane(&a, l)));
            *moves = inverse.times(&(*gradient).into()).into();
            self.resistance += gradient.dot(moves);
        }
    }

    /// Solves for the multiplier, given the other ones, and moves the joints' steps along; returns
    /// by how much at most, mm.
    fn relax(&mut self, joints: &mut Joints) -> f64 {
        let mut off = self.coupling.residual - self.multiplier / self.coupling.precision;
        for (j, gradient) in self.coupling.ends() {
            let (g, l) = joints.place_of(j);
            let step = &joints.groups[g].step;
            off += (0..3).map(|a| gradient[a] * lane(&step[a], l)).sum::<f64>();
        }
        let by = off / self.resistance;
        self.multiplier += by;
        let mut farthest = 0.0_f64;
        for ((j, _), moves) in self.coupling.ends().zip(&self.moves) {
            let (g, l) = joints.place_of(j);
            let moved = moves * by;
            farthest = farthest.max(moved.norm());
            for (s, moved) in joints.groups[g].step.iter_mut().zip(moved.iter()) {
                set_lane(s, l, lane(s, l) - moved);
            }
        }
        farthest
    }
}

/// The steps of all joints, from those without couplings, to `exact` mm.
pub(super) fn couple(links: &mut [Link], joints: &mut Joints, exact: f64) {
    links.iter_mut().for_each(|link| link.prepare(joints));
    for _ in 0..SWEEPS {
        let moved = links.iter_mut().map(|link| link.relax(joints)).fold(0.0, f64::max);
        if moved <= exact {
            break;
        }
    }
}

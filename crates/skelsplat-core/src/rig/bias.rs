//! Errors of a detector that last: of each joint in each view, an offset that stays throughout the
//! recording.
//!
//! Two fifths of the variance of a detector's errors do not change within a recording. For a clock
//! they are the larger part of what it is measured against: of a joint that goes one way, as all do
//! when a person walks, an offset cannot be told from a clock that is off. With the offsets
//! unknown, only changes of the movement tell the clock.
//!
//! The offsets b of a joint are eliminated after its places: with N their equations, in cells, and
//! Γ = (Σ N_bb + Π)⁻¹ Σ N_bθ, a cell has S = N_θθ − N_θb Γ − Γᵀ N_bθ + Γᵀ N_bb Γ and s = n_θ − Γᵀ
//! n_b.

use nalgebra::{DMatrix, DVector, Vector2};

use super::reduced::Reduced;

/// Offsets of the detections of every joint, mm: two coordinates of one view after the other.
#[derive(Debug, Clone)]
pub struct LastingErrors(Vec<DVector<f64>>);

/// How the offsets of one joint follow the cameras.
#[derive(Debug, Clone)]
pub(super) struct Follow {
    /// (Σ N_bb + Π)⁻¹ (n_b + Π b).
    pull: DVector<f64>,
    /// Γ.
    slope: DMatrix<f64>,
}

impl LastingErrors {
    /// None yet.
    pub fn new(views: usize, n_joints: usize) -> Self {
        Self(vec![DVector::zeros(2 * views); n_joints])
    }

    /// The offset of joint `j` in view `i`, mm.
    pub fn at(&self, i: usize, j: usize) -> Vector2<f64> {
        self.0[j].fixed_rows::<2>(2 * i).into_owned()
    }

    /// Step of the offsets of every joint when the cameras step by `delta`.
    pub(super) fn steps(&self, follow: &[Follow], delta: &DVector<f64>) -> Vec<DVector<f64>> {
        follow.iter().map(|own| -&own.pull - &own.slope * delta).collect()
    }

    pub(super) fn add(&mut self, steps: &[DVector<f64>]) {
        self.0.iter_mut().zip(steps).for_each(|(b, step)| *b += step);
    }

    /// Eliminates the offsets, the last unknowns, from cells `[chunk][part * N + j]`.
    pub(super) fn eliminated(&self, cells: &mut [Vec<Reduced>]) -> Vec<Follow> {
        let n = self.0.len();
        let of_joint = |j: usize| {
            let own = cells.iter().flat_map(|chunk| chunk.iter().skip(j).step_by(n));
            self.follow(j, &Reduced::sum(own))
        };
        let follow: Vec<Follow> = (0..n).map(of_joint).collect();
        for (k, cell) in cells.iter_mut().flat_map(|chunk| chunk.iter_mut().enumerate()) {
            without(cell, &follow[k % n].slope);
        }
        follow
    }

    /// From all equations of joint `j`; not at all if these are none.
    fn follow(&self, j: usize, all: &Reduced) -> Follow {
        let b = self.0[j].len();
        let q = all.gradient.len().saturating_sub(b);
        let none = || Follow { pull: DVector::zeros(b), slope: DMatrix::zeros(b, q) };
        if all.gradient.len() < b {
            return none();
        }
        // The prior of an offset is as precise as a detection: it is as large as an error.
        let own = all.matrix.view((q, q), (b, b)) + DMatrix::identity(b, b);
        let mixed = all.matrix.view((q, 0), (b, q)).into_owned();
        let pull = all.gradient.rows(q, b) + &self.0[j];
        own.cholesky().map_or_else(none, |factor| Follow {
            pull: factor.solve(&pull),
            slope: factor.solve(&mixed),
        })
    }
}

/// The equations of a cell without the offsets, which follow by `slope`.
fn without(cell: &mut Reduced, slope: &DMatrix<f64>) {
    let (b, q) = slope.shape();
    let n = &cell.matrix;
    let mixed = n.view((0, q), (q, b)) * slope;
    let own = slope.transpose() * n.view((q, q), (b, b)) * slope;
    let matrix = n.view((0, 0), (q, q)) - &mixed - mixed.transpose() + own;
    let gradient = cell.gradient.rows(0, q) - slope.transpose() * cell.gradient.rows(q, b);
    cell.matrix = matrix;
    cell.gradient = gradient;
}

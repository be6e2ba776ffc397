//! One Gauss–Newton step for joints coupled by few scalar residuals.
//!
//! The normal matrix is H = D + G Λ Gᵀ: a 3×3 block D_j per joint (its detections and its prior)
//! and one rank-one term per coupling (a symmetric pair of limbs), whose gradient is the column g
//! of G. Woodbury's identity solves the whole system exactly, coupled limbs together, with nothing
//! larger than the number of couplings P:
//!
//! ```text
//! H⁻¹ = D⁻¹ − D⁻¹ G Q⁻¹ Gᵀ D⁻¹        Q = Λ⁻¹ + Gᵀ D⁻¹ G   (P × P)
//! ```

use nalgebra::{Matrix3, Vector3};

use crate::bones::Pull;
use crate::matrix3::Symmetric;

/// A scalar residual r of four joints.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coupling {
    /// The joints.
    pub joints: [usize; 4],
    /// ∂r/∂x of each.
    pub gradient: [Vector3<f64>; 4],
    /// r.
    pub residual: f64,
    /// Λ, its inverse variance.
    pub precision: f64,
}

impl Coupling {
    /// The residual of a bone between two joints.
    pub fn of_bone([a, b]: [usize; 2], pull: &Pull) -> Self {
        let none = Vector3::zeros();
        let residual = if pull.stiffness > 0.0 { pull.slope / pull.stiffness } else { 0.0 };
        Self {
            joints: [a, b, a, b],
            gradient: [pull.along, -pull.along, none, none],
            residual,
            precision: pull.stiffness,
        }
    }

    /// ∇rᵀ y, for a vector y of every joint.
    fn along(&self, y: &[Vector3<f64>]) -> f64 {
        self.ends().map(|(j, g)| g.dot(&y[j])).sum()
    }

    /// Whether it is that of a bone.
    pub fn is_bone(&self) -> bool {
        self.gradient[2] == Vector3::zeros()
    }

    /// The joints that it moves, each with ∂r/∂x.
    fn ends(&self) -> impl Iterator<Item = (usize, &Vector3<f64>)> {
        let n = if self.is_bone() { 2 } else { 4 };
        self.joints[..n].iter().copied().zip(&self.gradient)
    }
}

/// Normal equations of ½ Σ |residual|², refilled for every step; buffers are reused.
#[derive(Debug, Clone, Default)]
pub struct NormalEquations {
    blocks: Vec<Matrix3<f64>>,
    /// Minus the gradient of the joints' own residuals.
    pulls: Vec<Vector3<f64>>,
    couplings: Vec<Coupling>,
    inverse: Vec<Matrix3<f64>>,
    /// D⁻¹ ∂r/∂x of every coupling's joints.
    moves: Vec<[Vector3<f64>; 4]>,
    /// Factor U of Q = Uᵀ U, row-major.
    factor: Vec<f64>,
    middle: Vec<f64>,
    along: Vec<Vector3<f64>>,
    steps: Vec<Vector3<f64>>,
}

impl NormalEquations {
    /// Empty equations for `n` joints.
    pub fn new(n: usize) -> Self {
        Self {
            blocks: vec![Matrix3::zeros(); n],
            pulls: vec![Vector3::zeros(); n],
            inverse: vec![Matrix3::zeros(); n],
            steps: vec![Vector3::zeros(); n],
            ..Self::default()
        }
    }

    /// Sets joint `j`'s own part: D_j and minus its gradient.
    pub fn set(&mut self, j: usize, block: Matrix3<f64>, pull: Vector3<f64>) {
        (self.blocks[j], self.pulls[j]) = (block, pull);
    }

    /// Replaces D_j.
    pub fn set_block(&mut self, j: usize, block: Matrix3<f64>) {
        self.blocks[j] = block;
    }

    /// Removes the couplings.
    pub fn uncouple(&mut self) {
        self.couplings.clear();
    }

    /// Keeps the couplings for which `keep` returns true, given their joints.
    pub fn retain_couplings(&mut self, keep: impl Fn(&Coupling) -> bool) {
        self.couplings.retain(keep);
    }

    /// Adds a coupling, unless its precision is zero.
    pub fn couple(&mut self, coupling: Coupling) {
        if coupling.precision > 0.0 {
            self.couplings.push(coupling);
        }
    }

    /// Adds to D what a step needs where r is the difference of two lengths, (joints 0 and 1) less
    /// (2 and 3): the Hessian of ½ Λ r² is Λ (∇r ∇rᵀ + r ∇²r), and what is positive in r ∇²r is |r|
    /// (I − u uᵀ)/l across the longer limb, its ends against each other; [A, −A; −A, A] ≤ diag(2A,
    /// 2A). Where a joint's only ray is at right angles to its limb the first term vanishes along
    /// the ray, and a step without the second always overshoots. `length(a, b)` is that of a limb.
    pub fn bend(&mut self, length: impl Fn(usize, usize) -> f64) {
        for c in &self.couplings {
            if c.is_bone() && c.residual <= 0.0 {
                continue;
            }
            let longer = if c.residual > 0.0 { 0 } else { 2 };
            let (ends, u) = ([c.joints[longer], c.joints[longer + 1]], c.gradient[longer]);
            let strength = 2.0 * c.precision * c.residual.abs() / length(ends[0], ends[1]);
            let block = (Matrix3::identity() - u * u.transpose()) * strength;
            ends.iter().for_each(|j| self.blocks[*j] += block);
        }
    }

    /// H as a dense `(3N, 3N)` row-major matrix, without damping, for study and tests.
    pub fn dense(&self) -> Vec<f64> {
        let n = 3 * self.blocks.len();
        let mut h = vec![0.0; n * n];
        for (j, block) in self.blocks.iter().enumerate() {
            for (a, b) in (0..3).flat_map(|a| (0..3).map(move |b| (a, b))) {
                h[(3 * j + a) * n + 3 * j + b] += block[(a, b)];
            }
        }
        for c in &self.couplings {
            for (p, q) in (0..12).flat_map(|p| (0..12).map(move |q| (p, q))) {
                let (row, column) = (3 * c.joints[p / 3] + p % 3, 3 * c.joints[q / 3] + q % 3);
                h[row * n + column] +=
                    c.precision * c.gradient[p / 3][p % 3] * c.gradient[q / 3][q % 3];
            }
        }
        h
    }

    /// The step −(H + μI)⁻¹ ∇ of every joint, with damping `mu(j)`. A joint whose block stays
    /// singular does not move.
    pub fn solve(&mut self, mu: impl Fn(usize) -> f64) -> &[Vector3<f64>] {
        self.factorise(mu);
        for (step, (inverse, pull)) in
            self.steps.iter_mut().zip(self.inverse.iter().zip(&self.pulls))
        {
            *step = inverse * pull;
        }
        // δ = D⁻¹(b − G Q⁻¹ (Gᵀ D⁻¹ b + r)): the coupling's own gradient Λ r is folded in.
        self.middle.clear();
        self.middle.extend(self.couplings.iter().map(|c| c.along(&self.steps) + c.residual));
        solve_factored(&self.factor, &mut self.middle);
        for ((c, moves), push) in self.couplings.iter().zip(&self.moves).zip(&self.middle) {
            for ((j, _), y) in c.ends().zip(moves) {
                self.steps[j] -= y * *push;
            }
        }
        &self.steps
    }

    /// The block of (H + μI)⁻¹ that belongs to joint `j`, for the `mu` of the last
    /// [`Self::factorise`]: with Y the joint's rows of D⁻¹ G and Q = Uᵀ U it is D_j⁻¹ − Wᵀ W, W =
    /// U⁻ᵀ Yᵀ.
    pub fn covariance(&mut self, j: usize) -> Matrix3<f64> {
        let of_joint = |(c, moves): (&Coupling, &[Vector3<f64>; 4])| -> Vector3<f64> {
            c.ends().zip(moves).filter(|((k, _), _)| *k == j).map(|(_, y)| *y).sum()
        };
        self.along.clear();
        self.along.extend(self.couplings.iter().zip(&self.moves).map(of_joint));
        let first = self.along.iter().position(|y| *y != Vector3::zeros());
        let Some(first) = first else { return self.inverse[j] };
        forward(&self.factor, &mut self.along, first);
        let gained: Matrix3<f64> = self.along[first..].iter().map(|w| w * w.transpose()).sum();
        self.inverse[j] - gained
    }

    /// Inverts the blocks and factorises Q.
    pub fn factorise(&mut self, mu: impl Fn(usize) -> f64) {
        for (j, (inverse, block)) in self.inverse.iter_mut().zip(&self.blocks).enumerate() {
            *inverse = inverse_of(&(block + Matrix3::from_diagonal_element(mu(j))));
        }
        let inverse = &self.inverse;
        let moved = |c: &Coupling| -> [Vector3<f64>; 4] {
            std::array::from_fn(|k| inverse[c.joints[k]] * c.gradient[k])
        };
        self.moves.clear();
        self.moves.extend(self.couplings.iter().map(moved));
        let p = self.couplings.len();
        self.factor.clear();
        self.factor.resize(p * p, 0.0);
        for (a, ca) in self.couplings.iter().enumerate() {
            self.factor[a * p + a] = 1.0 / ca.precision;
            for (b, (cb, moves)) in self.couplings.iter().zip(&self.moves).enumerate().skip(a) {
                let q = &mut self.factor[a * p + b];
                for (ja, ga) in ca.ends() {
                    for ((jb, _), y) in cb.ends().zip(moves) {
                        if ja == jb {
                            *q += ga.dot(y);
                        }
                    }
                }
            }
        }
        factorise(&mut self.factor, p);
    }
}

/// Determinant, relative to the cube of the mean eigenvalue, below which cofactors lose too many
/// digits to rounding.
const ILL_CONDITIONED: f64 = 1e-9;

/// Inverse of a symmetric positive definite matrix, zero where it has none.
#[inline]
fn inverse_of(m: &Matrix3<f64>) -> Matrix3<f64> {
    let symmetric = Symmetric::of(m);
    let scale = symmetric.scale();
    let least = ILL_CONDITIONED * scale * scale * scale;
    symmetric.inverse_above(least).unwrap_or_else(|| carefully_inverted(m))
}

#[cold]
#[inline(never)]
fn carefully_inverted(m: &Matrix3<f64>) -> Matrix3<f64> {
    m.cholesky().map_or_else(Matrix3::zeros, |factor| factor.inverse())
}

/// Factor U of a `p × p` positive definite matrix Uᵀ U, in place, upper triangle, row-major. Every
/// inner loop runs along rows.
fn factorise(a: &mut [f64], p: usize) {
    for k in 0..p {
        let (row, below) = a[k * p..].split_at_mut(p);
        row[k] = row[k].max(f64::MIN_POSITIVE); // rounding can leave 0 or less
        let root = row[k].sqrt();
        row[k..].iter_mut().for_each(|v| *v /= root);
        for i in k + 1..p {
            let u = row[i];
            let target = &mut below[(i - k - 1) * p + i..(i - k) * p];
            target.iter_mut().zip(&row[i..]).for_each(|(t, v)| *t -= u * v);
        }
    }
}

/// Solves Uᵀ x = b in place, for one or several right-hand sides, of which the first `from` rows
/// are zero.
fn forward<T>(factor: &[f64], b: &mut [T], from: usize)
where
    T: Copy + std::ops::Mul<f64, Output = T> + std::ops::SubAssign,
{
    let p = b.len();
    for k in from..p {
        let (row, (solved, rest)) = (&factor[k * p..(k + 1) * p], b[k..].split_at_mut(1));
        solved[0] = solved[0] * (1.0 / row[k]);
        rest.iter_mut().zip(&row[k + 1..]).for_each(|(v, u)| *v -= solved[0] * *u);
    }
}

/// Solves Uᵀ U x = b in place.
fn solve_factored(factor: &[f64], b: &mut [f64]) {
    forward(factor, b, 0);
    let p = b.len();
    for i in (0..p).rev() {
        let row = &factor[i * p..(i + 1) * p];
        let sum: f64 = row[i + 1..].iter().zip(&b[i + 1..]).map(|(u, x)| u * x).sum();
        b[i] = (b[i] - sum) / row[i];
    }
}

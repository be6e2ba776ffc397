//! The sparse system of one Gauss–Newton step, and its solution by preconditioned conjugate
//! gradients.
//!
//! H = D + bones + motion couples the joints of a frame along the bones and each joint over five
//! frames. Its part per joint, with the bones' diagonal blocks, is a [`Chain`], solved exactly in
//! linear time: it takes up the stiff coupling in time, and the eigenvalues of the preconditioned
//! system lie in (0, 2). Vectors hold joint after joint, each over all frames.

use nalgebra::{Matrix3, Vector3};

use super::chain::{Chain, add_stiffness};
use crate::bones::Pull;
use crate::matrix3::times;

/// The step's system.
#[derive(Debug, Clone)]
pub struct System {
    /// Number of frames T.
    pub frames: usize,
    /// Joints at both ends of every bone.
    pub bones: Vec<[usize; 2]>,
    /// D `(N, T)`.
    pub blocks: Vec<Matrix3<f64>>,
    /// Minus the gradient `(N, T)`.
    pub pulls: Vec<Vector3<f64>>,
    /// Weight of the second difference at each frame `(N, T)`; 0 where it has none.
    pub weights: Vec<f64>,
    /// The bones' terms `(B, T)`.
    pub lengths: Vec<Pull>,
    /// Factors of the preconditioner, of which the memory is reused.
    chains: Vec<Chain>,
}

impl System {
    /// An empty system.
    pub fn new(frames: usize, joints: usize, bones: &[[usize; 2]]) -> Self {
        Self {
            frames,
            bones: bones.to_vec(),
            blocks: vec![Matrix3::zeros(); frames * joints],
            pulls: vec![Vector3::zeros(); frames * joints],
            weights: vec![0.0; frames * joints],
            lengths: vec![Pull::default(); frames * bones.len()],
            chains: vec![Chain::default(); joints],
        }
    }

    /// Joint `j`'s part of a vector.
    pub fn of(&self, j: usize) -> std::ops::Range<usize> {
        j * self.frames..(j + 1) * self.frames
    }

    /// H v into `out`.
    pub fn times(&self, v: &[Vector3<f64>], out: &mut [Vector3<f64>]) {
        for ((out, block), v) in out.iter_mut().zip(&self.blocks).zip(v) {
            *out = times(block, v);
        }
        for j in 0..self.chains.len() {
            let of = self.of(j);
            add_stiffness(&self.weights[of.clone()], &v[of.clone()], 1.0, &mut out[of]);
        }
        for (b, [head, tail]) in self.bones.iter().enumerate() {
            for t in 0..self.frames {
                let pull = &self.lengths[b * self.frames + t];
                if pull.stiffness > 0.0 {
                    let (h, l) = (head * self.frames + t, tail * self.frames + t);
                    let q = pull.times(&(v[h] - v[l]));
                    out[h] += q;
                    out[l] -= q;
                }
            }
        }
    }

    /// Factors of the preconditioner, with damping `mu`.
    pub fn factorise(&mut self, mu: f64) {
        let t = self.frames;
        // D with the bones' own blocks.
        let mut diagonal = self.blocks.clone();
        for (b, ends) in self.bones.iter().enumerate() {
            for (k, pull) in self.lengths[b * t..(b + 1) * t].iter().enumerate() {
                if pull.stiffness > 0.0 {
                    let block = pull.block();
                    ends.iter().for_each(|j| diagonal[j * t + k] += block);
                }
            }
        }
        let damping = Matrix3::from_diagonal_element(mu);
        for (j, chain) in self.chains.iter_mut().enumerate() {
            let of = j * t..(j + 1) * t;
            let blocks = &diagonal[of.clone()];
            chain.factorise(&self.weights[of], |k| blocks[k] + damping);
        }
    }

    fn preconditioned(&self, residual: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
        let mut out = residual.to_vec();
        let both = 2 * self.frames.max(1);
        for (chains, x) in self.chains.chunks(2).zip(out.chunks_mut(both)) {
            let (first, second) = x.split_at_mut(self.frames);
            match chains {
                [a, b] => Chain::solve_together([a, b], [first, second]),
                _ => chains[0].solve(first),
            }
        }
        out
    }

    /// The step (H + μI)⁻¹ (−∇), to a relative accuracy `tolerance` in the norm of the
    /// preconditioner, in at most `most` rounds.
    pub fn solve(&mut self, mu: f64, tolerance: f64, most: usize) -> Vec<Vector3<f64>> {
        self.factorise(mu);
        let zeros = vec![Vector3::zeros(); self.pulls.len()];
        let (mut step, mut image, mut residual) = (zeros.clone(), zeros, self.pulls.clone());
        let mut direction = self.preconditioned(&residual);
        let mut square = dot(&residual, &direction);
        let enough = square * tolerance * tolerance;
        for _ in 0..most {
            if square <= enough || square <= f64::MIN_POSITIVE {
                break;
            }
            self.times(&direction, &mut image);
            image.iter_mut().zip(&direction).for_each(|(i, d)| *i += d * mu);
            let length = square / dot(&direction, &image);
            step.iter_mut().zip(&direction).for_each(|(s, d)| *s += d * length);
            residual.iter_mut().zip(&image).for_each(|(r, i)| *r -= i * length);
            let preconditioned = self.preconditioned(&residual);
            let next = dot(&residual, &preconditioned);
            let ratio = next / square;
            square = next;
            direction.iter_mut().zip(&preconditioned).for_each(|(d, z)| *d = z + *d * ratio);
        }
        step
    }

    /// H without damping as a dense row-major matrix, for study and tests.
    pub fn dense(&self) -> Vec<f64> {
        let n = self.pulls.len();
        let mut out = vec![0.0; 9 * n * n];
        let (mut unit, mut column) = (vec![Vector3::zeros(); n], vec![Vector3::zeros(); n]);
        for k in 0..3 * n {
            unit[k / 3][k % 3] = 1.0;
            self.times(&unit, &mut column);
            unit[k / 3][k % 3] = 0.0;
            for (row, v) in column.iter().flat_map(|v| v.iter()).enumerate() {
                out[row * 3 * n + k] = *v;
            }
        }
        out
    }
}

fn dot(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

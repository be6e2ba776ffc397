//! One joint over time: a symmetric system of 3×3 blocks, coupled over two frames by scalars.
//!
//! The information of the detections and of the bones gives a block A_t per frame, and a second
//! difference with weight w_t couples three frames: A_tt += w_{t−1} + 4 w_t + w_{t+1}, b_t =
//! A_{t,t−1} = −2 (w_{t−1} + w_t), c_t = A_{t,t−2} = w_{t−1}, all times the identity. Its factors A
//! = L D Lᵀ, with identities on the diagonal of L and P_t = L_{t,t−1}, are
//!
//! ```text
//! U_t = b_t − c_t P_{t−1}ᵀ     P_t = U_t D_{t−1}⁻¹     L_{t,t−2} = c_t D_{t−2}⁻¹
//! D_t = A_t − P_t U_tᵀ − c_t² D_{t−2}⁻¹
//! ```
//!
//! and the blocks of S = A⁻¹ in the band follow from S = D⁻¹L⁻¹ + (I − Lᵀ) S, from the last frame
//! to the first (Takahashi's equations), in linear time.

use nalgebra::{Matrix3, Vector3};

use crate::matrix3::{inverse, product, symmetrised, times};

/// The system of one joint: blocks, couplings and, after [`Chain::factorise`], its factors.
#[derive(Debug, Clone, Default)]
pub struct Chain {
    /// b_t; 0 for the first frame.
    first: Vec<f64>,
    /// c_t; 0 for the first two frames.
    second: Vec<f64>,
    /// D_t⁻¹.
    inverse: Vec<Matrix3<f64>>,
    /// P_t.
    lower: Vec<Matrix3<f64>>,
}

/// Blocks of the inverse: of a frame with itself, with the next, and with the one after.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Band {
    /// S_tt.
    pub own: Matrix3<f64>,
    /// S_{t,t+1}; zero for the last frame.
    pub next: Matrix3<f64>,
    /// S_{t,t+2}; zero for the last two frames.
    pub after: Matrix3<f64>,
}

impl Band {
    /// Multiplies all blocks.
    pub fn scale(&mut self, factor: f64) {
        [&mut self.own, &mut self.next, &mut self.after].into_iter().for_each(|m| *m *= factor);
    }
}

/// What second differences of weights `w` (one per frame, at its centre) add to the diagonal at
/// `t`.
#[inline]
pub fn stiffness(w: &[f64], t: usize) -> f64 {
    let of = |t: usize| w.get(t).copied().unwrap_or(0.0);
    4.0 * of(t) + of(t + 1) + if t > 0 { of(t - 1) } else { 0.0 }
}

/// The second difference of `x` at `t`.
#[inline]
pub fn second_difference(x: &[Vector3<f64>], t: usize) -> Vector3<f64> {
    x[t - 1] - 2.0 * x[t] + x[t + 1]
}

/// Adds K x times `factor` to `out`, with the matrix K of second differences of weights `w`.
pub fn add_stiffness(w: &[f64], x: &[Vector3<f64>], factor: f64, out: &mut [Vector3<f64>]) {
    for t in 1..x.len().saturating_sub(1) {
        if w[t] > 0.0 {
            let d = second_difference(x, t) * (w[t] * factor);
            out[t - 1] += d;
            out[t] -= 2.0 * d;
            out[t + 1] += d;
        }
    }
}

impl Chain {
    /// Factors of the system with blocks `block(t)` and second differences of weights `w`, which
    /// are zero at the ends.
    pub fn factorise(&mut self, w: &[f64], block: impl Fn(usize) -> Matrix3<f64>) {
        let n = w.len();
        for of_frame in [&mut self.first, &mut self.second] {
            of_frame.clear();
            of_frame.resize(n, 0.0);
        }
        self.inverse.clear();
        self.lower.clear();
        for t in 0..n {
            let mut d = block(t);
            let stiff = stiffness(w, t);
            (0..3).for_each(|a| d[(a, a)] += stiff);
            let mut lower = Matrix3::zeros();
            if t > 0 {
                let b = -2.0 * (w[t - 1] + w[t]);
                let mut u = Matrix3::from_diagonal_element(b);
                if t > 1 {
                    let c = w[t - 1];
                    u -= self.lower[t - 1].transpose() * c;
                    d -= self.inverse[t - 2] * (c * c);
                    self.second[t] = c;
                }
                lower = product(&u, &self.inverse[t - 1]);
                d -= product(&lower, &u.transpose());
                self.first[t] = b;
            }
            self.inverse.push(inverse(&d));
            self.lower.push(lower);
        }
    }

    /// Solves the factorised system for the right-hand side `x`, in place.
    pub fn solve(&self, x: &mut [Vector3<f64>]) {
        Self::solve_together([self], [x]);
    }

    /// [`Chain::solve`] for chains of the same length: every frame waits for the one before it, and
    /// while one chain waits, another goes on.
    pub fn solve_together<const K: usize>(chains: [&Self; K], mut x: [&mut [Vector3<f64>]; K]) {
        let n = x[0].len();
        // y_t = x_t − P_t y_{t−1} − c_t D_{t−2}⁻¹ y_{t−2}
        for t in 1..n {
            for (chain, x) in chains.iter().zip(&mut x) {
                let mut y = x[t] - times(&chain.lower[t], &x[t - 1]);
                if t > 1 {
                    y -= times(&chain.inverse[t - 2], &x[t - 2]) * chain.second[t];
                }
                x[t] = y;
            }
        }
        // x_t = D_t⁻¹ (y_t − c_{t+2} x_{t+2}) − P_{t+1}ᵀ x_{t+1}
        for t in (0..n).rev() {
            for (chain, x) in chains.iter().zip(&mut x) {
                let mut z = x[t];
                if t + 2 < n {
                    z -= x[t + 2] * chain.second[t + 2];
                }
                z = times(&chain.inverse[t], &z);
                if t + 1 < n {
                    z -= times(&chain.lower[t + 1].transpose(), &x[t + 1]);
                }
                x[t] = z;
            }
        }
    }

    /// The band of the inverse of the factorised system.
    pub fn selected_inverse(&self) -> Vec<Band> {
        let n = self.inverse.len();
        let zero = Matrix3::zeros();
        let mut bands = vec![Band { own: zero, next: zero, after: zero }; n];
        for t in (0..n).rev() {
            let mut band = Band { own: self.inverse[t], next: zero, after: zero };
            if t + 1 < n {
                let (ahead, p) = (bands[t + 1], self.lower[t + 1].transpose());
                band.next = -product(&p, &ahead.own);
                band.after = -product(&p, &ahead.next);
                if t + 2 < n {
                    let q = self.inverse[t] * self.second[t + 2];
                    band.next -= product(&q, &ahead.next.transpose());
                    band.after -= product(&q, &bands[t + 2].own);
                    band.own -= product(&q, &band.after.transpose());
                }
                band.own -= product(&p, &band.next.transpose());
            }
            band.own = symmetrised(&band.own);
            bands[t] = band;
        }
        bands
    }
}

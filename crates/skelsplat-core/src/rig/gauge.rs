//! Error bars of a rig of which only the shape is known.
//!
//! Turning, moving and scaling everything changes no detection. The bundle holds the first camera;
//! the error bars of the others then contain how well that one is known. Without this freedom,
//! the errors θ of all cameras are those of the rig aligned with the truth: with the seven
//! directions G in which everything moves together, θ − G (GᵀWG)⁻¹ GᵀW θ, in which W makes turns
//! and shifts comparable.

use nalgebra::{DMatrix, Vector3};

use super::bundle::{Lenses, places};
use super::evidence::{Bars, bars};
use super::placed::PARAMETERS;
use super::search::Explanation;

/// Error bars of every camera of a rig.
pub fn removed(rig: &Explanation, lenses: Lenses) -> Vec<Bars> {
    let m = rig.cameras.len();
    let q = PARAMETERS * m;
    let mut covariance = DMatrix::zeros(q, q);
    for (i, k, a) in places(&rig.freedom, lenses) {
        for (j, l, b) in places(&rig.freedom, lenses) {
            covariance[(PARAMETERS * i + k, PARAMETERS * j + l)] = rig.judged.steady[(a, b)];
        }
    }
    let centres: Vec<Vector3<f64>> = rig.cameras.iter().map(|c| c.camera.centre()).collect();
    let middle = centres.iter().sum::<Vector3<f64>>() / m as f64;
    let reach =
        (centres.iter().map(|c| (c - middle).norm_squared()).sum::<f64>() / m as f64).sqrt();
    let mut free = DMatrix::zeros(q, 7);
    let mut weight = DMatrix::zeros(q, q);
    for (i, centre) in centres.iter().enumerate() {
        let rotation = rig.cameras[i].camera.rotation();
        let arm = centre - middle;
        for k in 0..3 {
            let mut axis = Vector3::zeros();
            axis[k] = 1.0;
            let row = PARAMETERS * i;
            // The world turned by ω: R becomes R exp(−ω), which is a turn −Rω of the camera.
            let turn = -(rotation * axis);
            let moved = axis.cross(&arm);
            for d in 0..3 {
                free[(row + d, k)] = turn[d];
                free[(row + 3 + d, k)] = moved[d];
                weight[(row + d, row + d)] = reach * reach;
                weight[(row + 3 + d, row + 3 + d)] = 1.0;
            }
            free[(row + 3 + k, 3 + k)] = 1.0;
            free[(row + 3 + k, 6)] = arm[k];
        }
    }
    let known = free.transpose() * &weight;
    let Some(inverse) = (&known * &free).try_inverse() else { return vec![Bars::UNKNOWN; m] };
    let keep = DMatrix::identity(q, q) - &free * inverse * known;
    let covariance = &keep * covariance * keep.transpose();
    let all: Vec<(usize, usize)> =
        (0..m).flat_map(|i| (0..PARAMETERS).map(move |k| (i, k))).collect();
    (0..m).map(|i| bars(&covariance, &all, i)).collect()
}

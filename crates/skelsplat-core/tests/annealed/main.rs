//! The annealed solver: its loss, its weights, and the default method on scenes with known ground
//! truth.

mod depth;
mod evidence;
mod knowledge;
mod loss;
mod outcomes;
mod recovery;
mod rivals;
mod swaps;
mod weights;

use nalgebra::{DMatrix, DVector, Matrix3, Vector2, Vector3};
use skelsplat_core::study::annealed::evidence::evidence;
use skelsplat_core::study::annealed::robust;
use skelsplat_core::study::annealed::{
    Annealing, NoiseModel, Prior, Problem, Ray, Rays, Solution, Widening, solve,
};
use skelsplat_core::study::overlap::PlaneGaussian;
use skelsplat_core::study::projection::View;
use skelsplat_core::study::symmetry::LimbPair;
use skelsplat_core::testing::differences::{central_differences, relative_error};
use skelsplat_core::testing::scenes::{
    Noise, exact_detections, look_at, noisy_detections, perturbed, room, standing,
};
use skelsplat_core::{
    AnnealedSettings, Bones, Camera, Detections, Frame, JointStatus, Layout, Progress,
    RefineConfig, Refinement, Refiner, StopReason, Unit, refine_batch,
};

const WRIST: usize = 13;
const LIMBS: [LimbPair; 2] = [([12, 13], [15, 16]), ([5, 6], [2, 3])];

fn points(x: &[f64]) -> Vec<Vector3<f64>> {
    x.chunks_exact(3).map(Vector3::from_column_slice).collect()
}

fn flat(points: &[Vector3<f64>]) -> Vec<f64> {
    points.iter().flat_map(|p| [p.x, p.y, p.z]).collect()
}

fn rms(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    (a.iter().zip(b).map(|(a, b)| (a - b).norm_squared()).sum::<f64>() / a.len() as f64).sqrt()
}

fn largest(a: &[Vector3<f64>], b: &[Vector3<f64>]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// The default without symmetry and bones: slightly unequal limbs would move exact data.
fn free() -> RefineConfig {
    freely(AnnealedSettings::default())
}

fn freely(settings: AnnealedSettings) -> RefineConfig {
    let settings = AnnealedSettings { bones: Bones::Free, ..settings };
    RefineConfig { symmetry_tier: 0, ..RefineConfig::from(settings) }
}

fn refine(cameras: &[Camera], frame: &Frame, config: RefineConfig) -> Refinement {
    let layout = Layout::by_name("h36m17").unwrap();
    let refiner = Refiner::new(cameras, Unit::Millimetre, Some(&layout), config).unwrap();
    refiner.refine(frame).unwrap()
}

fn from(detections: Detections, init_pose: Option<Vec<Vector3<f64>>>) -> Frame {
    Frame { detections, init_pose, init_covariance: None, past: false }
}

fn with_prior(detections: Detections, pose: Vec<Vector3<f64>>, sigma: f64) -> Frame {
    let covariance = Matrix3::from_diagonal_element(sigma * sigma);
    let n = pose.len();
    Frame {
        detections,
        init_pose: Some(pose),
        init_covariance: Some(vec![covariance; n]),
        past: false,
    }
}

/// `detections` moved, dropped (`None`) or with another confidence by `f(view, joint, pixel)`.
fn changed(
    detections: &Detections,
    f: impl Fn(usize, usize, Vector2<f64>) -> Option<(Vector2<f64>, f64)>,
) -> Detections {
    let (m, n) = (detections.n_views(), detections.n_joints());
    let (mut pixels, mut confidence) = (Vec::new(), Vec::new());
    for (i, j) in (0..m).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let found = detections.get(i, j).and_then(|(p, _)| f(i, j, p));
        let (p, c) = found.unwrap_or((Vector2::repeat(f64::NAN), 1.0));
        pixels.extend([p.x, p.y]);
        confidence.push(c);
    }
    Detections::new(m, n, &pixels, Some(&confidence)).unwrap()
}

fn without(detections: &Detections, missing: impl Fn(usize, usize) -> bool) -> Detections {
    changed(detections, |i, j, p| (!missing(i, j)).then_some((p, 1.0)))
}

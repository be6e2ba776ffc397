//! The annealed solver: its loss, its weights, and the default method on scenes with known ground
//! truth.

mod depth;
mod evidence;
mod knowledge;
mod loss;
mod outcomes;
mod population;
mod recovery;
mod swaps;
mod uncertainty;
mod weights;

use nalgebra::{Matrix3, Vector2, Vector3};
use skelsplat_core::study::annealed::{AnnealedFrame, Annealing, NoiseModel, Prior, Ray, Rays};
use skelsplat_core::study::overlap::PlaneGaussian;
use skelsplat_core::study::projection::View;
use skelsplat_core::study::symmetry::LimbPair;
use skelsplat_core::study::triangulation::robust;
use skelsplat_core::{
    AnnealedSettings, Bones, Camera, Detections, Frame, JointStatus, RefineConfig, Refinement,
    Refiner, StopReason, Unit,
};
use skelsplat_tests::differences::{central_differences, relative_error};
use skelsplat_tests::scenes::{
    Noise, changed, exact_detections, h36m, look_at, noisy_detections, perturbed, refiner, room,
    standing, without,
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
    refiner(cameras, config).refine(frame).unwrap()
}

fn from(detections: Detections, init_pose: Option<Vec<Vector3<f64>>>) -> Frame {
    Frame { detections, init_pose, init_covariance: None }
}

fn with_prior(detections: Detections, pose: Vec<Vector3<f64>>, sigma: f64) -> Frame {
    let covariance = Matrix3::from_diagonal_element(sigma * sigma);
    let n = pose.len();
    let init_covariance = Some(vec![covariance; n]);
    Frame { init_pose: Some(pose), init_covariance, ..detections.into() }
}

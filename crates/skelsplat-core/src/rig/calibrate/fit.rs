//! How well a rig fits the detections, and which camera contradicts the others.

use nalgebra::Vector3;

use crate::rig::evidence::ALIKE;
use crate::rig::placed::Placed;
use crate::rig::scene::Scene;
use crate::rig::search::LEAST;
use crate::statistics::median;

/// A camera belongs to the rig if the others explain this part of its detections.
const EXPLAINED: f64 = 0.5;
/// Distances explained by noise, in multiples of it.
const WITHIN: f64 = 4.0;

/// How well a rig fits.
pub(super) struct Fit {
    pub(super) frames: Vec<usize>,
    pub(super) points: Vec<Vector3<f64>>,
    /// Noise of a detection, mm.
    pub(super) noise: f64,
    pub(super) of_cameras: Vec<CameraFit>,
}

/// How well a camera's detections fit the joints.
#[derive(Clone, Copy)]
pub(super) struct CameraFit {
    /// Their median distance, px.
    pub(super) distance: f64,
    /// The same at the joints, mm.
    pub(super) at_joints: f64,
    /// The part of them within [`WITHIN`] times the noise.
    pub(super) explained: f64,
}

impl Fit {
    /// Of cameras to the detections of these frames.
    pub(super) fn of(scene: Scene<'_>, frames: Vec<usize>, noise: f64, cameras: &[Placed]) -> Self {
        let points = scene.points(&frames, cameras, |_| true);
        let of_camera = |(i, camera): (usize, &Placed)| {
            let off = scene.distances(&frames, &points, i, camera);
            let near = off.iter().filter(|(px, mm)| px * mm < WITHIN * noise).count();
            let explained = if off.len() < LEAST { 0.0 } else { near as f64 / off.len() as f64 };
            CameraFit {
                distance: median(off.iter().map(|(px, _)| *px)),
                at_joints: median(off.iter().map(|(px, mm)| px * mm)),
                explained,
            }
        };
        let of_cameras = cameras.iter().enumerate().map(of_camera).collect();
        Self { frames, points, noise, of_cameras }
    }

    /// The camera that contradicts the others most, if one does: its detections are farther off in
    /// pixels and at the joints, as errors are between the same in pixels and in sizes of people.
    pub(super) fn worst(&self) -> Option<usize> {
        let all = || self.of_cameras.iter().enumerate();
        let beside = |i: usize, distance: fn(&CameraFit) -> f64| {
            let others = all().filter(|(k, _)| *k != i).map(|(_, fit)| distance(fit));
            distance(&self.of_cameras[i]) / median(others)
        };
        let against = |i: usize| beside(i, |fit| fit.distance).min(beside(i, |fit| fit.at_joints));
        let (least, fit) = all().min_by(|a, b| a.1.explained.total_cmp(&b.1.explained))?;
        let farthest =
            (0..self.of_cameras.len()).max_by(|a, b| against(*a).total_cmp(&against(*b)));
        match fit.explained < EXPLAINED {
            true => Some(least),
            false => farthest.filter(|i| against(*i) > ALIKE),
        }
    }
}

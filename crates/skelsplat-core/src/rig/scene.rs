//! The detections of a recording by clock, view and joint.

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;

use super::placed::{Placed, Sight};
use crate::annealed::robust;
use crate::camera::Camera;
use crate::detections::Detections;

/// Frames on either side from which the movement of a detection is measured: more average the swing of a foot at 15 frames per second
/// away, fewer the noise too little.
const REACH: usize = 2;

/// The frames of a recording, in order.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    frames: &'a [Detections],
}

impl<'a> Scene<'a> {
    /// At least one frame; all have the same numbers of views and joints.
    #[must_use]
    pub fn new(frames: &'a [Detections]) -> Self {
        Self { frames }
    }

    /// Number of joints.
    #[must_use]
    pub fn n_joints(&self) -> usize {
        self.frames[0].n_joints()
    }

    /// Number of frames.
    #[must_use]
    pub fn n_frames(&self) -> usize {
        self.frames.len()
    }

    /// The detection of joint `j` in view `i` when all clocks show `t`.
    ///
    /// It is taken from the nearest frame of the camera and moved on for the rest of a frame, u + f v: between two frames
    /// the noise would be averaged, and a clock half a frame off would seem to fit better than the true one. The movement v is
    /// given where it is needed or the camera's clock may be `moving`.
    #[must_use]
    pub fn sight(&self, t: usize, i: usize, j: usize, clock: f64, moving: bool) -> Option<Sight> {
        let whole = clock.round();
        let k = t.checked_add_signed(whole as isize)?;
        let (pixel, confidence) = self.frames.get(k)?.get(i, j)?;
        let speed = if moving || clock != whole { self.speed(k, i, j) } else { Vector2::zeros() };
        Some(Sight { pixel: pixel + speed * (clock - whole), speed, confidence })
    }

    /// Movement of a detection, px per frame, by least squares over pairs of frames before and after; 0 without a pair. Its own
    /// error has no part in it.
    fn speed(&self, k: usize, i: usize, j: usize) -> Vector2<f64> {
        let (mut sum, mut squares) = (Vector2::zeros(), 0.0);
        for d in 1..=REACH.min(k) {
            let later = self.frames.get(k + d).and_then(|frame| frame.get(i, j));
            if let (Some((b, _)), Some((a, _))) = (later, self.frames[k - d].get(i, j)) {
                let d = d as f64;
                sum += (b - a) * d;
                squares += 2.0 * d * d;
            }
        }
        if squares > 0.0 { sum / squares } else { Vector2::zeros() }
    }

    /// Joints `(frames, N)` placed by the views that are `used`, mm; NaN where unknown.
    #[must_use]
    pub fn points(&self, frames: &[usize], cameras: &[Placed], used: &[bool]) -> Vec<Vector3<f64>> {
        let views: Vec<usize> = (0..cameras.len()).filter(|i| used[*i]).collect();
        let there: Vec<Camera> = views.iter().map(|i| cameras[*i].camera.clone()).collect();
        let one = |t: &usize| {
            let get = |v: usize, j: usize| {
                let sight = self.sight(*t, views[v], j, cameras[views[v]].clock, false)?;
                Some((sight.pixel, sight.confidence))
            };
            let seen = Detections::gathered(views.len(), self.n_joints(), get);
            robust(&seen.undistorted(&there), &there).points
        };
        let placed: Vec<Vec<Vector3<f64>>> = frames.par_iter().map(one).collect();
        placed.into_iter().flatten().collect()
    }

    /// Distances of the detections of view `i` from points `(frames, N)`, px, and what a pixel is there, mm.
    #[must_use]
    pub fn distances(
        &self,
        frames: &[usize],
        points: &[Vector3<f64>],
        i: usize,
        camera: &Placed,
    ) -> Vec<(f64, f64)> {
        let n = self.n_joints();
        let one = |(k, x): (usize, &Vector3<f64>)| {
            let sight = self.sight(frames[k / n], i, k % n, camera.clock, false)?;
            let residual = camera.residual(x, &sight)?;
            Some((residual.value.norm(), residual.pixel))
        };
        points.iter().enumerate().filter(|(_, x)| x.x.is_finite()).filter_map(one).collect()
    }
}

/// The median; NaN of nothing.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

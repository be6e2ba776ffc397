//! The detections of a recording by clock, view and joint.

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;

use super::placed::{Placed, Sight};
use crate::camera::Camera;
use crate::detections::Detections;
use crate::triangulation::robust;

/// Frames on either side from which the movement of a joint is measured: more average the swing of
/// a foot at 15 frames per second away, fewer the noise too little. Twice and four times as many
/// where people move slowly.
const REACH: [usize; 3] = [2, 4, 8];
/// They move slowly where more than this part of the changes of the movement would be noise.
const NOISY: f64 = 0.05;

/// The frames of a recording, in order.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    frames: &'a [Detections],
    motion: Option<&'a JointMotion>,
}

/// Where the joints are in some frames, and how they move there, as all cameras together see it.
///
/// From the detections of one camera, the movement would have their noise, and a clock would seem
/// to be off by less than it is: of two noisy quantities, the slope of one over the other is too
/// small.
#[derive(Debug, Clone)]
pub struct JointMotion {
    n_joints: usize,
    /// Frames on either side from which the movement is measured.
    reach: usize,
    /// Place of each frame among those that were looked at.
    places: Vec<Option<usize>>,
    /// Joints (frames, N), mm; NaN where unknown.
    points: Vec<Vector3<f64>>,
    /// Of each its movement, mm per frame, and the variance of its noise, of all three coordinates
    /// together; `None` where unknown.
    movements: Vec<Option<(Vector3<f64>, f64)>>,
}

impl JointMotion {
    /// At these frames.
    pub fn of(scene: Scene<'_>, frames: &[usize], cameras: &[Placed]) -> Self {
        let [least, middle, most] = REACH;
        let mut motion = Self::within(scene, frames, cameras, least);
        for reach in [middle, most] {
            if motion.noise(frames) <= NOISY {
                break;
            }
            motion = Self::within(scene, frames, cameras, reach);
        }
        motion
    }

    fn within(scene: Scene<'_>, frames: &[usize], cameras: &[Placed], reach: usize) -> Self {
        let mut places = vec![None; scene.n_frames()];
        let around = |t: &usize| t.saturating_sub(reach)..(t + reach + 1).min(scene.n_frames());
        frames.iter().flat_map(around).for_each(|t| places[t] = Some(0));
        let needed: Vec<usize> = (0..places.len()).filter(|t| places[*t].is_some()).collect();
        needed.iter().enumerate().for_each(|(place, t)| places[*t] = Some(place));
        let points = scene.points(&needed, cameras, |_| true);
        Self { n_joints: scene.n_joints(), reach, places, points, movements: Vec::new() }.measured()
    }

    /// Of joints `(T, N)` that are known in every frame, mm.
    pub fn known(n_joints: usize, points: Vec<Vector3<f64>>) -> Self {
        let (reach, movements) = (REACH[0], Vec::new());
        let places = (0..points.len() / n_joints).map(Some).collect();
        Self { n_joints, reach, places, points, movements }.measured()
    }

    /// With the movement of every joint.
    fn measured(mut self) -> Self {
        let there = (0..self.places.len()).filter(|t| self.places[*t].is_some());
        let all = there.flat_map(|t| (0..self.n_joints).map(move |j| (t, j)));
        self.movements = all.map(|(t, j)| self.measure(t, j)).collect();
        self
    }

    fn place(&self, t: usize, j: usize) -> Option<usize> {
        Some((*self.places.get(t)?)? * self.n_joints + j)
    }

    fn point(&self, t: usize, j: usize) -> Option<&Vector3<f64>> {
        self.points.get(self.place(t, j)?).filter(|x| x.x.is_finite())
    }

    fn movement(&self, t: usize, j: usize) -> Option<(Vector3<f64>, f64)> {
        self.movements[self.place(t, j)?]
    }

    /// Movement of joint `j` by least squares over pairs of frames before and after.
    fn measure(&self, t: usize, j: usize) -> Option<(Vector3<f64>, f64)> {
        let (mut sum, mut squares, mut length, mut pairs) = (Vector3::zeros(), 0.0, 0.0, 0.0);
        for d in 1..=self.reach.min(t) {
            if let (Some(b), Some(a)) = (self.point(t + d, j), self.point(t - d, j)) {
                let d = d as f64;
                sum += (b - a) * d;
                squares += 2.0 * d * d;
                length += (b - a).norm_squared();
                pairs += 1.0;
            }
        }
        let slope = sum / squares;
        let left = length - 2.0 * slope.norm_squared() * squares;
        (squares > 0.0).then(|| (slope, left / (2.0 * squares * (pairs - 1.0))))
    }

    /// The part of the changes of the movement that is noise.
    fn noise(&self, frames: &[usize]) -> f64 {
        let (mut noise, mut changes) = (0.0, 0.0);
        for j in 0..self.n_joints {
            let all = frames.iter().filter_map(|t| self.movement(*t, j));
            let all: Vec<(Vector3<f64>, f64)> =
                all.filter(|movement| movement.1.is_finite()).collect();
            let mean =
                all.iter().map(|movement| movement.0).sum::<Vector3<f64>>() / all.len() as f64;
            noise += all.iter().map(|movement| movement.1).sum::<f64>();
            changes += all.iter().map(|movement| (movement.0 - mean).norm_squared()).sum::<f64>();
        }
        if changes > 0.0 { noise / changes } else { 0.0 }
    }

    /// Movement of joint `j` in a camera's image, px per frame; 0 where unknown.
    fn speed(&self, t: usize, j: usize, camera: &Camera) -> Vector2<f64> {
        let slope = self.point(t, j).and_then(|x| {
            let (movement, _) = self.movement(t, j)?;
            Some(camera.project_with_jacobian(x)?.1 * movement)
        });
        slope.unwrap_or_else(Vector2::zeros)
    }
}

impl<'a> Scene<'a> {
    /// At least one frame; all have the same numbers of views and joints. How the joints move is
    /// not known.
    pub fn new(frames: &'a [Detections]) -> Self {
        Self { frames, motion: None }
    }

    /// With the movement of the joints.
    #[must_use]
    pub fn moving(self, motion: &'a JointMotion) -> Self {
        Self { motion: Some(motion), ..self }
    }

    /// Number of joints.
    pub fn n_joints(&self) -> usize {
        self.frames[0].n_joints()
    }

    /// Number of frames.
    pub fn n_frames(&self) -> usize {
        self.frames.len()
    }

    /// The detection of joint `j` by the camera `one` of view `i`, in frame `t` as all clocks
    /// count.
    ///
    /// It is taken from the nearest frame of the camera and moved on for the rest of a frame, u + f
    /// v: between two frames the noise would be averaged, and a clock half a frame off would seem
    /// to fit better than the true one. The movement v is given where it is needed or the camera's
    /// clock may be `moving`.
    pub fn sight(
        &self,
        t: usize,
        i: usize,
        j: usize,
        placed: &Placed,
        moving: bool,
    ) -> Option<Sight> {
        let whole = placed.clock.round();
        let k = t.checked_add_signed(whole as isize)?;
        let (pixel, confidence) = self.frames.get(k)?.get(i, j)?;
        let motion = self.motion.filter(|_| moving || placed.clock != whole);
        let speed = motion.map_or_else(Vector2::zeros, |motion| motion.speed(t, j, &placed.camera));
        Some(Sight { pixel: pixel + speed * (placed.clock - whole), speed, confidence })
    }

    /// Joints `(frames, N)` placed by the views that are `used`, mm; NaN where unknown.
    pub fn points(
        &self,
        frames: &[usize],
        cameras: &[Placed],
        used: impl Fn(usize) -> bool,
    ) -> Vec<Vector3<f64>> {
        let views: Vec<usize> = (0..cameras.len()).filter(|i| used(*i)).collect();
        let there: Vec<Camera> = views.iter().map(|i| cameras[*i].camera.clone()).collect();
        let at_frame = |t: &usize| {
            let get = |v: usize, j: usize| {
                let sight = self.sight(*t, views[v], j, &cameras[views[v]], false)?;
                Some((sight.pixel, sight.confidence))
            };
            let seen = Detections::gathered(views.len(), self.n_joints(), get);
            robust(&seen.undistorted(&there), &there).points
        };
        let placed: Vec<Vec<Vector3<f64>>> = frames.par_iter().map(at_frame).collect();
        placed.into_iter().flatten().collect()
    }

    /// Distances of the detections of view `i` from points `(frames, N)`, px, and what a pixel is
    /// there, mm.
    pub fn distances(
        &self,
        frames: &[usize],
        points: &[Vector3<f64>],
        i: usize,
        camera: &Placed,
    ) -> Vec<(f64, f64)> {
        let n = self.n_joints();
        let distance = |(k, x): (usize, &Vector3<f64>)| {
            let sight = self.sight(frames[k / n], i, k % n, camera, false)?;
            let residual = camera.residual(x, &sight)?;
            Some((residual.value.norm(), residual.pixel))
        };
        points.iter().enumerate().filter(|(_, x)| x.x.is_finite()).filter_map(distance).collect()
    }
}

/// At most so many, evenly spread.
pub(super) fn spread(frames: &[usize], most: usize) -> Vec<usize> {
    let n = frames.len();
    if n <= most {
        return frames.to_vec();
    }
    (0..most).map(|k| frames[(2 * k + 1) * n / (2 * most)]).collect()
}

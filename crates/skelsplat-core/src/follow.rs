//! Frame after frame: where each begins, and what is kept of it.

use nalgebra::Vector3;

use crate::batch::{Progress, refine_batch};
use crate::detections::Detections;
use crate::error::{Error, Result};
use crate::outcome::JointStatus;
use crate::refine::{Frame, Method, Refinement, Refiner};

/// What no joint of a person moves from one frame to the next, mm: 7.5 m/s at 25 frames per second.
const LEAP_MM: f64 = 300.0;

/// Refines frame after frame, each from the poses of those before.
///
/// With annealing the detections decide wherever two views see a joint; the past gives the depth of a joint that one view
/// sees, the place of one that none sees, and decides ties. By the paper's method joints without a reliable position are
/// triangulated anew, and so is the whole pose if most joints no longer meet their detections.
#[derive(Debug, Clone)]
pub struct Follower<'a> {
    refiner: &'a Refiner,
    past: Option<Vec<Vector3<f64>>>,
}

impl<'a> Follower<'a> {
    /// Begins with the last known positions `(N)` in the unit of the cameras, NaN where there is none; `None`: with the
    /// detections alone.
    #[must_use]
    pub fn new(refiner: &'a Refiner, past: Option<Vec<Vector3<f64>>>) -> Self {
        Self { refiner, past }
    }

    /// The last known positions `(N)`.
    #[must_use]
    pub fn past(&self) -> Option<&[Vector3<f64>]> {
        self.past.as_deref()
    }

    /// Forgets the frames before: the next one begins with its detections alone.
    pub fn reset(&mut self) {
        self.past = None;
    }

    /// Refines the next frame.
    ///
    /// # Errors
    /// As [`refine_batch`], and [`Error::InvalidInput`] for another number of joints than in the frames before.
    pub fn step(&mut self, detections: Detections, progress: &Progress) -> Result<Refinement> {
        let n = detections.n_joints();
        if let Some(past) = self.past.as_ref().filter(|past| past.len() != n) {
            let expected =
                format!("{} joints as in the frames before (or reset() first)", past.len());
            return Err(Error::invalid("detections", expected, n.to_string()));
        }
        let mut frame = Frame { init_pose: self.past.clone(), past: true, ..detections.into() };
        let mut refined = self.one(&frame, progress)?;
        if self.past.is_some() && self.by_paper() && is_lost(&refined) {
            frame.init_pose = None;
            refined = self.one(&frame, progress)?;
        }
        self.past = Some(self.remembered(&refined));
        Ok(refined)
    }

    fn one(&self, frame: &Frame, progress: &Progress) -> Result<Refinement> {
        let mut done = refine_batch(self.refiner, std::slice::from_ref(frame), progress)?;
        Ok(done.swap_remove(0))
    }

    fn by_paper(&self) -> bool {
        matches!(self.refiner.config().method, Method::Paper(_))
    }

    /// Where the next frame starts: for the paper's method only what is reliable, else all that was known.
    ///
    /// Annealing starts from least squares, so that an old position matters only where it is the only one, or where views
    /// tie. A weak joint that has leapt may have followed the wrong views: its old position is kept.
    fn remembered(&self, refined: &Refinement) -> Vec<Vector3<f64>> {
        let missing = Vector3::repeat(f64::NAN);
        let mm = self.refiner.unit().millimetres();
        let one = |(j, (pose, status)): (usize, (&Vector3<f64>, &JointStatus))| {
            if self.by_paper() {
                return if *status == JointStatus::Ok { *pose } else { missing };
            }
            let before = self.past.as_ref().map_or(missing, |past| past[j]);
            let leapt = (pose - before).norm() * mm > LEAP_MM;
            let known = pose.iter().all(|v| v.is_finite());
            if known && !(leapt && *status == JointStatus::Weak) { *pose } else { before }
        };
        refined.pose.iter().zip(&refined.joint_status).enumerate().map(one).collect()
    }
}

/// Whether most joints that are seen are not where they are seen.
fn is_lost(refined: &Refinement) -> bool {
    let count = |status: JointStatus| refined.joint_status.iter().filter(|s| **s == status).count();
    let seen = refined.joint_status.len() - count(JointStatus::Unobserved);
    2 * count(JointStatus::Ok) < seen
}

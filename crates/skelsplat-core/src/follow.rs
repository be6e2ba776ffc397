//! Frame-by-frame refinement: the start of each frame, and the state kept for the next.

use nalgebra::Vector3;

use crate::batch::{Progress, refine_batch};
use crate::detections::Detections;
use crate::error::{Error, Result};
use crate::outcome::JointStatus;
use crate::refine::{Frame, Method, Refinement, Refiner};
use crate::sequence::Live;

/// Upper limit of a joint's movement between frames, mm: 7.5 m/s at 25 frames per second.
const LEAP_MM: f64 = 300.0;

/// Refines frame by frame, each from the poses of the previous frames.
///
/// With `annealed` the detections determine every joint that two views see; the past provides the
/// depth of a joint that one view sees and the position of one that no view sees, and breaks ties.
/// With `paper`, joints without a reliable position are triangulated again, and so is the whole
/// pose if most joints no longer match their detections. At a known frame rate
/// ([`Follower::at_rate`]) the past predicts as well ([`Live`]).
#[derive(Debug, Clone)]
pub struct Follower<'a> {
    refiner: &'a Refiner,
    past: Option<Vec<Vector3<f64>>>,
    live: Option<Live>,
}

impl<'a> Follower<'a> {
    /// Starts from the last known positions `(N)` in the unit of the cameras, NaN where unknown;
    /// `None`: from the detections only.
    #[must_use]
    pub fn new(refiner: &'a Refiner, past: Option<Vec<Vector3<f64>>>) -> Self {
        Self { refiner, past, live: None }
    }

    /// Starts without a past, of frames that come `fps` times per second: the past predicts. The
    /// answer is the frame `lag` frames before the last.
    ///
    /// # Errors
    /// As [`Live::new`].
    pub fn at_rate(refiner: &'a Refiner, fps: f64, lag: usize) -> Result<Self> {
        Ok(Self { refiner, past: None, live: Some(Live::new(refiner, fps, lag)?) })
    }

    /// The last known positions `(N)`; `None` at a known frame rate.
    #[must_use]
    pub fn past(&self) -> Option<&[Vector3<f64>]> {
        self.past.as_deref()
    }

    /// Discards the past: the next frame starts from its detections only.
    pub fn reset(&mut self) {
        self.past = None;
        self.live.iter_mut().for_each(Live::reset);
    }

    /// Refines the next frame.
    ///
    /// # Errors
    /// As [`refine_batch`], and [`Error::InvalidInput`] if the number of joints differs from the
    /// previous frames.
    pub fn step(&mut self, detections: Detections, progress: &Progress) -> Result<Refinement> {
        if let Some(live) = &mut self.live {
            return live.step(self.refiner, detections, progress);
        }
        let n = detections.n_joints();
        if let Some(past) = self.past.as_ref().filter(|past| past.len() != n) {
            let expected =
                format!("{} joints, as in the previous frames (or call reset() first)", past.len());
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
        Ok(refine_batch(self.refiner, std::slice::from_ref(frame), progress)?.frame(0))
    }

    fn by_paper(&self) -> bool {
        matches!(self.refiner.config().method, Method::Paper(_))
    }

    /// The start of the next frame: for `paper` only reliable positions, else all known ones.
    ///
    /// `annealed` starts from least squares, so a past position matters only where it is the only
    /// one or where views tie. A weak joint that has jumped may have followed the wrong views: its
    /// past position is kept.
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

/// Whether most detected joints do not match their detections.
fn is_lost(refined: &Refinement) -> bool {
    let count = |status: JointStatus| refined.joint_status.iter().filter(|s| **s == status).count();
    let seen = refined.joint_status.len() - count(JointStatus::Unobserved);
    2 * count(JointStatus::Ok) < seen
}

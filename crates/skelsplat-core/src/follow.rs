//! Frame-by-frame refinement: each frame starts from the poses of the previous ones.

use nalgebra::Vector3;

use crate::annealed::places::LEAP;
use crate::batch::{Progress, refine_batch};
use crate::detections::Detections;
use crate::error::{Error, Result};
use crate::outcome::JointStatus;
use crate::refine::{Frame, Method, Refinement, Refiner};

/// Refines the frame after those with the last known positions `past` `(N)`, in the unit of the
/// cameras, NaN where unknown (`None`: from the detections only). Also returns the past of the next
/// frame.
///
/// With `annealed` the detections determine every joint that two views see; the past provides the
/// depth of a joint that one view sees and the position of one that no view sees, and breaks ties.
/// With `paper`, joints without a reliable position are triangulated again, and so is the whole
/// pose if most joints no longer match their detections. At a known frame rate, [`crate::Live`]
/// predicts as well.
///
/// # Errors
/// As [`refine_batch`], and [`Error::InvalidInput`] if the number of joints differs from the past.
pub fn follow(
    refiner: &Refiner,
    past: Option<Vec<Vector3<f64>>>,
    detections: Detections,
    progress: &Progress,
) -> Result<(Refinement, Vec<Vector3<f64>>)> {
    let n = detections.n_joints();
    if let Some(past) = past.as_ref().filter(|past| past.len() != n) {
        let expected =
            format!("{} joints, as in the previous frames (or call reset() first)", past.len());
        return Err(Error::invalid("detections", expected, n.to_string()));
    }
    let by_paper = matches!(refiner.config().method, Method::Paper(_));
    let mut frame = Frame { init_pose: past, ..detections.into() };
    let refine = |frame: &Frame| -> Result<Refinement> {
        Ok(refine_batch(refiner, std::slice::from_ref(frame), progress)?.frame(0))
    };
    let mut refined = refine(&frame)?;
    let past = frame.init_pose.take();
    if past.is_some() && by_paper && is_lost(&refined) {
        refined = refine(&frame)?;
    }
    let next = match by_paper {
        true => reliable(&refined),
        false => remembered(&refined, past.as_deref(), refiner.unit().millimetres()),
    };
    Ok((refined, next))
}

/// A joint without a position.
const MISSING: Vector3<f64> = Vector3::new(f64::NAN, f64::NAN, f64::NAN);

/// The start of the next frame for `paper`: reliable positions.
fn reliable(refined: &Refinement) -> Vec<Vector3<f64>> {
    let joints = refined.pose.iter().zip(&refined.joint_status);
    joints.map(|(x, status)| if *status == JointStatus::Ok { *x } else { MISSING }).collect()
}

/// The start of the next frame for `annealed`, whose start is least squares, so that a past
/// position matters only where it is the only one or where views tie: all known positions. A weak
/// joint that has jumped may have followed the wrong views: its past position is kept.
fn remembered(refined: &Refinement, past: Option<&[Vector3<f64>]>, mm: f64) -> Vec<Vector3<f64>> {
    let joint = |(j, (x, status)): (usize, (&Vector3<f64>, &JointStatus))| {
        let before = past.map_or(MISSING, |past| past[j]);
        let leapt = (x - before).norm() * mm > LEAP;
        let known = x.iter().all(|v| v.is_finite());
        if known && !(leapt && *status == JointStatus::Weak) { *x } else { before }
    };
    refined.pose.iter().zip(&refined.joint_status).enumerate().map(joint).collect()
}

/// Whether most detected joints do not match their detections.
fn is_lost(refined: &Refinement) -> bool {
    let count = |status: JointStatus| refined.joint_status.iter().filter(|s| **s == status).count();
    let seen = refined.joint_status.len() - count(JointStatus::Unobserved);
    2 * count(JointStatus::Ok) < seen
}

//! How far a detector's joints lie from anatomical ones: errors that all views and frames share,
//! and no residual shows.
//!
//! The distances are those that comparisons of markerless with marker-based capture state in their
//! abstracts; their tables per joint and direction were not available. Of two figures the larger is
//! taken, of a range its upper end, of a bound the bound:
//!
//! * L. Needham et al., "The accuracy of several pose estimation methods for 3D joint centre
//!   localisation", Scientific Reports 11:20673 (2021), OpenPose, AlphaPose, DeepLabCut: hip and
//!   knee "~30–50 mm", ankle "1–15 mm";
//! * R. M. Kanko et al., "Concurrent assessment of gait kinematics using marker-based and
//!   markerless motion capture", Journal of Biomechanics 127:110665 (2021), Theia3D: "less than 2.5
//!   cm for all joints except the hip, which was 3.6 cm" (root mean square), whence the ankle;
//! * B. K. Lahkar et al., "Accuracy of a markerless motion capture system in estimating upper
//!   extremity kinematics during boxing", Frontiers in Sports and Active Living 4:939980 (2022),
//!   Theia3D: elbow "more than 3 cm", shoulder and wrist "<2.5 cm";
//! * N. Nakano et al., "Evaluation of 3D markerless motion capture accuracy using OpenPose with
//!   multiple video cameras", Frontiers in Sports and Active Living 2:50 (2020), all joints: "an
//!   accuracy of 30 mm or less".
//!
//! Measured: on Human3.6M, S1 and S5 to S8, a stacked hourglass (`benchmarks/accuracy.py bias`),
//! the distance with which 2 σ hold 73.9 % of the errors, to 5 mm. It is the larger one for hip,
//! ankle, shoulder and neck.
//!
//! Bridged: the pelvis, the middle of the hips, errs like a published hip, which is more than was
//! measured. For spine, head, face, fingers, heels and toes, no abstract has a figure of its own;
//! they get Nakano's.

use crate::layout::Layout;
use crate::settings::{Kind, Parameter, Value, parameter};

/// Standard deviation per axis of the errors that all views and frames share.
#[derive(Debug, Clone, PartialEq)]
pub enum JointBias {
    /// Published and measured figures for joints of human layouts, 0 for others.
    OfLayout,
    /// The same for every joint, mm.
    All(f64),
    /// One per joint `(N)`, mm.
    Each(Vec<f64>),
}

/// Joints without their sides, and the distance from the anatomical joint, mm.
const DISTANCES: [(&str, f64); 8] = [
    ("shoulder", 35.0),
    ("elbow", 30.0),
    ("wrist", 25.0),
    ("hip", 55.0),
    ("knee", 50.0),
    ("ankle", 55.0),
    ("pelvis", 50.0),
    ("neck", 65.0),
];

/// Distance for every other joint, mm.
const ELSEWHERE: f64 = 30.0;

impl JointBias {
    /// Standard deviations per axis `(n)`, mm: those of the layout, or of `n` joints without one.
    pub(super) fn per_joint(&self, layout: Option<&Layout>, n: usize) -> Vec<f64> {
        match (self, layout) {
            (Self::All(sigma), _) => vec![*sigma; n],
            (Self::Each(sigmas), _) => sigmas.clone(),
            (Self::OfLayout, Some(layout)) if layout.human => {
                layout.joints.iter().map(|name| known(name)).collect()
            }
            (Self::OfLayout, _) => vec![0.0; n],
        }
    }
}

/// The distance, in no known direction, per axis, mm.
fn known(joint: &str) -> f64 {
    let bare = joint.trim_start_matches("left_").trim_start_matches("right_");
    let row = DISTANCES.iter().find(|(name, _)| *name == bare);
    row.map_or(ELSEWHERE, |(_, distance)| *distance) / 3f64.sqrt()
}

parameter!(JointBias, Kind::OneOrEach,
    bias => match bias {
        JointBias::OfLayout => Value::Nothing,
        JointBias::All(sigma) => Value::Number(*sigma),
        JointBias::Each(sigmas) => Value::Numbers(sigmas.clone()),
    },
    Value::Nothing => Some(Self::OfLayout),
    Value::Number(sigma) => Some(Self::All(*sigma)),
    Value::Numbers(sigmas) => Some(Self::Each(sigmas.clone())));

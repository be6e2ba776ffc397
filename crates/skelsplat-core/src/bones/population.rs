//! Lengths of bones relative to stature, in the population.
//!
//! The segment lengths are those of R. Drillis and R. Contini, "Body Segment Parameters" (1966), as
//! tabulated in D. A. Winter, "Biomechanics and Motor Control of Human Movement", 4th edition,
//! figure 4.1: shoulder to elbow 0.186, elbow to wrist 0.146, hip to knee 0.245 (0.530 − 0.285),
//! knee to ankle 0.246 (0.285 − 0.039), hip to shoulder height 0.288 (0.818 − 0.530), shoulder
//! height to the top of the head 0.182, between the shoulders 0.259, foot 0.152 of stature.
//!
//! Where the joints of a layout are not the ends of these segments, the length is bridged and its
//! spread is larger: hip joints lie inside the hips' breadth of 0.191; the neck is a point between
//! shoulder height and the base of the neck; the spine divides the trunk, which bends, in two;
//! nose, toes and heels are points of the skin. Bones of the face have no entry.

use nalgebra::Vector3;

use crate::layout::Layout;

/// The expected length of a bone relative to stature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Proportion {
    /// Its joints.
    pub joints: [usize; 2],
    /// Mean length over stature.
    pub ratio: f64,
    /// Standard deviation of the length between people of one stature, relative to the length.
    pub spread: f64,
}

impl Proportion {
    /// The stature for which the bone has its length in a pose, in the pose's unit.
    pub fn stature(&self, pose: &[Vector3<f64>]) -> f64 {
        (pose[self.joints[0]] - pose[self.joints[1]]).norm() / self.ratio
    }
}

/// Stature of people, children and adults, mm: mean and standard deviation.
pub const STATURE: [f64; 2] = [1600.0, 350.0];

/// Ends of a bone without their sides, ratio and spread.
const TABLE: [(&str, &str, f64, f64); 19] = [
    ("shoulder", "elbow", 0.186, 0.06),
    ("elbow", "wrist", 0.146, 0.06),
    ("hip", "knee", 0.245, 0.06),
    ("knee", "ankle", 0.246, 0.06),
    ("pelvis", "hip", 0.075, 0.2),
    ("neck", "shoulder", 0.115, 0.2),
    ("pelvis", "spine", 0.144, 0.15),
    ("spine", "neck", 0.15, 0.15),
    ("pelvis", "neck", 0.295, 0.1),
    ("shoulder", "hip", 0.288, 0.1),
    ("shoulder", "shoulder", 0.225, 0.12),
    ("hip", "hip", 0.15, 0.2),
    ("neck", "nose", 0.11, 0.25),
    ("nose", "head", 0.09, 0.3),
    ("neck", "head", 0.165, 0.15),
    ("ear", "shoulder", 0.14, 0.25),
    ("ankle", "heel", 0.045, 0.25),
    ("ankle", "big_toe", 0.11, 0.2),
    ("ankle", "foot_index", 0.11, 0.2),
];

/// The bones of a human layout that the table knows; none for other layouts.
pub fn proportions(layout: &Layout) -> Vec<Proportion> {
    if !layout.human {
        return Vec::new();
    }
    let bare = |j: usize| layout.joints[j].trim_start_matches("left_").trim_start_matches("right_");
    let of_bone = |joints: &[usize; 2]| {
        let [a, b] = joints.map(bare);
        let row = |(p, q, _, _): &&(&str, &str, f64, f64)| (*p, *q) == (a, b) || (*q, *p) == (a, b);
        let (_, _, ratio, spread) = TABLE.iter().find(row)?;
        Some(Proportion { joints: *joints, ratio: *ratio, spread: *spread })
    };
    layout.limbs.iter().filter_map(of_bone).collect()
}

//! The built-in layouts: joint orders as used by data sets and detectors; everything else is
//! derived from the names.
//!
//! A body joint has the same name in all layouts. `pelvis` is the centre of the hips (Panoptic's
//! body centre, `OpenPose`'s mid hip, Occlusion-Person's root), `spine` the middle of the trunk
//! (Occlusion-Person's belly), `neck` the base of the neck or head (Human3.6M's thorax, Shelf's
//! bottom of the head) and `head` the top of the head.

use super::{LayoutSpec, SymmetricPair};

/// Canonical names, in the order of [`JOINTS`].
pub(super) const NAMES: [&str; 9] = [
    "h36m17",
    "coco17",
    "panoptic19",
    "occlusion_person15",
    "body25",
    "body25b",
    "halpe26",
    "shelf14",
    "mediapipe33",
];

/// Joints of each layout; `l_` and `r_` stand for `left_` and `right_`.
const JOINTS: [&str; 9] = [
    "pelvis r_hip r_knee r_ankle l_hip l_knee l_ankle spine neck nose head \
     l_shoulder l_elbow l_wrist r_shoulder r_elbow r_wrist",
    "nose l_eye r_eye l_ear r_ear l_shoulder r_shoulder l_elbow r_elbow l_wrist r_wrist \
     l_hip r_hip l_knee r_knee l_ankle r_ankle",
    "neck nose pelvis l_shoulder l_elbow l_wrist l_hip l_knee l_ankle \
     r_shoulder r_elbow r_wrist r_hip r_knee r_ankle l_eye l_ear r_eye r_ear",
    "pelvis r_hip r_knee r_ankle l_hip l_knee l_ankle spine neck \
     l_shoulder l_elbow l_wrist r_shoulder r_elbow r_wrist",
    "nose neck r_shoulder r_elbow r_wrist l_shoulder l_elbow l_wrist pelvis r_hip r_knee r_ankle \
     l_hip l_knee l_ankle r_eye l_eye r_ear l_ear \
     l_big_toe l_small_toe l_heel r_big_toe r_small_toe r_heel",
    "nose l_eye r_eye l_ear r_ear l_shoulder r_shoulder l_elbow r_elbow l_wrist r_wrist \
     l_hip r_hip l_knee r_knee l_ankle r_ankle neck head \
     l_big_toe l_small_toe l_heel r_big_toe r_small_toe r_heel",
    "nose l_eye r_eye l_ear r_ear l_shoulder r_shoulder l_elbow r_elbow l_wrist r_wrist \
     l_hip r_hip l_knee r_knee l_ankle r_ankle head neck pelvis \
     l_big_toe r_big_toe l_small_toe r_small_toe l_heel r_heel",
    "r_ankle r_knee r_hip l_hip l_knee l_ankle r_wrist r_elbow r_shoulder \
     l_shoulder l_elbow l_wrist neck head",
    "nose l_eye_inner l_eye l_eye_outer r_eye_inner r_eye r_eye_outer l_ear r_ear l_mouth r_mouth \
     l_shoulder r_shoulder l_elbow r_elbow l_wrist r_wrist l_pinky r_pinky l_index r_index \
     l_thumb r_thumb l_hip r_hip l_knee r_knee l_ankle r_ankle l_heel r_heel \
     l_foot_index r_foot_index",
];

/// Limbs of one side with their symmetry tier (0: drawn, but not part of the symmetry loss).
const SIDE: [(&str, &str, u8); 22] = [
    ("elbow", "wrist", 1),
    ("knee", "ankle", 1),
    ("shoulder", "elbow", 2),
    ("hip", "knee", 2),
    ("pelvis", "hip", 3),
    ("neck", "shoulder", 3),
    ("nose", "eye", 0),
    ("eye", "ear", 0),
    ("ankle", "heel", 0),
    ("ankle", "big_toe", 0),
    ("big_toe", "small_toe", 0),
    ("nose", "eye_inner", 0),
    ("eye_inner", "eye", 0),
    ("eye", "eye_outer", 0),
    ("eye_outer", "ear", 0),
    ("nose", "mouth", 0),
    ("wrist", "thumb", 0),
    ("wrist", "index", 0),
    ("wrist", "pinky", 0),
    ("ankle", "foot_index", 0),
    // Where the trunk has no joints of its own, its sides and the ears connect the skeleton.
    ("shoulder", "hip", 0),
    ("ear", "shoulder", 0),
];

/// Limbs on the axis of the body, and across it.
const MIDDLE: [(&str, &str); 8] = [
    ("pelvis", "spine"),
    ("spine", "neck"),
    ("pelvis", "neck"),
    ("neck", "nose"),
    ("nose", "head"),
    ("neck", "head"),
    ("left_hip", "right_hip"),
    ("left_shoulder", "right_shoulder"),
];

/// The layout with this canonical name.
pub(super) fn spec(name: &str) -> Option<LayoutSpec> {
    let which = NAMES.iter().position(|n| *n == name)?;
    let joints: Vec<String> = JOINTS[which].split_whitespace().map(long_name).collect();
    let symmetric = symmetric(&joints);
    let left_right = joints.iter().enumerate().filter_map(|(i, joint)| {
        let mirror = joint.strip_prefix("left_")?;
        Some([i, find(&joints, &format!("right_{mirror}"))?])
    });
    let prone = ["elbow", "wrist", "ankle"];
    let occlusion_prone =
        (0..joints.len()).filter(|&i| prone.iter().any(|p| joints[i].ends_with(p)));
    Some(LayoutSpec {
        name: name.to_owned(),
        limbs: limbs(&joints),
        left_right: left_right.collect(),
        occlusion_prone: occlusion_prone.collect(),
        root: root(&joints),
        lengths: Vec::new(),
        angles: Vec::new(),
        human: true,
        symmetric,
        joints,
    })
}

fn long_name(short: &str) -> String {
    match short.split_once('_') {
        Some(("l", rest)) => format!("left_{rest}"),
        Some(("r", rest)) => format!("right_{rest}"),
        _ => short.to_owned(),
    }
}

fn find(joints: &[String], name: &str) -> Option<usize> {
    joints.iter().position(|j| j == name)
}

/// Both ends of a limb; on a `side`, a joint with a left and a right version is the one on that
/// side.
fn limb(joints: &[String], side: &str, a: &str, b: &str) -> Option<[usize; 2]> {
    let on_side = |name| find(joints, &format!("{side}_{name}")).or_else(|| find(joints, name));
    Some([on_side(a)?, on_side(b)?])
}

fn symmetric(joints: &[String]) -> Vec<SymmetricPair> {
    SIDE.iter()
        .filter(|(_, _, tier)| *tier > 0)
        .filter_map(|&(a, b, tier)| {
            let (left, right) = (limb(joints, "left", a, b)?, limb(joints, "right", a, b)?);
            Some(SymmetricPair { tier, left, right })
        })
        .collect()
}

/// Every limb with both ends in the layout and not replaced by a finer path.
fn limbs(joints: &[String]) -> Vec<[usize; 2]> {
    let has = |name| find(joints, name).is_some();
    let replaced = |a: &str, b: &str| match (a, b) {
        ("pelvis", "neck") => has("spine"),
        ("neck", "head") => has("nose"),
        ("left_hip", "right_hip") => has("pelvis"),
        ("left_shoulder", "right_shoulder") | ("ear", "shoulder") => has("neck"),
        ("shoulder", "hip") => has("neck") && has("pelvis"),
        ("nose", "eye") | ("eye", "ear") => has("left_eye_inner"),
        _ => false,
    };
    let middle = MIDDLE
        .iter()
        .filter(|(a, b)| !replaced(a, b))
        .filter_map(|(a, b)| Some([find(joints, a)?, find(joints, b)?]));
    let sides = SIDE.iter().filter(|(a, b, _)| !replaced(a, b)).flat_map(|(a, b, _)| {
        ["left", "right"].into_iter().filter_map(|side| limb(joints, side, a, b))
    });
    middle.chain(sides).collect()
}

/// The pelvis, or the two hips if the layout has no pelvis; the root is the mean of these joints.
fn root(joints: &[String]) -> Vec<usize> {
    match find(joints, "pelvis") {
        Some(i) => vec![i],
        None => ["left_hip", "right_hip"].iter().filter_map(|j| find(joints, j)).collect(),
    }
}

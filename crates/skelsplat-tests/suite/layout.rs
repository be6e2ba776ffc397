//! Joint layouts: joint orders, invariants of the built-in ones, and rejected input.

use std::collections::HashSet;

use skelsplat_core::{KnownLength, Layout, LayoutSpec, OwnAngle, SymmetricPair};
use skelsplat_tests::refused;

fn all() -> impl Iterator<Item = Layout> {
    Layout::NAMES.into_iter().map(|name| Layout::by_name(name).unwrap())
}

/// `left_x` for `right_x` and the other way round, any other name for itself.
fn mirrored(name: &str) -> String {
    match (name.strip_prefix("left_"), name.strip_prefix("right_")) {
        (Some(rest), _) => format!("right_{rest}"),
        (_, Some(rest)) => format!("left_{rest}"),
        _ => name.to_owned(),
    }
}

/// Joints, limbs of tiers 1, 2 and 3 together, left-right pairs and joints of the root, from the
/// published joint lists: a third tier needs a pelvis (hips) and a neck (shoulders).
#[test]
fn sizes() {
    let expected = [
        ("h36m17", 17, [2, 4, 6], 6, 1),
        ("coco17", 17, [2, 4, 4], 8, 2),
        ("panoptic19", 19, [2, 4, 6], 8, 1),
        ("occlusion_person15", 15, [2, 4, 6], 6, 1),
        ("body25", 25, [2, 4, 6], 11, 1),
        ("body25b", 25, [2, 4, 5], 11, 2),
        ("halpe26", 26, [2, 4, 6], 11, 1),
        ("shelf14", 14, [2, 4, 5], 6, 2),
        ("mediapipe33", 33, [2, 4, 4], 16, 2),
    ];
    for (name, joints, tiers, left_right, root) in expected {
        let layout = Layout::by_name(name).unwrap();
        assert_eq!(layout.name, name);
        assert_eq!(layout.n_joints(), joints, "{name}");
        assert_eq!([1, 2, 3].map(|t| layout.symmetric_pairs(t).count()), tiers, "{name}");
        assert_eq!(layout.symmetric_pairs(0).count(), 0);
        assert_eq!(layout.left_right.len(), left_right, "{name}");
        assert_eq!(layout.root.len(), root, "{name}");
        assert_eq!(layout.occlusion_prone.len(), 6, "{name}");
    }
}

/// A few indices of each published order, chosen where orders are easily confused.
#[test]
fn joint_orders() {
    let expected = [
        ("h36m17", "1 right_hip 4 left_hip 8 neck 10 head 16 right_wrist"),
        ("coco17", "0 nose 5 left_shoulder 10 right_wrist 16 right_ankle"),
        ("panoptic19", "2 pelvis 5 left_wrist 14 right_ankle 17 right_eye"),
        ("occlusion_person15", "3 right_ankle 7 spine 11 left_wrist"),
        ("body25", "4 right_wrist 8 pelvis 15 right_eye 24 right_heel"),
        ("body25b", "9 left_wrist 17 neck 18 head 21 left_heel"),
        ("halpe26", "17 head 18 neck 19 pelvis 21 right_big_toe"),
        ("shelf14", "0 right_ankle 6 right_wrist 11 left_wrist 13 head"),
        ("mediapipe33", "4 right_eye_inner 9 left_mouth 17 left_pinky 22 right_thumb"),
    ];
    for (name, joints) in expected {
        let layout = Layout::by_name(name).unwrap();
        let words: Vec<&str> = joints.split(' ').collect();
        for pair in words.chunks(2) {
            assert_eq!(layout.joints[pair[0].parse::<usize>().unwrap()], pair[1], "{name}");
        }
    }
}

#[test]
fn built_in_layouts_pass_their_own_validation() {
    for layout in all() {
        assert_eq!(Layout::new(LayoutSpec::clone(&layout)), Ok(layout));
    }
}

#[test]
fn pairs_are_mirror_images() {
    for layout in all() {
        let name = |i: usize| layout.joints[i].as_str();
        for pair in &layout.symmetric {
            assert_eq!(
                pair.left.map(|i| mirrored(name(i))),
                pair.right.map(|i| name(i).to_owned())
            );
            assert!(pair.left.iter().any(|&i| name(i).starts_with("left_")), "{pair:?}");
            let limb = |ends: [usize; 2]| layout.limbs.contains(&ends);
            assert!(limb(pair.left) && limb(pair.right), "{}: {pair:?}", layout.name);
        }
        for [left, right] in &layout.left_right {
            assert!(name(*left).starts_with("left_"));
            assert_eq!(mirrored(name(*left)), name(*right));
        }
        let sided = layout.joints.iter().filter(|j| mirrored(j) != **j).count();
        assert_eq!(sided, 2 * layout.left_right.len(), "{}", layout.name);
    }
}

#[test]
fn limbs_connect_every_joint() {
    for layout in all() {
        let mut reached = HashSet::from([0]);
        for _ in 0..layout.n_joints() {
            for [a, b] in &layout.limbs {
                if reached.contains(a) || reached.contains(b) {
                    reached.extend([*a, *b]);
                }
            }
        }
        assert_eq!(reached.len(), layout.n_joints(), "{}", layout.name);
    }
    // where the trunk has its own joints the skeleton is a tree
    for name in ["h36m17", "panoptic19", "occlusion_person15", "body25", "halpe26"] {
        let layout = Layout::by_name(name).unwrap();
        assert_eq!(layout.limbs.len(), layout.n_joints() - 1, "{name}");
    }
}

/// Two arms, valid.
fn arms() -> LayoutSpec {
    let joints = ["neck", "left_hand", "right_hand", "left_tip", "right_tip"];
    LayoutSpec {
        name: "arms".into(),
        joints: joints.map(String::from).to_vec(),
        limbs: vec![[0, 1], [0, 2], [1, 3], [2, 4]],
        symmetric: vec![SymmetricPair { tier: 1, left: [0, 1], right: [0, 2] }],
        left_right: vec![[1, 2], [3, 4]],
        occlusion_prone: vec![3, 4],
        root: vec![0],
        lengths: vec![KnownLength { limb: 2, mean_mm: 60.0, sigma_mm: 6.0 }],
        angles: vec![OwnAngle {
            name: "bend".into(),
            joints: vec![0, 1, 3],
            sign: -1.0,
            offset: 90.0,
        }],
        human: false,
    }
}

#[test]
fn a_layout_of_ones_own() {
    let layout = Layout::new(arms()).unwrap();
    assert_eq!(layout.symmetric_pairs(3).collect::<Vec<_>>(), [([0, 1], [0, 2])]);
    let bare = LayoutSpec { joints: vec!["tail".into()], ..LayoutSpec::default() };
    assert_eq!(Layout::new(bare).unwrap().n_joints(), 1);
}

#[test]
fn broken_layouts_are_refused() {
    type Break = fn(&mut LayoutSpec);
    let cases: [(Break, &str); 20] = [
        (|s| s.joints.clear(), "joints"),
        (|s| s.joints[2].clear(), "joints[2]"),
        (|s| s.joints[3] = "neck".into(), "joints[3]"),
        (|s| s.limbs[1][0] = 5, "limbs"),
        (|s| s.root.push(9), "root"),
        (|s| s.limbs.push([3, 3]), "limbs"),
        (|s| s.limbs.push([4, 2]), "limbs"),
        (|s| s.symmetric[0].tier = 4, "symmetric"),
        (|s| s.symmetric[0].right = [2, 2], "symmetric"),
        (|s| s.left_right.push([0, 1]), "left_right"),
        (|s| s.lengths[0].limb = 4, "lengths"),
        (|s| s.lengths.push(s.lengths[0]), "lengths"),
        (|s| s.lengths[0].mean_mm = 0.0, "lengths"),
        (|s| s.lengths[0].sigma_mm = f64::NAN, "lengths"),
        (|s| s.angles.push(s.angles[0].clone()), "angles[1]"),
        (|s| s.angles[0].joints.truncate(2), "angles.bend.joints"),
        (|s| s.angles[0].joints[2] = 5, "angles.bend.joints"),
        (|s| s.angles[0].joints[2] = 1, "angles.bend.joints"),
        (|s| s.angles[0].sign = 2.0, "angles.bend.sign"),
        (|s| s.angles[0].offset = f64::INFINITY, "angles.bend.offset"),
    ];
    for (break_it, field) in cases {
        let mut spec = arms();
        break_it(&mut spec);
        assert_eq!(refused(Layout::new(spec)), field);
    }
}

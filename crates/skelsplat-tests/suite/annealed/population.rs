//! Population bones in single frames.

use super::*;
use skelsplat_core::study::bones::population::proportions;
use skelsplat_core::{KnownLength, Layout, LayoutSpec};
use skelsplat_tests::refused;
use skelsplat_tests::scenes::not_human;

const ELBOW: usize = 12;

fn with_bones(cameras: &[Camera], detections: &Detections, bones: Bones) -> Refinement {
    let settings = AnnealedSettings { bones, ..AnnealedSettings::default() };
    refine(cameras, &detections.clone().into(), settings.into())
}

#[test]
fn every_human_layout_has_the_long_bones_and_others_have_none() {
    for name in Layout::NAMES {
        let layout = Layout::by_name(name).unwrap();
        let bones = proportions(&layout);
        let joint = |name: &str| layout.joints.iter().position(|j| j == name).unwrap();
        for (a, b, ratio) in
            [("left_elbow", "left_wrist", 0.146), ("right_hip", "right_knee", 0.245)]
        {
            let ends = [joint(a), joint(b)];
            let bone = bones.iter().find(|bone| ends.iter().all(|j| bone.joints.contains(j)));
            assert!((bone.unwrap().ratio - ratio).abs() < 1e-12, "{name}");
        }
        assert!(proportions(&not_human(&layout)).is_empty());
    }
}

#[test]
fn a_joint_that_one_view_sees_lies_on_its_ray_at_the_end_of_its_bone() {
    let cameras = room(4);
    let truth = standing();
    for view in 0..4 {
        let exact = exact_detections(&truth, &cameras);
        let seen = without(&exact, |i, j| j == WRIST && i != view);
        let found = with_bones(&cameras, &seen, Bones::Population);
        let at = found.pose[WRIST];
        let pixel = cameras[view].project(&at).unwrap();
        assert!((pixel - seen.get(view, WRIST).unwrap().0).norm() < 1.0);
        let long = (at - found.pose[ELBOW]).norm();
        assert!((long - (truth[WRIST] - truth[ELBOW]).norm()).abs() < 60.0, "{long}");
        assert_ne!(found.joint_status[WRIST], JointStatus::Ok);
        // The error bar covers both places on the ray.
        let off: Vector3<f64> = truth[WRIST] - at;
        let square = off.dot(&(found.uncertainty[WRIST].try_inverse().unwrap() * off));
        assert!(square < 9.0, "view {view}: {} sigma", square.sqrt());
        let alone = with_bones(&cameras, &seen, Bones::Free);
        assert!(alone.pose[WRIST].x.is_nan());
        assert_eq!(alone.joint_status[WRIST], JointStatus::Weak);
    }
}

#[test]
fn bones_decide_between_two_pairs_of_views() {
    let (cameras, mut noise) = (room(4), Noise::new(4));
    let truth = standing();
    let (mut with, mut without) = (0.0, 0.0);
    for _ in 0..20 {
        let seen = noisy_detections(&truth, &cameras, 2.0, &mut noise);
        // Views 2 and 3 agree on another place, half a metre above the wrist.
        let mut other = truth.clone();
        other[WRIST].z += 500.0;
        let wrong = exact_detections(&other, &cameras);
        let seen = changed(&seen, |i, j, p| match j == WRIST && i > 1 {
            true => wrong.get(i, j),
            false => Some((p, 1.0)),
        });
        let error = |bones| {
            let found = with_bones(&cameras, &seen, bones);
            (found.pose[WRIST] - truth[WRIST]).norm()
        };
        with += error(Bones::Population) / 20.0;
        without += error(Bones::Free) / 20.0;
    }
    assert!(with < 40.0 && without > 2.0 * with, "{with} mm with bones, {without} mm without");
}

#[test]
fn where_three_views_agree_bones_change_nothing() {
    let (cameras, mut noise) = (room(4), Noise::new(9));
    for _ in 0..20 {
        let seen = noisy_detections(&standing(), &cameras, 2.0, &mut noise);
        let (a, b) = (
            with_bones(&cameras, &seen, Bones::Population),
            with_bones(&cameras, &seen, Bones::Free),
        );
        assert_eq!(a.pose, b.pose);
        assert_eq!(a.uncertainty, b.uncertainty);
    }
}

#[test]
fn a_child_and_a_tall_person_are_not_pulled_to_the_average() {
    let (cameras, mut noise) = (room(4), Noise::new(12));
    for scale in [0.5, 1.2] {
        let truth: Vec<Vector3<f64>> = standing().iter().map(|x| x * scale).collect();
        let (mut with, mut without) = (0.0, 0.0);
        for k in 0..20 {
            let seen = noisy_detections(&truth, &cameras, 2.0, &mut noise);
            let hidden = [WRIST, ELBOW, 3, 6, 15][k % 5];
            let off = Vector2::new(60.0, -40.0);
            let seen = changed(&seen, |i, j, p| {
                Some((if j == hidden && i > 1 { p + off } else { p }, 1.0))
            });
            let error = |bones| {
                let found = with_bones(&cameras, &seen, bones);
                (found.pose[hidden] - truth[hidden]).norm()
            };
            with += error(Bones::Population);
            without += error(Bones::Free);
        }
        assert!(with <= without + 1.0, "scale {scale}: {with} with bones, {without} without");
    }
}

/// Positions in this layout.
fn solved(layout: &Layout, seen: &Detections, config: RefineConfig) -> Refinement {
    let refiner = Refiner::new(&room(4), Unit::Millimetre, Some(layout), config).unwrap();
    refiner.refine(&Frame::from(seen.clone())).unwrap()
}

fn with_lengths(lengths: &[f64], sigmas: Option<&[f64]>) -> RefineConfig {
    let bone_sigmas_mm = sigmas.map(<[f64]>::to_vec);
    let given = Some(lengths.to_vec());
    AnnealedSettings { bone_lengths_mm: given, bone_sigmas_mm, ..AnnealedSettings::default() }
        .into()
}

fn true_lengths() -> Vec<f64> {
    let truth = standing();
    h36m().limbs.iter().map(|[a, b]| (truth[*a] - truth[*b]).norm()).collect()
}

#[test]
fn given_lengths_place_the_joints_of_any_layout() {
    let (cameras, truth) = (room(4), standing());
    let seen = without(&exact_detections(&truth, &cameras), |i, j| j == WRIST && i != 1);
    let solve = |config: RefineConfig| solved(&not_human(&h36m()), &seen, config);
    assert!(solve(RefineConfig::default()).pose[WRIST].x.is_nan());
    let lengths = true_lengths();
    let found = solve(with_lengths(&lengths, Some(&[5.0; 16])));
    let bone = h36m().limbs.iter().position(|limb| *limb == [ELBOW, WRIST]).unwrap();
    let long = (found.pose[WRIST] - found.pose[ELBOW]).norm();
    assert!((long - lengths[bone]).abs() < 5.0, "{long} mm for {}", lengths[bone]);
    assert_ne!(found.joint_status[WRIST], JointStatus::Ok);
    // The same from the layout, which the settings replace.
    let length =
        |(limb, mean_mm): (usize, &f64)| KnownLength { limb, mean_mm: *mean_mm, sigma_mm: 5.0 };
    let known: Vec<KnownLength> = lengths.iter().enumerate().map(length).collect();
    let layout =
        Layout::new(LayoutSpec { lengths: known, ..(*not_human(&h36m())).clone() }).unwrap();
    let of_layout = |config: RefineConfig| solved(&layout, &seen, config).pose;
    assert_eq!(of_layout(RefineConfig::default()), found.pose);
    assert!(of_layout(with_lengths(&lengths, Some(&[1e4; 16])))[WRIST].x.is_nan());
    // A σ of the length's size: nothing is known.
    assert!(solve(with_lengths(&lengths, Some(&[1e4; 16]))).pose[WRIST].x.is_nan());
}

#[test]
fn given_lengths_that_contradict_three_views_change_nothing() {
    let (cameras, mut noise) = (room(4), Noise::new(9));
    let wrong: Vec<f64> = true_lengths().iter().map(|l| 1.4 * l).collect();
    let seen = noisy_detections(&standing(), &cameras, 2.0, &mut noise);
    let solve = |config: RefineConfig| solved(&not_human(&h36m()), &seen, config).pose;
    assert_eq!(solve(with_lengths(&wrong, None)), solve(RefineConfig::default()));
}

#[test]
fn wrong_lengths_are_named() {
    let refused = |config: RefineConfig, layout: Option<&Layout>, field: &str| {
        assert_eq!(refused(Refiner::new(&room(2), Unit::Millimetre, layout, config)), field);
    };
    let (lengths, own) = (true_lengths(), not_human(&h36m()));
    for (k, value) in [(3, -1.0), (4, f64::NAN), (5, 0.0), (6, f64::INFINITY)] {
        let mut wrong = lengths.clone();
        wrong[k] = value;
        let field = format!("config.bone_lengths_mm[{k}]");
        refused(with_lengths(&wrong, None), Some(&own), &field);
        let field = format!("config.bone_sigmas_mm[{k}]");
        refused(with_lengths(&lengths, Some(&wrong)), Some(&own), &field);
    }
    refused(with_lengths(&lengths[..3], None), Some(&own), "config.bone_lengths_mm");
    let few_sigmas = with_lengths(&lengths, Some(&lengths[..3]));
    refused(few_sigmas, Some(&own), "config.bone_sigmas_mm");
    refused(with_lengths(&lengths, None), None, "config.bone_lengths_mm");
    let sigmas =
        AnnealedSettings { bone_sigmas_mm: Some(lengths.clone()), ..AnnealedSettings::default() };
    refused(sigmas.clone().into(), Some(&own), "config.bone_sigmas_mm");
    let free = AnnealedSettings { bones: Bones::Free, bone_lengths_mm: Some(lengths), ..sigmas };
    refused(free.into(), Some(&own), "config.bones");
}

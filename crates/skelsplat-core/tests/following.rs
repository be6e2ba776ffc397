//! Frame-by-frame refinement: the state kept from previous frames.

use nalgebra::Vector3;
use skelsplat_core::testing::scenes::{exact_detections, room, standing};
use skelsplat_core::{
    AnnealedSettings, Bones, Camera, Detections, Follower, JointStatus, Layout, Progress,
    RefineConfig, Refiner, Unit,
};

fn refiner(cameras: &[Camera], config: RefineConfig) -> Refiner {
    let layout = Layout::by_name("h36m17").unwrap();
    Refiner::new(cameras, Unit::Millimetre, Some(&layout), config).unwrap()
}

fn moved(by: f64) -> Vec<Vector3<f64>> {
    standing().iter().map(|p| p + Vector3::new(by, 0.0, 0.0)).collect()
}

fn nothing() -> Detections {
    Detections::new(4, 17, &[f64::NAN; 2 * 4 * 17], None).unwrap()
}

#[test]
fn a_frame_without_detections_keeps_the_pose_before() {
    let cameras = room(4);
    let refiner = refiner(&cameras, RefineConfig::default());
    let mut follower = Follower::new(&refiner, None);
    let control = Progress::default();
    let first = follower.step(exact_detections(&standing(), &cameras), &control).unwrap();
    let second = follower.step(nothing(), &control).unwrap();
    assert!(second.joint_status.iter().all(|s| *s == JointStatus::Unobserved));
    assert_eq!(second.pose, first.pose);
    assert_eq!(follower.past(), Some(&first.pose[..]));
    follower.reset();
    let third = follower.step(nothing(), &control).unwrap();
    assert!(third.pose.iter().all(|p| p.x.is_nan()));
}

#[test]
fn a_weak_joint_that_leaps_leaves_the_old_position_behind() {
    let cameras = room(4);
    let refiner = refiner(
        &cameras,
        AnnealedSettings { bones: Bones::Free, ..AnnealedSettings::default() }.into(),
    );
    let mut past = moved(0.0);
    past[0].x += 1000.0;
    let mut pixels = Vec::new();
    let seen = exact_detections(&standing(), &cameras);
    for (i, j) in (0..4).flat_map(|i| (0..17).map(move |j| (i, j))) {
        // only one view sees joint 0: its depth comes from the past, and its ray is moved by 1 m
        let pixel = seen.get(i, j).filter(|_| j > 0 || i == 0);
        pixels.extend(pixel.map_or([f64::NAN; 2], |(p, _)| [p.x, p.y]));
    }
    let mut follower = Follower::new(&refiner, Some(past.clone()));
    let found = follower
        .step(Detections::new(4, 17, &pixels, None).unwrap(), &Progress::default())
        .unwrap();
    let leap = (found.pose[0] - past[0]).norm();
    assert_eq!(found.joint_status[0], JointStatus::Weak);
    assert!(leap > 300.0, "{leap}");
    let kept = follower.past().unwrap();
    assert_eq!(kept[0], past[0]);
    assert_eq!(kept[1..], found.pose[1..]);
}

#[test]
fn the_paper_s_method_triangulates_a_lost_pose_again() {
    let cameras = room(4);
    let refiner = refiner(&cameras, RefineConfig::paper());
    let far = exact_detections(&moved(1500.0), &cameras);
    let control = Progress::default();
    let expected = Follower::new(&refiner, None).step(far.clone(), &control).unwrap();
    let mut follower = Follower::new(&refiner, Some(standing()));
    assert_eq!(follower.step(far, &control).unwrap().pose, expected.pose);
}

#[test]
fn another_number_of_joints_is_refused() {
    let cameras = room(4);
    let refiner = Refiner::new(&cameras, Unit::Millimetre, None, RefineConfig::default()).unwrap();
    let mut follower = Follower::new(&refiner, Some(standing()[..3].to_vec()));
    let refused = follower.step(nothing(), &Progress::default()).unwrap_err().to_string();
    let expected =
        "detections: expected 3 joints, as in the previous frames (or call reset() first), got 17";
    assert_eq!(refused, expected);
}

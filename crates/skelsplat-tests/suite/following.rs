//! Frame-by-frame refinement: what is kept from previous frames.

use nalgebra::Vector3;
use skelsplat_core::{
    AnnealedSettings, Bones, Detections, JointStatus, Progress, RefineConfig, Refinement, Refiner,
    Unit, follow,
};
use skelsplat_tests::refused;
use skelsplat_tests::scenes::{exact_detections, refiner, room, standing, without};

type Points = Vec<Vector3<f64>>;

fn step(refiner: &Refiner, past: Option<Points>, seen: Detections) -> (Refinement, Points) {
    follow(refiner, past, seen, &Progress::default()).unwrap()
}

fn nothing() -> Detections {
    Detections::new(4, 17, &[f64::NAN; 2 * 4 * 17], None).unwrap()
}

#[test]
fn a_frame_without_detections_keeps_the_pose_before() {
    let cameras = room(4);
    let refiner = refiner(&cameras, RefineConfig::default());
    let (first, past) = step(&refiner, None, exact_detections(&standing(), &cameras));
    let (second, past) = step(&refiner, Some(past), nothing());
    assert!(second.joint_status.iter().all(|s| *s == JointStatus::Unobserved));
    assert_eq!([&second.pose, &past], [&first.pose; 2]);
    assert!(step(&refiner, None, nothing()).0.pose.iter().all(|p| p.x.is_nan()));
}

#[test]
fn a_weak_joint_that_leaps_leaves_the_old_position_behind() {
    let cameras = room(4);
    let free = AnnealedSettings { bones: Bones::Free, ..AnnealedSettings::default() };
    let mut past = standing();
    past[0].x += 1000.0;
    // Only one view sees joint 0: its depth comes from the past, and its ray is moved by 1 m.
    let seen = without(&exact_detections(&standing(), &cameras), |i, j| j == 0 && i > 0);
    let (found, kept) = step(&refiner(&cameras, free), Some(past.clone()), seen);
    assert_eq!(found.joint_status[0], JointStatus::Weak);
    assert!((found.pose[0] - past[0]).norm() > 300.0);
    assert_eq!(kept[0], past[0]);
    assert_eq!(kept[1..], found.pose[1..]);
}

#[test]
fn the_paper_s_method_triangulates_a_lost_pose_again() {
    let cameras = room(4);
    let refiner = refiner(&cameras, RefineConfig::paper());
    let away: Points = standing().iter().map(|p| p + Vector3::new(1500.0, 0.0, 0.0)).collect();
    let far = exact_detections(&away, &cameras);
    let expected = step(&refiner, None, far.clone());
    assert_eq!(step(&refiner, Some(standing()), far).0.pose, expected.0.pose);
}

#[test]
fn another_number_of_joints_is_refused() {
    let refiner = Refiner::new(&room(4), Unit::Millimetre, None, RefineConfig::default()).unwrap();
    let few = Some(standing()[..3].to_vec());
    assert_eq!(refused(follow(&refiner, few, nothing(), &Progress::default())), "detections");
}

//! What must not matter: where the world's origin is and how it is turned, the order of the
//! cameras, the unit, the number of threads.

use nalgebra::{Rotation3, Vector3};
use proptest::prelude::*;
use skelsplat_core::study::annealed::consensus::REJECTED;
use skelsplat_core::{
    Camera, Detections, Frame, JointStatus, Progress, Refinement, Refiner, Unit, refine_sequence,
};
use skelsplat_tests::scenes::{h36m, room};

use super::any::{config, spoiled, threaded, wrong};

/// Positions of sure joints of two results differ by less, mm: rounding, as a consequence of other
/// sums.
const SAME: f64 = 1e-6;
/// Positions of others: the depth of a weak joint is held by a prior of half a metre, which
/// magnifies rounding.
const NEARLY: f64 = 0.1;
/// Shares of the error bars: of sure joints beside weak ones, and of weak joints.
const UNFELT: f64 = 1.0;
const WITHIN: f64 = 3.0;

/// Cameras, and detections that are wrong. Which of two views is wrong only the bones tell, and
/// rounding may decide between two places that are as good (an open limit): two
/// views have no wrong detections, and do not face each other.
fn decided(views: u32, wrong: Vec<(usize, f64)>) -> (Vec<Camera>, Vec<(usize, f64)>) {
    if views > 2 { (room(views), wrong) } else { (room(5)[..2].to_vec(), Vec::new()) }
}

fn frame(cameras: &[Camera], seen: &Detections) -> Refinement {
    threaded(cameras, 1).refine(&Frame::from(seen.clone())).unwrap()
}

/// Whether at most one detection agrees with a joint, which its bones then place on that ray.
fn on_one_ray(found: &Refinement, j: usize) -> bool {
    let n = found.pose.len();
    found.view_weights.iter().skip(j).step_by(n).filter(|k| **k >= REJECTED).count() < 2
}

/// Positions are those of the other result. Where two places of a weak joint are as good, rounding
/// may decide between them: both lie within its error bar, and joints that are sure stay within
/// theirs. Where no two detections agree, the bar does not know of the others.
fn same(
    one: &Refinement,
    other: &Refinement,
    to_one: impl Fn(&Vector3<f64>) -> Vector3<f64>,
) -> Result<(), TestCaseError> {
    prop_assert_eq!(&one.joint_status, &other.joint_status);
    let joints = 0..one.pose.len();
    let off: Vec<f64> =
        joints.clone().map(|j| (one.pose[j] - to_one(&other.pose[j])).norm()).collect();
    let sure = |j: usize| one.joint_status[j] == JointStatus::Ok;
    let undecided = joints.clone().any(|j| !sure(j));
    for j in joints.filter(|j| !(one.pose[*j].x.is_nan() && other.pose[*j].x.is_nan())) {
        let spread = one.uncertainty[j].symmetric_eigenvalues().max().sqrt();
        let most = match (sure(j), undecided) {
            (true, false) => SAME,
            (true, true) => UNFELT * spread,
            (false, _) if on_one_ray(one, j) || on_one_ray(other, j) => f64::INFINITY,
            (false, _) => NEARLY.max(WITHIN * spread),
        };
        prop_assert!(off[j] < most, "joint {j}: {} mm, {:?}", off[j], one.joint_status[j]);
    }
    Ok(())
}

proptest! {
    #![proptest_config(config(8))]

    #[test]
    fn the_worlds_frame_does_not_matter(
        views in 2..=6_u32, seed in any::<u32>(), sigma in 0.5..8.0_f64, wrong in wrong(12),
        turn in prop::array::uniform3(-3.0..3.0_f64),
        shift in prop::array::uniform3(-5000.0..5000.0_f64),
    ) {
        let (cameras, wrong) = decided(views, wrong);
        let seen = spoiled(&cameras, u64::from(seed), sigma, &wrong);
        let (turn, shift) = (Rotation3::new(Vector3::from(turn)), Vector3::from(shift));
        let moved: Vec<Camera> = cameras.iter().map(|c| {
            let r = c.rotation() * turn.matrix().transpose();
            let t = c.translation() - r * shift;
            Camera::new(&c.k(), &r, &t, c.size()).unwrap()
        }).collect();
        same(&frame(&cameras, &seen), &frame(&moved, &seen), |x| turn.inverse() * (x - shift))?;
    }

    #[test]
    fn the_order_of_the_cameras_does_not_matter(
        views in 2..=6_u32, seed in any::<u32>(), sigma in 0.5..8.0_f64, wrong in wrong(12),
        order in any::<prop::sample::Index>(),
    ) {
        let (cameras, wrong) = decided(views, wrong);
        let seen = spoiled(&cameras, u64::from(seed), sigma, &wrong);
        let (m, n) = (cameras.len(), seen.n_joints());
        let stride = if m == 5 { 2 } else { m - 1 };
        let order: Vec<usize> = (0..m).map(|i| (i * stride + order.index(m)) % m).collect();
        let others: Vec<Camera> = order.iter().map(|i| cameras[*i].clone()).collect();
        let pixel = |k| seen.get(order[k / n], k % n).map_or([f64::NAN; 2], |(p, _)| p.into());
        let pixels: Vec<f64> = (0..m * n).flat_map(pixel).collect();
        let turned = Detections::new(m, n, &pixels, None).unwrap();
        same(&frame(&cameras, &seen), &frame(&others, &turned), |x| *x)?;
    }

    #[test]
    fn the_unit_does_not_matter(views in 2..=6_u32, seed in any::<u32>(), wrong in wrong(12)) {
        let (cameras, wrong) = decided(views, wrong);
        let seen = spoiled(&cameras, u64::from(seed), 3.0, &wrong);
        let in_metres: Vec<Camera> =
            cameras.iter().map(|c| c.clone().with_length_scale(1e-3)).collect();
        let config = threaded(&cameras, 1).config().clone();
        let metres = Refiner::new(&in_metres, Unit::Metre, Some(&h36m()), config).unwrap();
        let other = metres.refine(&Frame::from(seen.clone())).unwrap();
        same(&frame(&cameras, &seen), &other, |x| x * 1000.0)?;
    }

    #[test]
    fn the_number_of_threads_does_not_matter(
        views in 2..=5_u32, seed in any::<u32>(), wrong in wrong(80),
    ) {
        let cameras = room(views);
        let frame = |k: u64| spoiled(&cameras, u64::from(seed) + k, 3.0, &wrong).into();
        let frames: Vec<Frame> = (0..8).map(frame).collect();
        let solve = |threads| {
            let refiner = threaded(&cameras, threads);
            refine_sequence(&refiner, &frames, 30.0, &Progress::default()).unwrap()
        };
        prop_assert_eq!(format!("{:?}", solve(1)), format!("{:?}", solve(3)));
    }
}

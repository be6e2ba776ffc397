//! A live loop at a known frame rate: the past predicts, the detections decide.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use skelsplat_core::study::sequence::live::filter::KalmanState;
use skelsplat_core::{
    Camera, Detections, JointStatus, Live, Progress, RefineConfig, Refinement, Refiner, Unit,
};
use skelsplat_tests::refused;
use skelsplat_tests::scenes::{
    Noise, mean_error, noisy_detections, refiner, room, standing, without,
};

const FPS: f64 = 30.0;

/// A walk along x at 1.2 m/s; the left arm swings.
fn walking(t: usize) -> Vec<Vector3<f64>> {
    let time = t as f64 / FPS;
    let swing = 150.0 * (6.0 * time).sin();
    let mut pose = standing();
    pose.iter_mut().for_each(|p| p.x += 1200.0 * time - 600.0);
    pose[13].x += swing;
    pose
}

fn seen(pose: &[Vector3<f64>], cameras: &[Camera], noise: &mut Noise) -> Detections {
    noisy_detections(pose, cameras, 2.0, noise)
}

fn steps(live: &mut Live, refiner: &Refiner, frames: &[Detections]) -> Vec<Refinement> {
    let step = |d: &Detections| live.step(refiner, d.clone(), &Progress::default()).unwrap();
    frames.iter().map(step).collect()
}

fn at_rate(refiner: &Refiner, lag: usize) -> Live {
    Live::new(refiner, FPS, lag).unwrap()
}

fn recording(n: usize, cameras: &[Camera], seed: u64) -> Vec<Detections> {
    let mut noise = Noise::new(seed);
    (0..n).map(|t| seen(&walking(t), cameras, &mut noise)).collect()
}

/// The debug text has every bit, and NaN equals NaN.
fn same(a: &[Refinement], b: &[Refinement]) -> bool {
    format!("{a:?}") == format!("{b:?}")
}

#[test]
fn the_state_is_that_of_a_kalman_filter_in_six_dimensions() {
    let mut noise = Noise::new(5);
    let some = |noise: &mut Noise| {
        let a = Matrix3::from_fn(|_, _| noise.normal());
        a * a.transpose() * 40.0 + Matrix3::identity()
    };
    let mut state = KalmanState::new(noise.vector(300.0), some(&mut noise));
    let mut x = Vector6::zeros();
    let mut p = Matrix6::zeros();
    x.fixed_rows_mut::<3>(0).copy_from(&state.at);
    p.fixed_view_mut::<3, 3>(0, 0).copy_from(&state.position);
    p.fixed_view_mut::<3, 3>(3, 3).copy_from(&state.speed);
    let (dt, q) = (0.04_f64, 2e6);
    let one = Matrix3::identity();
    let mut f = Matrix6::identity();
    f.fixed_view_mut::<3, 3>(0, 3).copy_from(&(one * dt));
    let mut w = Matrix6::zeros();
    for (r, c, v) in
        [(0, 0, dt.powi(3) / 3.0), (0, 3, dt * dt / 2.0), (3, 0, dt * dt / 2.0), (3, 3, dt)]
    {
        w.fixed_view_mut::<3, 3>(r, c).copy_from(&(one * (q * v)));
    }
    for _ in 0..5 {
        state.predict(dt, q);
        (x, p) = (f * x, f * p * f.transpose() + w);
        let (y, r) = (state.at + noise.vector(20.0), some(&mut noise));
        let s = p.fixed_view::<3, 3>(0, 0) + r;
        let gain = p.fixed_columns::<3>(0) * s.try_inverse().unwrap();
        x += gain * (y - x.fixed_rows::<3>(0));
        p -= gain * s * gain.transpose();
        let prior = state.position.try_inverse().unwrap();
        let seen = r.try_inverse().unwrap();
        let spread = (prior + seen).try_inverse().unwrap();
        state.update(spread * (prior * state.at + seen * y), spread);
        assert!((state.at - x.fixed_rows::<3>(0)).norm() < 1e-8);
        assert!((state.velocity - x.fixed_rows::<3>(3)).norm() < 1e-6);
        assert!((state.cross - p.fixed_view::<3, 3>(0, 3)).amax() < 1e-6 * p.amax());
        assert!((state.speed - p.fixed_view::<3, 3>(3, 3)).amax() < 1e-6 * p.amax());
    }
}

#[test]
fn noise_is_averaged_and_a_lag_averages_more() {
    let cameras = room(4);
    let refiner = refiner(&cameras, RefineConfig::default());
    let frames = recording(60, &cameras, 1);
    let mean = |found: &[Refinement], lag: usize| {
        let own =
            found.iter().enumerate().skip(20).map(|(t, r)| mean_error(&r.pose, &walking(t - lag)));
        own.sum::<f64>() / (found.len() - 20) as f64
    };
    let alone = mean(
        &frames.iter().map(|d| refiner.refine(&d.clone().into()).unwrap()).collect::<Vec<_>>(),
        0,
    );
    let live = mean(&steps(&mut at_rate(&refiner, 0), &refiner, &frames), 0);
    let late = steps(&mut at_rate(&refiner, 8), &refiner, &frames);
    assert!(live < 0.8 * alone, "{live} {alone}");
    assert!(mean(&late, 8) < 0.8 * live, "{} {live}", mean(&late, 8));
    assert!(late[7].pose.iter().all(|p| p.x.is_nan()));
    assert!(late[7].joint_status.iter().all(|s| *s == JointStatus::Unobserved));
    assert!(late[8].pose.iter().all(|p| p.x.is_finite()));
}

#[test]
fn half_a_second_is_bridged_with_honest_bars_and_no_more() {
    let cameras = room(4);
    let refiner = refiner(&cameras, RefineConfig::default());
    let mut live = at_rate(&refiner, 0);
    let frames: Vec<Detections> = recording(60, &cameras, 3)
        .iter()
        .enumerate()
        .map(|(t, d)| without(d, |_, joint| t >= 40 && joint == 13))
        .collect();
    let found = steps(&mut live, &refiner, &frames);
    let mut before = 0.0;
    for (t, found) in found.iter().enumerate().skip(40).take(15) {
        let off = found.pose[13] - walking(t)[13];
        let bar = found.uncertainty[13];
        assert_eq!(found.joint_status[13], JointStatus::Inferred);
        assert!(off.dot(&(bar.try_inverse().unwrap() * off)) < 9.0, "{t}: {off} {bar}");
        assert!(bar.trace() > before);
        before = bar.trace();
    }
    let lost = &found[59];
    assert_eq!(lost.joint_status[13], JointStatus::Unobserved);
    assert_eq!(lost.pose[13], found[39].pose[13]);
    assert!(lost.uncertainty[13].trace().is_nan());
}

#[test]
fn an_answer_depends_on_no_later_frame() {
    let cameras = room(4);
    let refiner = refiner(&cameras, RefineConfig::default());
    let frames = recording(30, &cameras, 6);
    for lag in [0, 4] {
        let whole = steps(&mut at_rate(&refiner, lag), &refiner, &frames);
        let again = steps(&mut at_rate(&refiner, lag), &refiner, &frames[..20]);
        assert!(same(&whole[..20], &again));
    }
}

#[test]
fn a_reset_forgets_everything_and_bad_input_nothing() {
    let cameras = room(4);
    let refiner = refiner(&cameras, RefineConfig::default());
    let frames = recording(10, &cameras, 7);
    let mut live = at_rate(&refiner, 0);
    let first = steps(&mut live, &refiner, &frames[..1]);
    let before = steps(&mut live.clone(), &refiner, &frames[1..]);
    let plain = Refiner::new(&cameras, Unit::Millimetre, None, RefineConfig::default()).unwrap();
    let mut other = at_rate(&plain, 0);
    steps(&mut other, &plain, &frames[..1]);
    let few = Detections::new(4, 3, &[f64::NAN; 24], None).unwrap();
    assert_eq!(refused(other.step(&plain, few, &Progress::default())), "detections");
    assert!(same(&before, &steps(&mut live, &refiner, &frames[1..])));
    live.reset();
    assert!(same(&first, &steps(&mut live, &refiner, &frames[..1])));
}

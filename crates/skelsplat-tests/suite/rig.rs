//! Cameras set right: derivatives, faults of one camera, and what must not change.

use nalgebra::{Rotation3, Vector2, Vector3};
use skelsplat_core::study::rig::evidence::{excess, log_odds};
use skelsplat_core::study::rig::placed::{PARAMETERS, Sight, Step};
use skelsplat_core::study::rig::{Change, Placed};
use skelsplat_core::{
    Adjustable, Camera, CameraStatus, Detections, Distortion, Error, Filmed, Progress,
    RefineConfig, RigAdjustment, Unit, adjust_cameras,
};
use skelsplat_tests::differences::{central_differences, relative_error};
use skelsplat_tests::refused;
use skelsplat_tests::scenes::{Noise, room, standing};

const FRAMES: usize = 60;
const WITH_CLOCKS: Adjustable = Adjustable { free: None, focal: false, clock: true };

/// A person who walks a loop, turns and swings the arms, at a time in frames.
fn body(t: f64) -> Vec<Vector3<f64>> {
    let (phase, turn) = (0.1 * t, Rotation3::from_euler_angles(0.0, 0.0, 0.08 * t));
    let at = Vector3::new(900.0 * phase.sin(), 700.0 * (1.3 * phase).cos(), 0.0);
    let swing = |j: usize| Vector3::new(0.0, 90.0 * (3.0 * phase + j as f64).sin(), 0.0);
    standing().into_iter().enumerate().map(|(j, x)| turn * (x + swing(j)) + at).collect()
}

/// Pixels of `body(time)`, of which view i is `late[i]` frames ahead, moved by `error()`.
fn seen(
    cameras: &[Camera],
    late: &[f64],
    body: impl Fn(f64) -> Vec<Vector3<f64>>,
    mut error: impl FnMut(usize) -> f64,
) -> Vec<Detections> {
    let mut frame = |t: usize| {
        let mut pixels: Vec<f64> = Vec::new();
        for (camera, late) in cameras.iter().zip(late) {
            for joint in body(t as f64 - late) {
                for u in &camera.project(&joint).unwrap() {
                    pixels.push(u + error(pixels.len()));
                }
            }
        }
        Detections::new(cameras.len(), 17, &pixels, None).unwrap()
    };
    (0..FRAMES).map(&mut frame).collect()
}

/// Detections of a walk with noise of `sigma` px.
fn recording(cameras: &[Camera], late: &[f64], sigma: f64) -> Vec<Detections> {
    let mut noise = Noise::new(5);
    seen(cameras, late, body, |_| sigma * noise.normal())
}

/// The rig with one camera turned by so many radians and moved, mm.
fn moved(rig: &[Camera], view: usize, turn: [f64; 3], shift: [f64; 3]) -> Vec<Camera> {
    let (mut rig, old) = (rig.to_vec(), &rig[view]);
    let rotation = Rotation3::new(Vector3::from(turn)) * old.rotation();
    let centre = old.centre() + Vector3::from(shift);
    rig[view] = Camera::new(&old.k(), &rotation, &(-(rotation * centre)), old.size()).unwrap();
    rig
}

fn times(frames: &[Detections]) -> Vec<usize> {
    (0..frames.len()).collect()
}

fn adjusted(given: &[Camera], frames: &[Detections], what: &Adjustable) -> RigAdjustment {
    let (config, times) = (RefineConfig::default(), times(frames));
    let filmed = Filmed { frames, times: &times };
    adjust_cameras(given, Unit::Millimetre, filmed, what, &config, &Progress::default()).unwrap()
}

fn status(found: &RigAdjustment) -> Vec<CameraStatus> {
    found.report.iter().map(|one| one.status).collect()
}

/// Angle between two cameras, rad, and distance, mm.
fn apart(a: &Camera, b: &Camera) -> (f64, f64) {
    let turn = Rotation3::from_matrix_unchecked(a.rotation() * b.rotation().transpose());
    (turn.angle(), (a.centre() - b.centre()).norm())
}

#[test]
fn derivatives_are_those_of_the_residual() {
    let lens = Distortion::brown_conrady(&[-0.2, 0.08, 1e-3, -2e-3, 0.01]).unwrap();
    let camera = room(4).remove(1).with_distortion(lens);
    let placed = Placed { camera, clock: 2.0 };
    let x = Vector3::new(350.0, -420.0, 1350.0);
    let (pixel, speed) = (Vector2::new(512.0, 380.0), Vector2::new(7.0, -3.5));
    let seen = |clock: f64| Sight { pixel: pixel + speed * (clock - 2.0), speed, confidence: 1.0 };
    let exact = placed.residual(&x, &seen(2.0)).unwrap();
    for row in 0..2 {
        let points = central_differences(x.as_slice(), 1e-3, |at| {
            placed.residual(&Vector3::from_column_slice(at), &seen(2.0)).unwrap().value[row]
        });
        let own: Vec<f64> = exact.by_point.row(row).iter().copied().collect();
        assert!(relative_error(&own, &points) < 1e-8);
        // In steps of the parameters' own sizes: rad, mm, relative, frames.
        for (k, h) in [1e-5, 1e-5, 1e-5, 1e-2, 1e-2, 1e-2, 1e-5, 1e-3, 1e-5].into_iter().enumerate()
        {
            let slope = central_differences(&[0.0], h, |at| {
                let mut step = Step::zeros();
                step[k] = at[0];
                let there = placed.stepped(&step).unwrap();
                there.residual(&x, &seen(there.clock)).unwrap().value[row]
            });
            assert!((exact.by_camera[(row, k)] - slope[0]).abs() <= 1e-7 * slope[0].abs().max(1.0));
        }
    }
    assert_eq!(exact.by_camera.ncols(), PARAMETERS);
}

#[test]
fn a_step_is_the_change_between_two_cameras() {
    let old = Placed { camera: room(4).remove(2), clock: 0.0 };
    let step = Step::from_column_slice(&[0.02, -0.01, 0.03, 12.0, -7.0, 30.0, 0.01, 0.4, -0.05]);
    let change = Change::between(&old, &old.stepped(&step).unwrap());
    for k in 0..PARAMETERS {
        assert!((change.parameter(k) - step[k]).abs() < 1e-9, "{k}");
    }
    assert_eq!(old.stepped(&Step::zeros()).unwrap(), old);
}

#[test]
fn a_camera_that_was_knocked_is_found_and_set_right() {
    let truth = room(4);
    let given = moved(&truth, 2, [0.03, -0.02, 0.01], [80.0, -40.0, 60.0]);
    let found = adjusted(&given, &recording(&truth, &[0.0; 4], 2.0), &Adjustable::default());
    let (sound, adjusted) = (CameraStatus::Sound, CameraStatus::Adjusted);
    assert_eq!(status(&found), [sound, sound, adjusted, sound]);
    let (turn, shift) = apart(&found.cameras[2], &truth[2]);
    let bars = found.report[2].bars;
    assert!(turn < 2.0 * bars.turn && turn < 0.004, "{turn} {}", bars.turn);
    assert!(shift < 2.0 * bars.shift && shift < 12.0, "{shift} {}", bars.shift);
    assert!(found.report[2].before > 30.0 && found.report[2].after < 5.0);
    let sound = |rig: &[Camera]| [0, 1, 3].map(|i| rig[i].clone());
    assert_eq!(sound(&found.cameras), sound(&given), "sound cameras stay to the bit");
}

/// Of four cameras one may be corrected, or no majority would stay. Another that is wrong pulls at
/// all of them, so which it is may be mistaken, but something is said to be wrong.
#[test]
fn a_camera_that_is_wrong_besides_leaves_a_doubt() {
    let truth = room(4);
    let given = moved(&truth, 2, [0.06, -0.04, 0.02], [0.0; 3]);
    let given = moved(&given, 0, [0.0, 0.02, 0.0], [0.0; 3]);
    let found = adjusted(&given, &recording(&truth, &[0.0; 4], 2.0), &Adjustable::default());
    assert_eq!(found.report[2].status, CameraStatus::Adjusted);
    let doubtful: Vec<usize> =
        (0..4).filter(|i| found.report[*i].status == CameraStatus::Doubtful).collect();
    assert!(!doubtful.is_empty());
    assert!(doubtful.iter().all(|i| found.cameras[*i] == given[*i]), "it is not applied");
}

#[test]
fn a_sound_rig_stays() {
    let truth = room(3);
    let found = adjusted(&truth, &recording(&truth, &[0.0; 3], 3.0), &Adjustable::default());
    assert_eq!(status(&found), [CameraStatus::Sound; 3]);
    assert_eq!(found.cameras, truth);
    // What a fault may be all the same.
    assert!(found.report.iter().all(|one| one.bars.turn > 0.0 && one.bars.turn < 0.02));
    assert!(found.report.iter().all(|one| one.before == one.after));
}

/// The error bars are those of the cameras as they are returned, also of one that stays although
/// another clock fits better.
#[test]
fn faults_too_small_to_be_told_are_within_the_error_bars() {
    let truth = room(4);
    for late in [0.06, 0.12, 0.18] {
        let found = adjusted(&truth, &recording(&truth, &[0.0, 0.0, 0.0, late], 6.0), &WITH_CLOCKS);
        assert_eq!(status(&found), [CameraStatus::Sound; 4]);
        let bar = found.report[3].bars.clock;
        assert!(late < 2.0 * bar && bar < 0.2, "{late} {bar}");
    }
}

#[test]
fn a_late_camera_is_told_from_one_that_was_moved() {
    let truth = room(4);
    let frames = recording(&truth, &[0.0, 3.4, 0.0, 0.0], 2.0);
    let found = adjusted(&truth, &frames, &Adjustable::default());
    assert_eq!((found.report[1].status, &found.cameras), (CameraStatus::Late, &truth));
    let found = adjusted(&truth, &frames, &WITH_CLOCKS);
    assert_eq!((found.report[1].status, &found.cameras), (CameraStatus::Late, &truth));
    let off = (found.report[1].change.clock - 3.4).abs();
    assert!(off < 0.1 && off < 2.0 * found.report[1].bars.clock + 0.05, "{off}");
    assert_eq!(found.report[1].change.turn, Vector3::zeros());
}

/// A movement that repeats itself every 12 frames fits 12 frames earlier or later as well.
#[test]
fn clocks_a_period_apart_are_tied() {
    let truth = room(4);
    let bend = |t: f64| {
        let depth = 0.15 * (std::f64::consts::TAU * t / 12.0).sin();
        let low = |x: Vector3<f64>| Vector3::new(x.x, x.y, x.z * (1.0 - depth));
        standing().into_iter().map(low).collect()
    };
    for late in [3.0, -2.0] {
        let mut noise = Noise::new(5);
        let frames = seen(&truth, &[0.0, late, 0.0, 0.0], bend, |_| 2.0 * noise.normal());
        let found = adjusted(&truth, &frames, &WITH_CLOCKS);
        let sound = CameraStatus::Sound;
        assert_eq!(status(&found), [sound, CameraStatus::Doubtful, sound, sound]);
        assert!((found.report[1].change.clock - late).abs() < 0.2, "the nearest");
        assert!(found.report.iter().all(|one| one.bars.clock > 6.0));
    }
}

#[test]
fn who_stands_still_tells_no_clock() {
    let (truth, mut noise) = (room(4), Noise::new(5));
    let frames = seen(&truth, &[0.0, 5.0, 0.0, 0.0], |_| standing(), |_| 2.0 * noise.normal());
    let found = adjusted(&truth, &frames, &WITH_CLOCKS);
    assert_eq!(status(&found), [CameraStatus::Sound; 4]);
    assert!(found.report.iter().all(|one| one.bars.clock > 5.0));
}

#[test]
fn odds_are_a_ratio_of_likelihoods() {
    let (before, after) = ([3.0, 1.5, 4.0, 2.0], [2.0, 1.0, 2.5, 2.2]);
    let squares =
        |mean: f64| -> f64 { (0..4).map(|k| before[k] - after[k] - mean).map(|d| d * d).sum() };
    let expected = 2.0 * (squares(0.0) / squares(0.7)).ln();
    assert!((log_odds(excess(&before, &after), 4) - expected).abs() < 1e-12);
    assert!((log_odds(excess(&after, &before), 4) + expected).abs() < 1e-12);
}

/// Clocks are known up to one that all share, and by motion, which a turned camera shows as well.
#[test]
fn every_clock_may_be_off_and_a_camera_turned_besides() {
    let truth = room(4);
    let late = [3.0, 7.0, -4.0, 9.0];
    let given = moved(&truth, 2, [0.0, 0.03, 0.0], [0.0; 3]);
    let found = adjusted(&given, &recording(&truth, &late, 2.0), &Adjustable::default());
    let ahead = |i: usize| found.report[i].change.clock - late[i];
    for (i, one) in found.report.iter().enumerate() {
        assert!((ahead(i) - ahead(0)).abs() < 0.1, "camera {i}: {}", ahead(i) - ahead(0));
        let expected = match i {
            2 => CameraStatus::Adjusted,
            _ if one.change.clock == 0.0 => CameraStatus::Sound,
            _ => CameraStatus::Late,
        };
        assert_eq!(one.status, expected, "camera {i}");
    }
    assert!(apart(&found.cameras[2], &truth[2]).0 < 0.003);
}

#[test]
fn a_focal_length_is_adjusted_on_request() {
    let truth = room(4);
    let frames = recording(&truth, &[0.0; 4], 1.0);
    let mut k = truth[0].k();
    k[(0, 0)] *= 1.03;
    k[(1, 1)] *= 1.03;
    let mut given = truth.clone();
    given[0] =
        Camera::new(&k, truth[0].rotation(), truth[0].translation(), truth[0].size()).unwrap();
    let found = adjusted(&given, &frames, &Adjustable { focal: true, ..Adjustable::default() });
    assert_eq!(found.report[0].status, CameraStatus::Adjusted);
    let [focal, ..] = found.cameras[0].focal();
    let bar = found.report[0].bars.zoom;
    assert!((focal / truth[0].focal()[0] - 1.0).abs() < (2.0 * bar).min(0.01), "{focal} {bar}");
}

#[test]
fn two_cameras_do_not_tell_which_is_wrong() {
    let pair = room(5)[..2].to_vec();
    let given = moved(&pair, 0, [0.02, 0.0, 0.0], [0.0; 3]);
    let found = adjusted(&given, &recording(&pair, &[0.0; 2], 1.0), &Adjustable::default());
    assert_eq!(found.cameras, given);
    assert_eq!(status(&found), [CameraStatus::Unseen; 2]);
}

#[test]
fn lengths_are_in_the_unit_of_the_cameras_and_threads_do_not_matter() {
    let truth = room(4);
    let frames = recording(&truth, &[0.0; 4], 2.0);
    let given = moved(&truth, 3, [0.02, 0.03, 0.0], [0.0, 90.0, 0.0]);
    let what = Adjustable::default();
    let mm = adjusted(&given, &frames, &what);
    let metres: Vec<Camera> = given.iter().map(|c| c.clone().with_length_scale(1e-3)).collect();
    let run = |n_threads| {
        let config = RefineConfig { n_threads, ..RefineConfig::default() };
        let filmed = Filmed { frames: &frames, times: &times(&frames) };
        adjust_cameras(&metres, Unit::Metre, filmed, &what, &config, &Progress::default()).unwrap()
    };
    let m = run(Some(1));
    // In words, as NaN is not equal to itself.
    assert_eq!(format!("{m:?}"), format!("{:?}", run(Some(3))));
    assert!((mm.report[3].change.shift / 1e3 - m.report[3].change.shift).norm() < 1e-7);
    assert!((mm.cameras[3].centre() / 1e3 - m.cameras[3].centre()).norm() < 1e-7);
}

#[test]
fn arguments_are_checked() {
    let cameras = room(3);
    let frames = recording(&cameras, &[0.0; 3], 1.0);
    let progress = Progress::default();
    let call = |cameras: &[Camera], frames: &[Detections], free: Option<Vec<usize>>| {
        let what = Adjustable { free, ..Adjustable::default() };
        let config = RefineConfig::default();
        let filmed = Filmed { frames, times: &times(frames) };
        adjust_cameras(cameras, Unit::Millimetre, filmed, &what, &config, &progress)
    };
    assert_eq!(refused(call(&cameras[..1], &frames, None)), "cameras");
    assert_eq!(refused(call(&cameras, &[], None)), "detections");
    assert_eq!(refused(call(&cameras[..2], &frames, None)), "detections");
    assert_eq!(refused(call(&cameras, &frames, Some(vec![3]))), "free");
    assert_eq!(refused(call(&cameras, &frames, Some(vec![0, 1, 2]))), "free");
    progress.cancel();
    assert_eq!(call(&cameras, &frames, None).unwrap_err(), Error::Cancelled);
}

#[test]
fn nothing_seen_is_said() {
    let cameras = room(3);
    let frames = vec![Detections::new(3, 17, &[f64::NAN; 3 * 17 * 2], None).unwrap(); 20];
    let found = adjusted(&cameras, &frames, &Adjustable::default());
    assert_eq!(status(&found), [CameraStatus::Unseen; 3]);
    assert_eq!(found.cameras, cameras);
    assert!(found.report.iter().all(|one| one.before.is_nan()));
}

/// A person who walks in a line: a detector's error that stays looks like another clock of its
/// joint.
#[test]
fn errors_that_last_are_no_clock_and_hide_none() {
    let cameras = room(4);
    for late in [0.0, 0.4] {
        let mut noise = Noise::new(8);
        let offsets: Vec<f64> = (0..cameras.len() * 34).map(|_| 4.0 * noise.normal()).collect();
        let line = |time: f64| -> Vec<Vector3<f64>> {
            let along = |j: usize| 25.0 * time + 120.0 * (0.25 * time + j as f64).sin();
            let joints = standing().into_iter().enumerate();
            joints.map(|(j, x)| x + along(j) * Vector3::x()).collect()
        };
        let late_by = [0.0, 0.0, late, 0.0];
        let frames = seen(&cameras, &late_by, line, |k| offsets[k] + 2.0 * noise.normal());
        let found = adjusted(&cameras, &frames, &WITH_CLOCKS);
        for (i, one) in found.report.iter().enumerate() {
            let wrong = i == 2 && late > 0.0;
            let expected = if wrong { CameraStatus::Late } else { CameraStatus::Sound };
            assert_eq!(one.status, expected, "camera {i}, {late} frames late");
            let left = if wrong { late - one.change.clock } else { 0.0 };
            assert!(left.abs() < 2.0 * one.bars.clock, "{left} ± {}", one.bars.clock);
            assert!(one.bars.clock < 0.06, "± {}", one.bars.clock);
        }
    }
}

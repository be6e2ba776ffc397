//! One valid call, one thing broken at a time: the type of the error and its text.

use std::sync::atomic::AtomicBool;

use skelsplat_core::Error;
use skelsplat_core::detections::Detections;
use skelsplat_core::layout::Layout;
use skelsplat_core::raster::encoding::Encoding;
use skelsplat_core::refine::refiner::Frame;
use skelsplat_core::refine::{PositionLearningRate, RefineConfig, Refiner, Renderer};
use skelsplat_core::testing::scenes::{exact_detections, room, standing};
use skelsplat_core::unit::Unit;

fn valid_frame() -> Frame {
    Frame {
        detections: exact_detections(&standing(), &room(4)),
        init_pose: Some(standing()),
        init_covariance: None,
        past: false,
    }
}

fn refine(frame: &Frame) -> Result<(), Error> {
    let layout = Layout::by_name("h36m17")?;
    let config = RefineConfig { max_steps: 1, ..RefineConfig::paper() };
    let refiner = Refiner::new(&room(4), Unit::Millimetre, Some(&layout), config)?;
    refiner.refine(frame, false, &AtomicBool::new(false)).map(|_| ())
}

fn text(error: Result<(), Error>) -> String {
    let error = error.expect_err("the input is broken");
    assert!(matches!(error, Error::InvalidInput { .. }), "{error:?}");
    error.to_string()
}

#[test]
fn the_valid_call_passes() {
    refine(&valid_frame()).unwrap();
}

#[test]
fn wrong_number_of_views() {
    let frame = Frame { detections: exact_detections(&standing(), &room(3)), ..valid_frame() };
    assert_eq!(text(refine(&frame)), "detections: expected one view per camera (4), got 3 views");
}

#[test]
fn a_layout_of_another_number_of_joints() {
    let pose = &standing()[..15];
    let frame = Frame {
        detections: exact_detections(pose, &room(4)),
        init_pose: None,
        init_covariance: None,
        past: false,
    };
    assert_eq!(text(refine(&frame)), "detections: expected the layout's 17 joints, got 15 joints");
}

#[test]
fn an_initial_pose_of_another_number_of_joints() {
    let frame = Frame { init_pose: Some(standing()[..16].to_vec()), ..valid_frame() };
    assert_eq!(
        text(refine(&frame)),
        "init_pose: expected 17 joints, as the detections have, got 16 joints"
    );
}

#[test]
fn a_confidence_outside_its_range() {
    let error = Detections::new(1, 2, &[0.0; 4], Some(&[0.5, 1.5])).map(|_| ());
    assert_eq!(text(error), "confidence[0, 1]: expected a value in [0, 1], got 1.5");
}

#[test]
fn the_confidence_of_a_missing_detection_does_not_count() {
    let nan = f64::NAN;
    let pixels = [5.0, 5.0, nan, 5.0, 5.0, nan];
    let found = Detections::new(1, 3, &pixels, Some(&[0.5, -1.0, 95.0])).unwrap();
    assert_eq!([0, 1, 2].map(|j| found.get(0, j).is_some()), [true, false, false]);
}

#[test]
fn no_cameras() {
    let error = Refiner::new(&[], Unit::Millimetre, None, RefineConfig::paper()).map(|_| ());
    assert_eq!(text(error), "cameras: expected at least one camera, got none");
}

#[test]
fn every_setting_outside_its_domain() {
    type Break = fn(&mut RefineConfig);
    let broken: [(Break, &str); 13] = [
        (
            |c| (c.renderer, c.encoding) = (Renderer::ClosedForm, Encoding::Single),
            "config.encoding: expected 'one_hot' with renderer 'closed_form', got single",
        ),
        (|c| c.sigma = -1.0, "config.sigma: expected a positive finite number, got -1"),
        (|c| c.sigma = f64::NAN, "config.sigma: expected a positive finite number, got NaN"),
        (
            |c| c.occlusion_sigma = Some(0.0),
            "config.occlusion_sigma: expected a positive finite number, got 0",
        ),
        (
            |c| c.position_lr = PositionLearningRate::Millimetres(-3.0),
            "config.position_lr: expected a finite number that is not negative, got -3",
        ),
        (|c| c.symmetry_tier = 4, "config.symmetry_tier: expected 0, 1, 2 or 3, got 4"),
        (
            |c| c.symmetry_weight = -1e-5,
            "config.symmetry_weight: expected a finite number that is not negative, got -0.00001",
        ),
        (|c| c.views_per_step = Some(0), "config.views_per_step: expected at least 1, got 0"),
        (|c| c.stop_window = Some(0), "config.stop_window: expected at least 1, got 0"),
        (|c| c.n_threads = Some(0), "config.n_threads: expected at least 1, got 0"),
        (|c| c.min_confidence = 1.5, "config.min_confidence: expected a value in [0, 1], got 1.5"),
        (|c| c.adam_betas = [0.9, 1.0], "config.adam_betas: expected values in [0, 1), got 1"),
        (|c| c.resolution = 0.0, "config.resolution: expected a positive finite number, got 0"),
    ];
    for (break_one, expected) in broken {
        let mut config = RefineConfig::paper();
        break_one(&mut config);
        assert_eq!(text(config.validate()), expected);
    }
}

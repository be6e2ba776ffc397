//! One valid call, one thing broken at a time: the type of the error and its text.

use skelsplat_core::testing::scenes::{exact_detections, room, standing};
use skelsplat_core::{
    Detections, Encoding, Error, Frame, Layout, Method, PaperSettings, PositionLearningRate,
    RefineConfig, Refiner, Renderer, Unit, Value,
};

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
    let config = RefineConfig::from(PaperSettings { max_steps: 1, ..PaperSettings::default() });
    let refiner = Refiner::new(&room(4), Unit::Millimetre, Some(&layout), config)?;
    refiner.refine(frame).map(|_| ())
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
        "init_pose: expected 17 joints, as in the detections, got 16 joints"
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
    type Break = fn(&mut RefineConfig, &mut PaperSettings);
    let broken: [(Break, &str); 13] = [
        (
            |_, p| (p.renderer, p.encoding) = (Renderer::ClosedForm, Encoding::Single),
            "config.encoding: expected 'one_hot' with renderer 'closed_form', got single",
        ),
        (|_, p| p.sigma_mm = -1.0, "config.sigma_mm: expected a positive finite number, got -1"),
        (
            |_, p| p.sigma_mm = f64::NAN,
            "config.sigma_mm: expected a positive finite number, got NaN",
        ),
        (
            |c, _| c.occlusion_sigma_mm = Some(0.0),
            "config.occlusion_sigma_mm: expected a positive finite number, got 0",
        ),
        (
            |_, p| p.position_lr_mm = PositionLearningRate::Millimetres(-3.0),
            "config.position_lr_mm: expected a finite number that is not negative, got -3",
        ),
        (
            |c, _| c.symmetry_tier = 4,
            "config.symmetry_tier: expected a whole number from 0 to 3, got 4",
        ),
        (
            |_, p| p.symmetry_weight = -1e-5,
            "config.symmetry_weight: expected a finite number that is not negative, got -0.00001",
        ),
        (|_, p| p.views_per_step = Some(0), "config.views_per_step: expected at least 1, got 0"),
        (|_, p| p.stop_window = Some(0), "config.stop_window: expected at least 1, got 0"),
        (|c, _| c.n_threads = Some(0), "config.n_threads: expected at least 1, got 0"),
        (
            |c, _| c.min_confidence = 1.5,
            "config.min_confidence: expected a value in [0, 1], got 1.5",
        ),
        (|_, p| p.adam_betas = [0.9, 1.0], "config.adam_betas: expected values in [0, 1), got 1"),
        (|_, p| p.resolution = 0.0, "config.resolution: expected a positive finite number, got 0"),
    ];
    for (break_one, expected) in broken {
        let (mut config, mut paper) = (RefineConfig::default(), PaperSettings::default());
        break_one(&mut config, &mut paper);
        let config = RefineConfig { method: Method::Paper(paper), ..config };
        assert_eq!(text(config.validate()), expected);
    }
}

#[test]
fn settings_by_name_are_those_of_the_table() {
    for mut config in [RefineConfig::default(), RefineConfig::paper()] {
        let before = config.clone();
        let names: Vec<&str> = config.settings().map(|setting| setting.name).collect();
        for name in &names {
            let value = config.get(name).unwrap();
            config.set(name, &value).unwrap();
        }
        assert_eq!(config, before);
        let unique: std::collections::HashSet<&&str> = names.iter().collect();
        assert_eq!(unique.len(), names.len());
    }
}

#[test]
fn a_setting_of_the_other_method_is_refused() {
    let set = |mut config: RefineConfig, name: &str| text(config.set(name, &Value::Number(1.0)));
    assert_eq!(
        set(RefineConfig::default(), "position_lr_mm"),
        "config.position_lr_mm: expected a setting of the method 'annealed', got a setting of 'paper' (use \
         RefineConfig.paper)"
    );
    assert_eq!(
        set(RefineConfig::paper(), "sigma_start_mm"),
        "config.sigma_start_mm: expected a setting of the method 'paper', got a setting of 'annealed' (use \
         RefineConfig)"
    );
    assert_eq!(
        set(RefineConfig::default(), "sigma"),
        "config.sigma: expected the name 'sigma_mm', which includes the unit, got 'sigma'"
    );
    assert_eq!(
        set(RefineConfig::default(), "optimizer"),
        "config.optimizer: expected RefineConfig() for 'annealed' or RefineConfig.paper() for 'paper', got 1"
    );
    let unknown = RefineConfig::default().get("pace").unwrap_err().to_string();
    assert!(
        unknown.starts_with("config: unknown name 'pace', expected one of sigma_mm, max_steps")
    );
    let mut config = RefineConfig::default();
    assert_eq!(
        text(config.set("find_swaps", &Value::Number(2.0))),
        "config.find_swaps: expected True or False, got 2"
    );
}

//! One valid call, one thing broken at a time: the argument or field that the error names.

use skelsplat_core::study::paper::{Encoding, PositionLearningRate, Renderer};
use skelsplat_core::{
    Detections, Error, Frame, Method, PaperSettings, RefineConfig, Refiner, Unit, Value,
};
use skelsplat_tests::refused;
use skelsplat_tests::scenes::{exact_detections, refiner, room, standing};

fn valid_frame() -> Frame {
    Frame { init_pose: Some(standing()), ..exact_detections(&standing(), &room(4)).into() }
}

#[test]
fn frames_that_do_not_fit_are_refused() {
    let short = RefineConfig::from(PaperSettings { max_steps: 1, ..PaperSettings::default() });
    let refine = |frame: &Frame| refiner(&room(4), short.clone()).refine(frame);
    refine(&valid_frame()).unwrap();
    let three_views =
        Frame { detections: exact_detections(&standing(), &room(3)), ..valid_frame() };
    let few_joints = Frame::from(exact_detections(&standing()[..15], &room(4)));
    let few_starts = Frame { init_pose: Some(standing()[..16].to_vec()), ..valid_frame() };
    assert_eq!(refused(refine(&three_views)), "detections");
    assert_eq!(refused(refine(&few_joints)), "detections");
    assert_eq!(refused(refine(&few_starts)), "init_pose");
    let no_cameras = Refiner::new(&[], Unit::Millimetre, None, RefineConfig::paper());
    assert_eq!(refused(no_cameras), "cameras");
}

#[test]
fn a_confidence_counts_only_where_there_is_a_detection() {
    let error = Detections::new(1, 2, &[0.0; 4], Some(&[0.5, 1.5]));
    assert_eq!(refused(error), "confidence[0, 1]");
    let nan = f64::NAN;
    let pixels = [5.0, 5.0, nan, 5.0, 5.0, nan];
    let found = Detections::new(1, 3, &pixels, Some(&[0.5, -1.0, 95.0])).unwrap();
    assert_eq!([0, 1, 2].map(|j| found.get(0, j).is_some()), [true, false, false]);
}

#[test]
fn every_setting_outside_its_domain() {
    type Break = fn(&mut RefineConfig, &mut PaperSettings);
    let broken: [(Break, &str); 13] = [
        (|_, p| (p.renderer, p.encoding) = (Renderer::ClosedForm, Encoding::Single), "encoding"),
        (|_, p| p.sigma_mm = -1.0, "sigma_mm"),
        (|_, p| p.sigma_mm = f64::NAN, "sigma_mm"),
        (|c, _| c.occlusion_sigma_mm = Some(0.0), "occlusion_sigma_mm"),
        (|_, p| p.position_lr_mm = PositionLearningRate::Millimetres(-3.0), "position_lr_mm"),
        (|c, _| c.symmetry_tier = 4, "symmetry_tier"),
        (|_, p| p.symmetry_weight = -1e-5, "symmetry_weight"),
        (|_, p| p.views_per_step = Some(0), "views_per_step"),
        (|_, p| p.stop_window = Some(0), "stop_window"),
        (|c, _| c.n_threads = Some(0), "n_threads"),
        (|c, _| c.min_confidence = 1.5, "min_confidence"),
        (|_, p| p.adam_betas = [0.9, 1.0], "adam_betas"),
        (|_, p| p.resolution = 0.0, "resolution"),
    ];
    for (break_one, field) in broken {
        let (mut config, mut paper) = (RefineConfig::default(), PaperSettings::default());
        break_one(&mut config, &mut paper);
        let config = RefineConfig { method: Method::Paper(paper), ..config };
        assert_eq!(refused(config.validate()), format!("config.{field}"));
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

/// The message leads to the other method, or to the name of today.
#[test]
fn a_setting_of_the_other_method_is_refused() {
    let number = Value::Number(1.0);
    for (mut config, name, hint) in [
        (RefineConfig::default(), "position_lr_mm", "RefineConfig.paper"),
        (RefineConfig::paper(), "sigma_start_mm", "RefineConfig"),
        (RefineConfig::default(), "sigma", "sigma_mm"),
        (RefineConfig::default(), "optimizer", "RefineConfig.paper()"),
        (RefineConfig::default(), "find_swaps", "True or False"),
    ] {
        let result = config.set(name, &number);
        let text = result.clone().unwrap_err().to_string();
        assert_eq!(refused(result), format!("config.{name}"));
        assert!(text.contains(hint), "{text}");
    }
    let unknown = RefineConfig::default().get("pace").unwrap_err();
    assert!(matches!(unknown, Error::UnknownName { argument: "config", .. }));
}

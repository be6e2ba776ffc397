//! The error bar: the scatter, and what the detector's joints have in common with no anatomical
//! joint.

use skelsplat_core::nalgebra::Matrix3;
use skelsplat_core::{
    Camera, Error, Frame, JointBias, Layout, RefineConfig, Refinement, Refiner, Unit,
    refine_sequence,
};
use skelsplat_tests::refused;
use skelsplat_tests::scenes::{
    Noise, exact_detections, h36m, noisy_detections, not_human, refiner, room, standing,
};

const PX: f64 = 3.0;

fn with(bias: JointBias) -> RefineConfig {
    RefineConfig { joint_bias_mm: bias, ..RefineConfig::default() }
}

fn frame(cameras: &[Camera], seed: u64) -> Frame {
    noisy_detections(&standing(), cameras, PX, &mut Noise::new(seed)).into()
}

fn refined(unit: Unit, layout: Option<&Layout>, config: RefineConfig) -> Result<Refinement, Error> {
    let scale = 1.0 / unit.millimetres();
    let detections = frame(&room(4), 1);
    let cameras: Vec<Camera> = room(4).into_iter().map(|c| c.with_length_scale(scale)).collect();
    Refiner::new(&cameras, unit, layout, config)?.refine(&detections)
}

/// Of every joint, what the diagonal of the error bar has beyond that of the scatter, as a standard
/// deviation.
fn added(found: &Refinement) -> Vec<f64> {
    let one = |(bar, scatter): (&_, &Matrix3<f64>)| {
        let beyond: Matrix3<f64> = bar - scatter;
        assert!((beyond - Matrix3::from_diagonal_element(beyond[(0, 0)])).amax() < 1e-9);
        beyond[(0, 0)].max(0.0).sqrt()
    };
    found.error_bar().iter().zip(&found.uncertainty).map(one).collect()
}

#[test]
fn the_bias_is_added_in_the_unit_of_the_cameras_and_changes_nothing_else() {
    let plain = refined(Unit::Millimetre, None, with(JointBias::All(0.0))).unwrap();
    assert_eq!(plain.error_bar(), plain.uncertainty);
    for unit in [Unit::Millimetre, Unit::Centimetre, Unit::Metre] {
        let found = refined(unit, None, with(JointBias::All(20.0))).unwrap();
        let mm = unit.millimetres();
        assert!(added(&found).iter().all(|b| (b * mm - 20.0).abs() < 1e-6));
        if unit == Unit::Millimetre {
            assert_eq!(found.uncertainty, plain.uncertainty);
            assert_eq!(found.pose, plain.pose);
        }
    }
}

/// 25 mm in no known direction are 14.4 mm per axis, 30 mm are 17.3 mm, 65 mm are 37.5 mm.
#[test]
fn built_in_layouts_have_figures_and_others_none() {
    let layout = h36m();
    let found = refined(Unit::Millimetre, Some(&layout), RefineConfig::default()).unwrap();
    let expected = [
        (14.434, "left_wrist"),
        (17.321, "right_elbow nose head spine"),
        (20.207, "left_shoulder"),
        (28.868, "right_knee pelvis"),
        (31.754, "left_hip right_ankle"),
        (37.528, "neck"),
    ];
    for (sigma, names) in expected {
        for name in names.split(' ') {
            let j = layout.joints.iter().position(|joint| joint == name).unwrap();
            assert!((found.joint_bias[j] - sigma).abs() < 1e-3, "{name}: {}", found.joint_bias[j]);
        }
    }
    for layout in [None, Some(&not_human(&layout))] {
        let found = refined(Unit::Millimetre, layout, RefineConfig::default()).unwrap();
        assert_eq!(*found.joint_bias, [0.0; 17]);
        assert_eq!(found.error_bar(), found.uncertainty);
    }
    for name in Layout::NAMES {
        let layout = Layout::by_name(name).unwrap();
        let refiner =
            Refiner::new(&room(3), Unit::Metre, Some(&layout), RefineConfig::default()).unwrap();
        let pose = vec![standing()[0]; layout.n_joints()];
        let found = refiner.refine(&exact_detections(&pose, &room(3)).into()).unwrap();
        assert!(found.joint_bias.iter().all(|b| (0.014..0.038).contains(b)), "{name}");
    }
}

/// Neither more views nor more frames make it smaller.
#[test]
fn it_is_divided_by_neither_views_nor_frames() {
    for (views, frames) in [(2, 4), (8, 4), (4, 60)] {
        let cameras = room(views);
        let refiner = refiner(&cameras, with(JointBias::All(25.0)));
        let recording: Vec<Frame> = (0..frames).map(|k| frame(&cameras, k)).collect();
        let found = refine_sequence(&refiner, &recording, 30.0, &Default::default()).unwrap();
        for frame in found.frames.iter() {
            assert!(added(&frame).iter().all(|b| (b - 25.0).abs() < 1e-6), "{views} views");
        }
    }
}

#[test]
fn wrong_values_are_refused_by_name() {
    let one = JointBias::Each([vec![1.0; 16], vec![-2.0]].concat());
    for (bias, field) in [
        (JointBias::All(-1.0), "config.joint_bias_mm"),
        (JointBias::All(f64::NAN), "config.joint_bias_mm"),
        (one, "config.joint_bias_mm[16]"),
        (JointBias::Each(vec![1.0; 16]), "config.joint_bias_mm"),
    ] {
        assert_eq!(refused(refined(Unit::Millimetre, Some(&h36m()), with(bias))), field);
    }
}

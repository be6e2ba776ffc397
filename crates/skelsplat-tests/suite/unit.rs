//! Body sizes that reveal a wrong unit.

use nalgebra::{Matrix3, Vector3};
use skelsplat_core::study::unit::implausible_extent;
use skelsplat_core::{Camera, Layout, LayoutSpec, Unit};

/// Two cameras so far apart, with this focal length on images of 1000 px.
fn pair(apart: f64, focal: f64) -> Vec<Camera> {
    let k = Matrix3::new(focal, 0.0, 500.0, 0.0, focal, 500.0, 0.0, 0.0, 1.0);
    let at = |x: f64| {
        let t = Vector3::new(x, 0.0, 0.0);
        Camera::new(&k, &Matrix3::identity(), &t, [1000, 1000]).unwrap()
    };
    vec![at(0.0), at(apart)]
}

fn person(height: f64) -> Vec<Vec<Vector3<f64>>> {
    vec![vec![Vector3::zeros(), Vector3::new(0.0, 0.0, height)]]
}

/// The limit that a body of this size violates, mm; cameras are so far apart, in the same unit.
fn limit(size: f64, apart: f64, unit: Unit, layout: Option<&Layout>) -> Option<f64> {
    let found = implausible_extent(&person(size), &pair(apart, 1e3), unit, layout)?;
    assert_eq!((found.extent, found.taller), (size, found.limit_mm > 1e3));
    Some(found.limit_mm)
}

#[test]
fn a_unit_mistaken_by_1000_or_10_is_noticed() {
    let human = Layout::by_name("coco17").unwrap();
    let spec = LayoutSpec {
        name: "mouse".to_owned(),
        joints: vec!["snout".to_owned(), "tail".to_owned()],
        ..LayoutSpec::default()
    };
    let mouse = Layout::new(spec).unwrap();
    let (mm, metre) = (Unit::Millimetre, Unit::Metre);
    for (size, apart, unit, layout, expected) in [
        (1700.0, 3000.0, mm, None, None),
        (1.7, 3.0, metre, None, None),
        (1700.0, 3000.0, metre, None, Some(10_000.0)),
        (1.7, 3.0, mm, None, Some(100.0)),
        (1.7, 4.0, Unit::Centimetre, None, Some(100.0)),
        // An adult in centimetres that are taken for millimetres.
        (170.0, 300.0, mm, Some(&human), Some(220.0)),
        (170.0, 300.0, mm, None, None),
        // A body of a layout that is not human.
        (95.6, 95.6, mm, Some(&mouse), None),
        (0.0956, 0.0956, mm, Some(&mouse), None),
        (18.0, 18.0, metre, Some(&mouse), None),
        (95.6, 95.6, metre, Some(&mouse), Some(20_000.0)),
        // Small joints of no layout, seen by cameras that are not too close together.
        (96.0, 1300.0, mm, None, None),
        (0.096, 1.3, metre, None, None),
        (2.5, 300.0, mm, None, None),
    ] {
        assert_eq!(limit(size, apart, unit, layout), expected, "{size} {unit:?}");
    }
}

#[test]
fn a_microscope_a_single_camera_and_an_incomplete_skeleton_are_not_judged() {
    let mm = Unit::Millimetre;
    assert_eq!(implausible_extent(&person(0.06), &pair(20.0, 1e5), mm, None), None);
    assert_eq!(implausible_extent(&person(1.7), &pair(1.0, 1e3)[..1], mm, None), None);
    let nan = Vector3::repeat(f64::NAN);
    let pose = vec![vec![Vector3::zeros(), nan, nan]];
    assert_eq!(implausible_extent(&pose, &pair(4.0, 1e3), mm, None), None);
}

//! The length unit of cameras and poses. The core computes in millimetres.

use nalgebra::Vector3;

use crate::error::{Error, Result};
use crate::layout::Layout;

/// Unit of camera translations and 3D points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Unit {
    /// Millimetres, the default.
    #[default]
    Millimetre,
    /// Centimetres (CMU Panoptic).
    Centimetre,
    /// Metres (Pose2Sim, OpenCV-style tools).
    Metre,
}

impl Unit {
    /// The unit called `"mm"`, `"cm"` or `"m"`.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for any other name.
    pub fn by_name(name: &str) -> Result<Self> {
        match name {
            "mm" => Ok(Self::Millimetre),
            "cm" => Ok(Self::Centimetre),
            "m" => Ok(Self::Metre),
            _ => Err(Error::UnknownName {
                argument: "unit",
                name: name.to_owned(),
                known: ["mm", "cm", "m"].map(str::to_owned).to_vec(),
            }),
        }
    }

    /// `"mm"`, `"cm"` or `"m"`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Millimetre => "mm",
            Self::Centimetre => "cm",
            Self::Metre => "m",
        }
    }

    /// Millimetres per unit.
    #[must_use]
    pub fn millimetres(self) -> f64 {
        match self {
            Self::Millimetre => 1.0,
            Self::Centimetre => 10.0,
            Self::Metre => 1000.0,
        }
    }
}

/// Range of plausible extents of a person, mm: a newborn measures 500, and an adult in centimetres that are taken for millimetres 170.
const PERSON: [f64; 2] = [220.0, 10_000.0];
/// The same without a layout: joints may be those of a hand.
const UNKNOWN: [f64; 2] = [100.0, 10_000.0];
/// Range of plausible extents of any body, mm: smaller than an ant to three times a giraffe.
const ANYTHING: [f64; 2] = [1.0, 20_000.0];

/// A skeleton of implausible size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Implausible {
    /// Its extent, in the given unit.
    pub extent: f64,
    /// Whether it is too large.
    pub taller: bool,
    /// The limit it violates, mm.
    pub limit_mm: f64,
}

/// The median extent of these skeletons, `(T, N)` in `unit`, if it is below 22 cm or above 10 m; `None` if it is plausible
/// or the skeletons are too incomplete to measure.
///
/// Without a layout the lower limit is 10 cm. A layout that is not human may be of any size that bodies have: its limits are 1 mm and 20 m.
#[must_use]
pub fn implausible_extent(
    poses: &[Vec<Vector3<f64>>],
    unit: Unit,
    layout: Option<&Layout>,
) -> Option<Implausible> {
    let mut extents: Vec<f64> = poses.iter().filter_map(|pose| extent(pose)).collect();
    if extents.is_empty() {
        return None;
    }
    extents.sort_by(f64::total_cmp);
    let extent = extents[extents.len() / 2];
    let mm = extent * unit.millimetres();
    let [low, high] = match layout {
        None => UNKNOWN,
        Some(layout) if layout.is_human() => PERSON,
        Some(_) => ANYTHING,
    };
    let taller = mm > high;
    let limit_mm = if taller { high } else { low };
    (!(low..=high).contains(&mm)).then_some(Implausible { extent, taller, limit_mm })
}

/// Diagonal of the box around the finite joints, if at least half of them (and two) are finite.
fn extent(pose: &[Vector3<f64>]) -> Option<f64> {
    let finite = || pose.iter().filter(|p| p.iter().all(|v| v.is_finite()));
    let count = finite().count();
    if count < 2 || 2 * count < pose.len() {
        return None;
    }
    let low = finite().fold(Vector3::repeat(f64::INFINITY), |m, p| m.inf(p));
    let high = finite().fold(Vector3::repeat(f64::NEG_INFINITY), |m, p| m.sup(p));
    Some((high - low).norm())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::LayoutSpec;

    fn person(height: f64) -> Vec<Vec<Vector3<f64>>> {
        vec![vec![Vector3::zeros(), Vector3::new(0.0, 0.0, height)]]
    }

    #[test]
    fn a_person_in_the_right_unit_raises_no_doubt() {
        assert_eq!(implausible_extent(&person(1700.0), Unit::Millimetre, None), None);
        assert_eq!(implausible_extent(&person(1.7), Unit::Metre, None), None);
    }

    #[test]
    fn a_unit_mistaken_by_1000_is_noticed() {
        let tall = implausible_extent(&person(1700.0), Unit::Metre, None);
        let expected = Implausible { extent: 1700.0, taller: true, limit_mm: 10_000.0 };
        assert_eq!(tall, Some(expected));
        let short = implausible_extent(&person(1.7), Unit::Millimetre, None);
        let expected = Implausible { extent: 1.7, taller: false, limit_mm: 100.0 };
        assert_eq!(short, Some(expected));
    }

    #[test]
    fn a_body_of_one_s_own_layout_may_be_of_any_size_that_bodies_have() {
        let spec = LayoutSpec {
            name: "mouse".to_owned(),
            joints: vec!["snout".to_owned(), "tail".to_owned()],
            ..LayoutSpec::default()
        };
        let mouse = Layout::new(spec).unwrap();
        let found = |size, unit| implausible_extent(&person(size), unit, Some(&mouse));
        assert_eq!(found(95.6, Unit::Millimetre), None);
        assert_eq!(found(18.0, Unit::Metre), None);
        let tall = found(95.6, Unit::Metre).unwrap();
        assert!(tall.taller && tall.limit_mm == 20_000.0, "{tall:?}");
        let short = found(0.0956, Unit::Millimetre).unwrap();
        assert!(!short.taller && short.limit_mm == 1.0, "{short:?}");
        let human = Layout::by_name("coco17").unwrap();
        // An adult of 1.7 m in centimetres that are taken for millimetres.
        let short = implausible_extent(&person(170.0), Unit::Millimetre, Some(&human)).unwrap();
        assert!(!short.taller && short.limit_mm == 220.0, "{short:?}");
        assert_eq!(implausible_extent(&person(170.0), Unit::Millimetre, None), None);
        assert!(implausible_extent(&person(95.6), Unit::Millimetre, None).is_some());
    }

    #[test]
    fn an_incomplete_skeleton_is_not_judged() {
        let pose =
            vec![vec![Vector3::zeros(), Vector3::repeat(f64::NAN), Vector3::repeat(f64::NAN)]];
        assert_eq!(implausible_extent(&pose, Unit::Millimetre, None), None);
    }
}

//! The length unit of cameras and poses. The core computes in millimetres.

use nalgebra::Vector3;

use crate::error::{Error, Result};
use crate::layout::Layout;

/// Unit in which camera translations and 3D points are given.
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

    /// How many millimetres one unit is.
    #[must_use]
    pub fn millimetres(self) -> f64 {
        match self {
            Self::Millimetre => 1.0,
            Self::Centimetre => 10.0,
            Self::Metre => 1000.0,
        }
    }
}

/// Extents between which a skeleton is plausible, mm, and what it is below and above.
struct Range {
    low: f64,
    high: f64,
    shorter: &'static str,
    taller: &'static str,
}

const PERSON: Range =
    Range { low: 100.0, high: 10_000.0, shorter: "shorter than 10 cm", taller: "taller than 10 m" };
/// A body of any kind: from less than an ant to more than a giraffe three times over.
const ANYTHING: Range =
    Range { low: 1.0, high: 20_000.0, shorter: "shorter than 1 mm", taller: "taller than 20 m" };

/// A sentence that names the unit if most of these skeletons, `(T, N)` in `unit`, are taller
/// than 10 m or shorter than 10 cm; `None` if they are plausible or too incomplete to tell.
///
/// A layout of one's own need not be a person: with it the limits are 20 m and 1 mm.
#[must_use]
pub fn implausible_extent(
    poses: &[Vec<Vector3<f64>>],
    unit: Unit,
    layout: Option<&Layout>,
) -> Option<String> {
    let mut extents: Vec<f64> = poses.iter().filter_map(|pose| extent(pose)).collect();
    if extents.is_empty() {
        return None;
    }
    extents.sort_by(f64::total_cmp);
    let median = extents[extents.len() / 2];
    let mm = median * unit.millimetres();
    let plausible = if layout.is_none_or(Layout::is_built_in) { PERSON } else { ANYTHING };
    if (plausible.low..=plausible.high).contains(&mm) {
        return None;
    }
    let size = if mm > plausible.high { plausible.taller } else { plausible.shorter };
    Some(format!(
        "the skeleton measures {median:.digits$} {name} and is {size}: is the unit really '{name}'?",
        digits = if median < 0.01 { 6 } else { 2 },
        name = unit.name()
    ))
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
    fn a_unit_mistaken_by_1000_is_named() {
        let tall = implausible_extent(&person(1700.0), Unit::Metre, None).unwrap();
        assert!(tall.contains("taller than 10 m") && tall.contains("'m'"), "{tall}");
        let short = implausible_extent(&person(1.7), Unit::Millimetre, None).unwrap();
        assert!(short.contains("shorter than 10 cm") && short.contains("'mm'"), "{short}");
    }

    #[test]
    fn a_body_of_one_s_own_layout_may_be_of_any_size_that_bodies_have() {
        let spec = LayoutSpec {
            name: "mouse".to_owned(),
            joints: vec!["snout".to_owned(), "tail".to_owned()],
            ..LayoutSpec::default()
        };
        let mouse = Layout::new(spec).unwrap();
        let told = |size, unit| implausible_extent(&person(size), unit, Some(&mouse));
        assert_eq!(told(95.6, Unit::Millimetre), None);
        assert_eq!(told(18.0, Unit::Metre), None);
        let tall = told(95.6, Unit::Metre).unwrap();
        assert!(tall.contains("taller than 20 m") && tall.contains("'m'"), "{tall}");
        let short = told(0.0956, Unit::Millimetre).unwrap();
        assert!(short.contains("measures 0.10 mm and is shorter than 1 mm"), "{short}");
        let human = Layout::by_name("coco17").unwrap();
        assert!(implausible_extent(&person(95.6), Unit::Millimetre, Some(&human)).is_some());
    }

    #[test]
    fn an_incomplete_skeleton_says_nothing() {
        let pose =
            vec![vec![Vector3::zeros(), Vector3::repeat(f64::NAN), Vector3::repeat(f64::NAN)]];
        assert_eq!(implausible_extent(&pose, Unit::Millimetre, None), None);
    }
}

//! The length unit of cameras and poses. The core computes in millimetres.

use nalgebra::Vector3;

use crate::error::{Error, Result};

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

/// Smallest and largest plausible extent of a skeleton, mm.
const PLAUSIBLE_EXTENT_MM: [f64; 2] = [100.0, 10_000.0];

/// A sentence that names the unit if most of these skeletons, `(T, N)` in `unit`, are taller
/// than 10 m or shorter than 10 cm; `None` if they are plausible or too incomplete to tell.
#[must_use]
pub fn implausible_extent(poses: &[Vec<Vector3<f64>>], unit: Unit) -> Option<String> {
    let mut extents: Vec<f64> = poses.iter().filter_map(|pose| extent(pose)).collect();
    if extents.is_empty() {
        return None;
    }
    extents.sort_by(f64::total_cmp);
    let median = extents[extents.len() / 2];
    let mm = median * unit.millimetres();
    let [low, high] = PLAUSIBLE_EXTENT_MM;
    if (low..=high).contains(&mm) {
        return None;
    }
    let size = if mm > high { "taller than 10 m" } else { "shorter than 10 cm" };
    Some(format!(
        "the skeleton measures {median:.2} {name} and is {size}: is the unit really '{name}'?",
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

    fn person(height: f64) -> Vec<Vec<Vector3<f64>>> {
        vec![vec![Vector3::zeros(), Vector3::new(0.0, 0.0, height)]]
    }

    #[test]
    fn a_person_in_the_right_unit_raises_no_doubt() {
        assert_eq!(implausible_extent(&person(1700.0), Unit::Millimetre), None);
        assert_eq!(implausible_extent(&person(1.7), Unit::Metre), None);
    }

    #[test]
    fn a_unit_mistaken_by_1000_is_named() {
        let tall = implausible_extent(&person(1700.0), Unit::Metre).unwrap();
        assert!(tall.contains("taller than 10 m") && tall.contains("'m'"), "{tall}");
        let short = implausible_extent(&person(1.7), Unit::Millimetre).unwrap();
        assert!(short.contains("shorter than 10 cm") && short.contains("'mm'"), "{short}");
    }

    #[test]
    fn an_incomplete_skeleton_says_nothing() {
        let pose =
            vec![vec![Vector3::zeros(), Vector3::repeat(f64::NAN), Vector3::repeat(f64::NAN)]];
        assert_eq!(implausible_extent(&pose, Unit::Millimetre), None);
    }
}

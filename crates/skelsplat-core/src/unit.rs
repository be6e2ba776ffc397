//! The length unit of cameras and poses. The core computes in millimetres.

use nalgebra::Vector3;

use crate::camera::Camera;
use crate::layout::Layout;
use crate::names::named;
use crate::statistics::median;

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

named!("unit" Unit { Millimetre: "mm", Centimetre: "cm", Metre: "m" });

impl Unit {
    /// Millimetres per unit.
    pub fn millimetres(self) -> f64 {
        match self {
            Self::Millimetre => 1.0,
            Self::Centimetre => 10.0,
            Self::Metre => 1000.0,
        }
    }
}

/// Range of plausible extents of a person, mm: a newborn measures 500, and an adult in centimetres
/// that are taken for millimetres 170.
const PERSON: [f64; 2] = [220.0, 10_000.0];
/// The same without a layout, if no cameras with ordinary lenses are as close together as these:
/// joints may be those of a hand or a mouse.
const UNKNOWN: [f64; 2] = [100.0, 10_000.0];
/// The largest extent of a body with a layout that is not human, mm: three times a giraffe. It may
/// be as small as it likes.
const ANYTHING: [f64; 2] = [0.0, 20_000.0];
/// Cameras closer together than this, mm, are so in a wrong unit only, unless they are microscopes.
const CROWDED_MM: f64 = 50.0;
/// A microscope's focal length is more than so many images' widths.
const NARROW: f64 = 4.0;

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

/// The median extent of these skeletons, `(T, N)` in `unit`, if it is below 22 cm or above 10 m;
/// `None` if it is plausible or the skeletons are too incomplete to measure.
///
/// Without a layout the lower limit is 10 cm, and holds only if the cameras, in `unit` too, are
/// closer together than cameras with ordinary lenses can be. A layout that is not human has no
/// lower limit: its upper one is 20 m.
pub fn implausible_extent(
    poses: &[Vec<Vector3<f64>>],
    cameras: &[Camera],
    unit: Unit,
    layout: Option<&Layout>,
) -> Option<Implausible> {
    let extent = median(poses.iter().filter_map(|pose| extent(pose)));
    if extent.is_nan() {
        return None;
    }
    let mm = extent * unit.millimetres();
    let [low, high] = match layout {
        None if is_crowded(cameras, unit) => UNKNOWN,
        None => [0.0, UNKNOWN[1]],
        Some(layout) if layout.human => PERSON,
        Some(_) => ANYTHING,
    };
    let taller = mm > high;
    let limit_mm = if taller { high } else { low };
    (!(low..=high).contains(&mm)).then_some(Implausible { extent, taller, limit_mm })
}

/// Whether cameras with ordinary lenses are closer together than they can be; a single one never
/// is.
fn is_crowded(cameras: &[Camera], unit: Unit) -> bool {
    let centres: Vec<_> = cameras.iter().map(Camera::centre).collect();
    let apart = centres.iter().flat_map(|a| centres.iter().map(move |b| (a - b).norm()));
    let mm = apart.fold(0.0, f64::max) * unit.millimetres();
    let wide = |camera: &&Camera| {
        let [width, height] = camera.size();
        camera.focal()[0] <= NARROW * f64::from(width.max(height))
    };
    mm > 0.0 && mm < CROWDED_MM && 2 * cameras.iter().filter(wide).count() > cameras.len()
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

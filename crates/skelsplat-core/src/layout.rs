//! Joint layouts: which joints a pose has, how they are connected and which are mirror images.

mod tables;

use std::ops::Deref;

use crate::error::{Error, Result};

/// A left and a right limb of equal length, entering the symmetry loss from its tier on:
/// 1 lower arms and legs, 2 upper arms and legs, 3 hip to root and shoulder to neck.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SymmetricPair {
    /// 1, 2 or 3.
    pub tier: u8,
    /// Joints of the left limb, from the trunk outwards.
    pub left: [usize; 2],
    /// The same joints of the right limb.
    pub right: [usize; 2],
}

/// The length of a limb that is known beforehand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KnownLength {
    /// Index of the limb.
    pub limb: usize,
    /// Its length, mm.
    pub mean_mm: f64,
    /// Standard deviation of the length, mm.
    pub sigma_mm: f64,
}

/// A joint angle of a layout's own, in degrees: `offset + sign · angle`, the angle between two
/// segments, 0 to 180.
#[derive(Debug, Clone, PartialEq)]
pub struct OwnAngle {
    /// What it is called.
    pub name: String,
    /// Three joints a, b, c: between a→b and b→c, 0 if in line. Four: between a→b and c→d.
    pub joints: Vec<usize>,
    /// 1 or −1.
    pub sign: f64,
    /// Degrees.
    pub offset: f64,
}

/// The parts of a [`Layout`]. All except the joints may be empty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LayoutSpec {
    /// Name of the layout.
    pub name: String,
    /// Names of the `N` joints in array order.
    pub joints: Vec<String>,
    /// Pairs of connected joints.
    pub limbs: Vec<[usize; 2]>,
    /// Limbs of equal length.
    pub symmetric: Vec<SymmetricPair>,
    /// (left, right) joints that are mirror images.
    pub left_right: Vec<[usize; 2]>,
    /// Joints prone to occlusion: elbows, wrists and ankles in the built-in layouts.
    pub occlusion_prone: Vec<usize>,
    /// Joints whose mean is the root.
    pub root: Vec<usize>,
    /// Lengths of limbs that are known; `bone_lengths_mm` of a configuration replaces them.
    pub lengths: Vec<KnownLength>,
    /// Joint angles beyond those that the names of joints give, or in their place.
    pub angles: Vec<OwnAngle>,
    /// Whether this is a person's body, with the joint names of the built-in layouts: its bones
    /// have the population's proportions, and its joints the usual errors of detectors.
    pub human: bool,
}

/// A validated [`LayoutSpec`], with read access to its fields.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout(LayoutSpec);

impl Deref for Layout {
    type Target = LayoutSpec;

    fn deref(&self) -> &LayoutSpec {
        &self.0
    }
}

impl Layout {
    /// Names of the built-in layouts.
    pub const NAMES: [&'static str; 9] = tables::NAMES;

    /// A custom layout.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] naming the field: no joints, an empty or repeated joint name, an
    /// index out of range, a limb or pair of a joint with itself, a limb twice, a joint in two
    /// left–right pairs, a tier other than 1, 2, 3, a length that is not positive, or an angle of
    /// other than three or four joints.
    pub fn new(spec: LayoutSpec) -> Result<Self> {
        check_joints(&spec.joints)?;
        check_indices(&spec)?;
        check_pairs(&spec)?;
        check_lengths(&spec)?;
        check_angles(&spec)?;
        Ok(Self(spec))
    }

    /// A built-in layout by name, in any case: `"h36m17"` or `"H36M17"`.
    ///
    /// # Errors
    /// [`Error::UnknownName`] listing the known names.
    pub fn by_name(name: &str) -> Result<Self> {
        let found = tables::spec(&name.to_lowercase()).map(Self);
        found.ok_or_else(|| Error::unknown("layout", name, Self::NAMES))
    }

    /// Number of joints `N`.
    pub fn n_joints(&self) -> usize {
        self.joints.len()
    }

    /// (left, right) limbs of equal length up to and including a tier; none for tier 0.
    pub fn symmetric_pairs(
        &self,
        max_tier: u8,
    ) -> impl Iterator<Item = ([usize; 2], [usize; 2])> + '_ {
        self.symmetric.iter().filter(move |p| p.tier <= max_tier).map(|p| (p.left, p.right))
    }
}

fn check_joints(joints: &[String]) -> Result<()> {
    if joints.is_empty() {
        return Err(Error::invalid("joints", "at least one joint", "none"));
    }
    for (i, name) in joints.iter().enumerate() {
        if name.is_empty() {
            return Err(Error::invalid(format!("joints[{i}]"), "a non-empty name", "an empty one"));
        }
        if joints[..i].contains(name) {
            let actual = format!("'{name}' repeated");
            return Err(Error::invalid(format!("joints[{i}]"), "a name not used before", actual));
        }
    }
    Ok(())
}

fn check_indices(spec: &LayoutSpec) -> Result<()> {
    let n = spec.joints.len();
    let pairs = [
        ("limbs", spec.limbs.clone()),
        ("symmetric", spec.symmetric.iter().flat_map(|p| [p.left, p.right]).collect()),
        ("left_right", spec.left_right.clone()),
    ];
    for (field, pairs) in &pairs {
        if let Some([a, b]) = pairs.iter().find(|[a, b]| a == b) {
            return Err(Error::invalid(*field, "two different joints", format!("[{a}, {b}]")));
        }
    }
    let pairs = pairs.map(|(field, pairs)| (field, pairs.concat()));
    let joints = [("occlusion_prone", spec.occlusion_prone.clone()), ("root", spec.root.clone())];
    for (field, indices) in pairs.into_iter().chain(joints) {
        if let Some(bad) = indices.iter().find(|&&i| i >= n) {
            return Err(Error::invalid(field, format!("indices below {n}"), bad.to_string()));
        }
    }
    Ok(())
}

fn check_pairs(spec: &LayoutSpec) -> Result<()> {
    let sorted: Vec<_> = spec.limbs.iter().map(|[a, b]| [a.min(b), a.max(b)]).collect();
    if let Some(k) = (0..sorted.len()).find(|&k| sorted[..k].contains(&sorted[k])) {
        return Err(Error::invalid("limbs", "each limb once", format!("{:?} twice", sorted[k])));
    }
    if let Some(p) = spec.symmetric.iter().find(|p| !(1..=3).contains(&p.tier)) {
        return Err(Error::invalid("symmetric", "tiers 1, 2 or 3", format!("tier {}", p.tier)));
    }
    let paired: Vec<usize> = spec.left_right.iter().copied().flatten().collect();
    if let Some((i, joint)) = paired.iter().enumerate().find(|(i, j)| paired[..*i].contains(j)) {
        let actual = format!("joint {joint} repeated in pair {}", i / 2);
        return Err(Error::invalid("left_right", "each joint in one pair", actual));
    }
    Ok(())
}

fn check_lengths(spec: &LayoutSpec) -> Result<()> {
    for (i, known) in spec.lengths.iter().enumerate() {
        if known.limb >= spec.limbs.len() {
            let expected = format!("limb indices below {}", spec.limbs.len());
            return Err(Error::invalid("lengths", expected, known.limb.to_string()));
        }
        if spec.lengths[..i].iter().any(|other| other.limb == known.limb) {
            let [a, b] = spec.limbs[known.limb].map(|joint| spec.joints[joint].as_str());
            let actual = format!("two for {a}–{b}");
            return Err(Error::invalid("lengths", "one length for each limb", actual));
        }
        for (quantity, value) in [("length", known.mean_mm), ("sigma", known.sigma_mm)] {
            if !(value.is_finite() && value > 0.0) {
                let expected = format!("a positive {quantity} in mm");
                return Err(Error::invalid("lengths", expected, value.to_string()));
            }
        }
    }
    Ok(())
}

fn check_angles(spec: &LayoutSpec) -> Result<()> {
    for (i, angle) in spec.angles.iter().enumerate() {
        if angle.name.is_empty() || spec.angles[..i].iter().any(|other| other.name == angle.name) {
            let actual = format!("'{}'", angle.name);
            return Err(Error::invalid(format!("angles[{i}]"), "a name not used before", actual));
        }
        let wrong = |key, expected: &str, actual| {
            Err(Error::invalid(format!("angles.{}.{key}", angle.name), expected, actual))
        };
        let segments: &[[usize; 2]] = match angle.joints[..] {
            [a, b, c] => &[[a, b], [b, c]],
            [a, b, c, d] => &[[a, b], [c, d]],
            _ => return wrong("joints", "three or four joints", angle.joints.len().to_string()),
        };
        if let Some(bad) = angle.joints.iter().find(|&&joint| joint >= spec.joints.len()) {
            let expected = format!("indices below {}", spec.joints.len());
            return wrong("joints", &expected, bad.to_string());
        }
        if let Some([joint, _]) = segments.iter().find(|[a, b]| a == b) {
            let actual = format!("'{}' twice", spec.joints[*joint]);
            return wrong("joints", "two different joints of each segment", actual);
        }
        if angle.sign.abs() != 1.0 {
            return wrong("sign", "1 or -1", angle.sign.to_string());
        }
        if !angle.offset.is_finite() {
            return wrong("offset", "a finite number of degrees", angle.offset.to_string());
        }
    }
    Ok(())
}

//! `skelsplat.Layout`.

use pyo3::Borrowed;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString, PyTuple};
use skelsplat_core::Error;
use skelsplat_core::study::bones::population::proportions;
use skelsplat_core::{KnownLength, Layout as Core, LayoutSpec, OwnAngle, SymmetricPair};

use crate::args::{JointNames, Name, Rebuilt, Tier, object, rebuilt, repr, type_name};
use crate::errors::{Failure, Result, in_words};

/// Joint names, limbs and symmetries of a skeleton. Immutable. Joints are indices or names.
///
/// Parameters
/// ----------
/// name : str
/// joints : sequence of str
///     The N joint names, in the order of the arrays.
/// limbs : sequence of (joint, joint)
/// symmetric : sequence of (tier, (l1, l2), (r1, r2))
///     Limbs of equal length; tier 1 (lower limbs), 2 (upper limbs) or 3 (trunk).
/// left_right : sequence of (left, right)
///     Joints that are mirror images.
/// occlusion_prone : sequence of joints
///     Joints to which ``RefineConfig.occlusion_sigma_mm`` applies.
/// root : sequence of joints
///     Joints whose mean is the root.
/// lengths : sequence of ((joint, joint), length_mm, sigma_mm)
///     Known lengths of limbs, in mm, and their standard deviations, which ``bone_lengths_mm`` of
///     the configuration replaces.
/// angles : sequence of (name, joints, sign, offset)
///     Joint angles, ``offset + sign * angle`` in degrees, which `joint_angles` returns as well, or
///     instead of those with the same name. Three joints a, b, c: the angle between a→b and b→c,
///     0 to 180; four: that between a→b and c→d.
/// human : bool
///     This is a person's body, whose joints are named as in the built-in layouts: bones with known
///     ends have the proportions of the population, and joints the usual errors of detectors.
///
/// Raises
/// ------
/// InvalidInputError
///     An unknown joint name or index, a joint paired with itself, a limb twice, a tier
///     other than 1, 2, 3, a length that is not positive or of no limb, or an angle of other than
///     three or four joints.
#[pyclass(frozen, eq, module = "skelsplat", name = "Layout")]
#[derive(PartialEq)]
pub(crate) struct Layout(pub(crate) Core);

impl<'py> FromPyObject<'_, 'py> for Layout {
    type Error = Failure;

    /// A layout, the name of a built-in one, or the path of a layout file, which Python reads.
    fn extract(value: Borrowed<'_, 'py, PyAny>) -> Result<Self> {
        if let Ok(name) = value.cast::<PyString>() {
            if let Ok(known) = Core::by_name(&name.to_cow()?) {
                return Ok(Self(known));
            }
            let read = value.py().import("skelsplat.layouts")?.call_method1("get", (name,))?;
            return object("layout", &read, "a Layout").map(|it: &Self| Self(it.0.clone()));
        }
        object("layout", &value, "a Layout or its name").map(|it: &Self| Self(it.0.clone()))
    }
}

/// An optional argument.
type Given<'a> = Option<&'a Bound<'a, PyAny>>;

/// Reads an argument that gives joints by index or by name.
#[derive(Clone, Copy)]
struct Reader<'a> {
    argument: &'a str,
    joints: &'a [String],
}

impl Reader<'_> {
    /// Applies `read` to each item; empty if the argument is not given.
    fn each<T>(
        &self,
        value: Given<'_>,
        expected: &str,
        read: impl Fn(&Bound<'_, PyAny>) -> Result<T>,
    ) -> Result<Vec<T>> {
        let Some(value) = value.filter(|v| !v.is_none()) else { return Ok(Vec::new()) };
        let wrong = || Error::invalid(self.argument, expected, type_name(value));
        let items = value.try_iter().map_err(|e| in_words(value.py(), e, wrong))?;
        items.map(|item| read(&item?)).collect()
    }

    fn joint(&self, value: &Bound<'_, PyAny>) -> Result<usize> {
        let wrong = |expected, actual| Error::invalid(self.argument, expected, actual);
        if let Ok(name) = value.cast::<PyString>() {
            let name = name.to_cow()?;
            let found = self.joints.iter().position(|j| **j == *name);
            return Ok(found.ok_or_else(|| wrong("a joint of the layout", format!("'{name}'")))?);
        }
        let words = || wrong("a joint's index or name", type_name(value));
        value.extract().map_err(|e| in_words(value.py(), e, words))
    }

    fn list(&self, value: Given<'_>) -> Result<Vec<usize>> {
        self.each(value, "a sequence of joints", |item| self.joint(item))
    }

    fn pair(&self, value: &Bound<'_, PyAny>) -> Result<[usize; 2]> {
        let expected = "pairs of two joints";
        let pair = self.each(Some(value), expected, |joint| self.joint(joint))?;
        let got = format!("{} joints", pair.len());
        Ok(pair.try_into().map_err(|_| Error::invalid(self.argument, expected, got))?)
    }

    fn pairs(&self, value: Given<'_>) -> Result<Vec<[usize; 2]>> {
        self.each(value, "pairs of two joints", |item| self.pair(item))
    }

    fn symmetric(&self, value: Given<'_>) -> Result<Vec<SymmetricPair>> {
        let expected = "triples (tier, (l1, l2), (r1, r2))";
        self.each(value, expected, |item| {
            let words = || Error::invalid(self.argument, expected, repr(item));
            let (tier, left, right): (u8, Bound<'_, PyAny>, Bound<'_, PyAny>) =
                item.extract().map_err(|e| in_words(item.py(), e, words))?;
            Ok(SymmetricPair { tier, left: self.pair(&left)?, right: self.pair(&right)? })
        })
    }

    fn lengths(&self, value: Given<'_>, limbs: &[[usize; 2]]) -> Result<Vec<KnownLength>> {
        let expected = "triples ((joint, joint), length in mm, sigma in mm)";
        self.each(value, expected, |item| {
            let words = || Error::invalid(self.argument, expected, repr(item));
            let (ends, mean_mm, sigma_mm): (Bound<'_, PyAny>, f64, f64) =
                item.extract().map_err(|e| in_words(item.py(), e, words))?;
            let [a, b] = self.pair(&ends)?;
            let limb = limbs.iter().position(|limb| *limb == [a, b] || *limb == [b, a]);
            let none = || Error::invalid(self.argument, "two joints of a limb", repr(&ends));
            Ok(KnownLength { limb: limb.ok_or_else(none)?, mean_mm, sigma_mm })
        })
    }

    fn angles(&self, value: Given<'_>) -> Result<Vec<OwnAngle>> {
        let expected = "quadruples (name, joints, sign, offset in degrees)";
        self.each(value, expected, |item| {
            let words = || Error::invalid(self.argument, expected, repr(item));
            let (name, joints, sign, offset): (String, Bound<'_, PyAny>, f64, f64) =
                item.extract().map_err(|e| in_words(item.py(), e, words))?;
            let argument = format!("{}.{name}.joints", self.argument);
            let joints = Reader { argument: &argument, ..*self }.list(Some(&joints))?;
            Ok(OwnAngle { name, joints, sign, offset })
        })
    }
}

#[pymethods]
impl Layout {
    #[new]
    #[pyo3(signature = (
        name, joints, *, limbs=None, symmetric=None, left_right=None, occlusion_prone=None,
        root=None, lengths=None, angles=None, human=false
    ))]
    #[allow(clippy::too_many_arguments, reason = "a layout's parts, all but two by keyword")]
    fn new(
        name: Name,
        joints: JointNames,
        limbs: Given<'_>,
        symmetric: Given<'_>,
        left_right: Given<'_>,
        occlusion_prone: Given<'_>,
        root: Given<'_>,
        lengths: Given<'_>,
        angles: Given<'_>,
        human: bool,
    ) -> Result<Self> {
        let of = |argument| Reader { argument, joints: &joints.0 };
        let limbs = of("limbs").pairs(limbs)?;
        let spec = LayoutSpec {
            lengths: of("lengths").lengths(lengths, &limbs)?,
            limbs,
            symmetric: of("symmetric").symmetric(symmetric)?,
            left_right: of("left_right").pairs(left_right)?,
            occlusion_prone: of("occlusion_prone").list(occlusion_prone)?,
            root: of("root").list(root)?,
            angles: of("angles").angles(angles)?,
            human,
            name: name.0,
            joints: joints.0.clone(),
        };
        Ok(Self(Core::new(spec)?))
    }

    /// Return the built-in layout with this name, or read the layout file at this path.
    #[staticmethod]
    fn by_name(name: Self) -> Self {
        name
    }

    /// Name of the layout.
    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    /// Number of joints N.
    #[getter]
    fn n_joints(&self) -> usize {
        self.0.n_joints()
    }

    /// Joint names in array order.
    #[getter]
    fn joints<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, &self.0.joints)
    }

    /// Pairs of connected joints.
    #[getter]
    fn limbs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.0.limbs.iter().map(|[a, b]| (*a, *b)))
    }

    /// Triples (tier, (l1, l2), (r1, r2)) of limbs of equal length.
    #[getter]
    fn symmetric<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let side = |[a, b]: [usize; 2]| (a, b);
        PyTuple::new(py, self.0.symmetric.iter().map(|p| (p.tier, side(p.left), side(p.right))))
    }

    /// Pairs (left, right) of joints that are mirror images.
    #[getter]
    fn left_right<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.0.left_right.iter().map(|[a, b]| (*a, *b)))
    }

    /// Joints prone to occlusion: elbows, wrists and ankles in the built-in layouts.
    #[getter]
    fn occlusion_prone<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, &self.0.occlusion_prone)
    }

    /// Joints whose mean is the root.
    #[getter]
    fn root<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, &self.0.root)
    }

    /// Triples ((joint, joint), length in mm, sigma in mm) of the limbs whose length is known.
    #[getter]
    fn lengths<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let ends = |l: &KnownLength| (self.0.limbs[l.limb][0], self.0.limbs[l.limb][1]);
        let known = self.0.lengths.iter();
        PyTuple::new(py, known.map(|l| (ends(l), l.mean_mm, l.sigma_mm)))
    }

    /// Triples ((joint, joint), length over stature, relative sigma) of limbs that people have.
    #[getter]
    fn proportions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let rows = proportions(&self.0).into_iter();
        PyTuple::new(py, rows.map(|p| ((p.joints[0], p.joints[1]), p.ratio, p.spread)))
    }

    /// Quadruples (name, joints, sign, offset in degrees) of the layout's own joint angles.
    #[getter]
    fn angles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let rows: PyResult<Vec<_>> = self
            .0
            .angles
            .iter()
            .map(|a| Ok((a.name.as_str(), PyTuple::new(py, &a.joints)?, a.sign, a.offset)))
            .collect();
        PyTuple::new(py, rows?)
    }

    /// Whether this is a person's body, with the population's bones and usual errors of detectors.
    #[getter]
    fn human(&self) -> bool {
        self.0.human
    }

    /// Return the pairs ((l1, l2), (r1, r2)) of symmetric limbs up to ``tier``.
    fn symmetric_pairs<'py>(&self, py: Python<'py>, tier: Tier) -> PyResult<Bound<'py, PyTuple>> {
        let pairs: Vec<_> =
            self.0.symmetric_pairs(tier.0).map(|([a, b], [c, d])| ((a, b), (c, d))).collect();
        PyTuple::new(py, pairs)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Rebuilt<'py>> {
        let (py, layout) = (slf.py(), &slf.get().0);
        let keywords = PyDict::new(py);
        for name in [
            "limbs",
            "symmetric",
            "left_right",
            "occlusion_prone",
            "root",
            "lengths",
            "angles",
            "human",
        ] {
            keywords.set_item(name, slf.getattr(name)?)?;
        }
        let arguments = (&layout.name, &layout.joints).into_pyobject(py)?;
        rebuilt(slf.as_any(), arguments, keywords)
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let name = PyString::new(py, &self.0.name).repr()?;
        Ok(format!("Layout({name}, {} joints)", self.0.n_joints()))
    }
}

//! `skelsplat.Layout`.

use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString, PyTuple};
use skelsplat_core::{Layout as Core, LayoutSpec, SymmetricPair};

use crate::args::type_name;
use crate::errors::{OrRaise, in_words, invalid};
use crate::pickle::{Rebuilt, rebuilt};

/// Joint names, limbs and symmetries of a skeleton. Immutable. Joints are given by index or by name.
///
/// Parameters
/// ----------
/// name : str
/// joints : sequence of str
///     The N joint names, in the order of the arrays.
/// limbs : sequence of (joint, joint)
/// symmetric : sequence of (tier, (l1, l2), (r1, r2))
///     Limbs of equal length; tier 1 (lower arms and legs), 2 (upper arms and legs) or 3.
/// left_right : sequence of (left, right)
///     Joints that are mirror images.
/// occlusion_prone : sequence of joints
///     Those that ``RefineConfig.occlusion_sigma`` applies to.
/// root : sequence of joints
///     Joints whose mean is the root.
///
/// Raises
/// ------
/// InvalidInputError
///     A name or index that is no joint, a joint paired with itself, a tier other than 1, 2, 3.
#[pyclass(frozen, module = "skelsplat", name = "Layout")]
pub(crate) struct Layout(pub(crate) Core);

/// An optional argument.
type Given<'a> = Option<&'a Bound<'a, PyAny>>;

/// What `parse` makes of an argument; nothing if it is not given.
fn or_none<T>(
    value: Given<'_>,
    parse: impl Fn(&Bound<'_, PyAny>) -> PyResult<Vec<T>>,
) -> PyResult<Vec<T>> {
    value.filter(|v| !v.is_none()).map_or(Ok(Vec::new()), parse)
}

/// A joint by index or by name.
fn joint(argument: &str, value: &Bound<'_, PyAny>, joints: &[String]) -> PyResult<usize> {
    let py = value.py();
    if let Ok(name) = value.cast::<PyString>() {
        let name = name.to_cow()?;
        return joints
            .iter()
            .position(|j| **j == *name)
            .ok_or_else(|| invalid(py, argument, "a joint of the layout", format!("'{name}'")));
    }
    value.extract().map_err(|e| {
        in_words(py, e, |_| invalid(py, argument, "a joint's index or name", type_name(value)))
    })
}

fn joint_list(argument: &str, value: &Bound<'_, PyAny>, joints: &[String]) -> PyResult<Vec<usize>> {
    value.try_iter()?.map(|j| joint(argument, &j?, joints)).collect()
}

fn pair(argument: &str, value: &Bound<'_, PyAny>, joints: &[String]) -> PyResult<[usize; 2]> {
    let list = joint_list(argument, value, joints)?;
    let got = format!("{} joints", list.len());
    list.try_into().map_err(|_| invalid(value.py(), argument, "pairs of two joints", got))
}

fn pairs(argument: &str, value: &Bound<'_, PyAny>, joints: &[String]) -> PyResult<Vec<[usize; 2]>> {
    value.try_iter()?.map(|p| pair(argument, &p?, joints)).collect()
}

fn symmetric_pairs(value: &Bound<'_, PyAny>, joints: &[String]) -> PyResult<Vec<SymmetricPair>> {
    let one = |item: PyResult<Bound<'_, PyAny>>| {
        let (tier, left, right): (u8, Bound<'_, PyAny>, Bound<'_, PyAny>) = item?.extract()?;
        let limb = |v: &Bound<'_, PyAny>| pair("symmetric", v, joints);
        Ok(SymmetricPair { tier, left: limb(&left)?, right: limb(&right)? })
    };
    value.try_iter()?.map(one).collect()
}

#[pymethods]
impl Layout {
    #[new]
    #[pyo3(signature = (name, joints, *, limbs=None, symmetric=None, left_right=None, occlusion_prone=None, root=None))]
    #[allow(clippy::too_many_arguments, reason = "a layout's parts, all but two by keyword")]
    #[allow(clippy::needless_pass_by_value, reason = "PyO3 hands over owned values")]
    fn new(
        py: Python<'_>,
        name: String,
        joints: Vec<String>,
        limbs: Given<'_>,
        symmetric: Given<'_>,
        left_right: Given<'_>,
        occlusion_prone: Given<'_>,
        root: Given<'_>,
    ) -> PyResult<Self> {
        let spec = LayoutSpec {
            limbs: or_none(limbs, |v| pairs("limbs", v, &joints))?,
            symmetric: or_none(symmetric, |v| symmetric_pairs(v, &joints))?,
            left_right: or_none(left_right, |v| pairs("left_right", v, &joints))?,
            occlusion_prone: or_none(occlusion_prone, |v| {
                joint_list("occlusion_prone", v, &joints)
            })?,
            root: or_none(root, |v| joint_list("root", v, &joints))?,
            name,
            joints,
        };
        Core::new(spec).or_raise(py).map(Self)
    }

    /// Return the built-in layout of that name.
    #[staticmethod]
    fn by_name(py: Python<'_>, name: &str) -> PyResult<Self> {
        Core::by_name(name).or_raise(py).map(Self)
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

    /// Connected joints.
    #[getter]
    fn limbs<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.0.limbs.iter().map(|[a, b]| (*a, *b)))
    }

    /// Mirror images (left, right).
    #[getter]
    fn left_right<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.0.left_right.iter().map(|[a, b]| (*a, *b)))
    }

    /// Elbows, wrists and ankles in the built-in layouts.
    #[getter]
    fn occlusion_prone<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, &self.0.occlusion_prone)
    }

    /// Joints whose mean is the root.
    #[getter]
    fn root<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, &self.0.root)
    }

    /// Return the pairs ((l1, l2), (r1, r2)) of symmetric limbs up to ``tier``.
    fn symmetric_pairs<'py>(&self, py: Python<'py>, tier: u8) -> PyResult<Bound<'py, PyTuple>> {
        let pairs: Vec<_> =
            self.0.symmetric_pairs(tier).map(|([a, b], [c, d])| ((a, b), (c, d))).collect();
        PyTuple::new(py, pairs)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Rebuilt<'py>> {
        let (py, layout) = (slf.py(), &slf.get().0);
        let symmetric: Vec<_> =
            layout.symmetric.iter().map(|p| (p.tier, p.left, p.right)).collect();
        let keywords = PyDict::new(py);
        keywords.set_item("limbs", &layout.limbs)?;
        keywords.set_item("symmetric", symmetric)?;
        keywords.set_item("left_right", &layout.left_right)?;
        keywords.set_item("occlusion_prone", &layout.occlusion_prone)?;
        keywords.set_item("root", &layout.root)?;
        let arguments = (&layout.name, &layout.joints).into_pyobject(py)?;
        rebuilt(slf.as_any(), arguments, keywords)
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| self.0 == other.get().0)
    }

    fn __repr__(&self) -> String {
        format!("Layout('{}', {} joints)", self.0.name, self.0.n_joints())
    }
}

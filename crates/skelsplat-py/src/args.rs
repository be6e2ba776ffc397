//! Arguments as the core wants them: arrays, cameras, detections, layouts.

use nalgebra::{Matrix3, Vector3};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyString;
use skelsplat_core::Unit;
use skelsplat_core::study::detections::{Detections, FARTHEST, too_far};

use crate::camera::Camera;
use crate::errors::{OrRaise, in_words, invalid};
use crate::layout::Layout;
use crate::scores::{self, Place};

/// The values of a float64 array, row-major, and its shape.
pub(crate) struct Array {
    values: Vec<f64>,
    pub(crate) shape: Vec<usize>,
}

/// `(4, 17, 3)` as Python writes it.
fn shown(shape: &[usize]) -> String {
    let items: Vec<String> = shape.iter().map(ToString::to_string).collect();
    match items.as_slice() {
        [one] => format!("({one},)"),
        _ => format!("({})", items.join(", ")),
    }
}

impl Array {
    /// Anything that holds numbers, in any layout in memory; NaN where it is masked or missing.
    ///
    /// `skelsplat._arrays.numbers` reads it, as for the functions that are written in Python.
    pub(crate) fn new(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Self> {
        let py = value.py();
        let read = py.import("skelsplat._arrays")?.call_method1("numbers", (value, name))?;
        let array = read.cast_into::<PyArrayDyn<f64>>()?;
        let shape = array.shape().to_vec();
        let plain = |actual: String| invalid(py, name, "an array that can be read", actual);
        let array = array.try_readonly().map_err(|e| plain(e.to_string()))?;
        let values = array.as_slice().map_err(|e| plain(e.to_string()))?.to_vec();
        Ok(Self { values, shape })
    }

    /// The values, row-major.
    pub(crate) fn values(&self) -> &[f64] {
        &self.values
    }

    /// Refuses the array if `ok` does not hold.
    pub(crate) fn expect(
        self,
        py: Python<'_>,
        name: &str,
        expected: &str,
        ok: bool,
    ) -> PyResult<Self> {
        if ok {
            return Ok(self);
        }
        Err(invalid(
            py,
            name,
            &format!("shape {expected}"),
            format!("shape {}", shown(&self.shape)),
        ))
    }

    /// Refuses finite values that are too large to compute with; `missing` says in the message what is none.
    pub(crate) fn bounded(self, py: Python<'_>, name: &str, missing: &str) -> PyResult<Self> {
        let Some(k) = too_far(self.values()) else { return Ok(self) };
        let place = scores::Place { name, shape: &self.shape, channel: "" };
        let expected = format!("values within ±{FARTHEST:e}{missing}");
        Err(invalid(py, &place.of(k), &expected, format!("{:e}", self.values()[k])))
    }

    /// An array whose shape is `shape` (`None`: any size).
    pub(crate) fn of_shape(
        name: &str,
        value: &Bound<'_, PyAny>,
        shape: &[Option<usize>],
        expected: &str,
    ) -> PyResult<Self> {
        let array = Self::new(name, value)?;
        let ok = array.shape.len() == shape.len()
            && array.shape.iter().zip(shape).all(|(n, want)| want.is_none_or(|want| want == *n));
        array.expect(value.py(), name, expected, ok)
    }

    /// The values as 3-vectors.
    pub(crate) fn points(&self) -> Vec<Vector3<f64>> {
        self.values().chunks_exact(3).map(Vector3::from_column_slice).collect()
    }

    /// The values as 3×3 matrices.
    pub(crate) fn matrices(&self) -> Vec<Matrix3<f64>> {
        self.values().chunks_exact(9).map(Matrix3::from_row_slice).collect()
    }
}

/// The name of a value's type, for messages.
pub(crate) fn type_name(value: &Bound<'_, PyAny>) -> String {
    value.get_type().name().map_or_else(|_| "?".to_owned(), |n| n.to_string())
}

/// A `CameraRig`, or a sequence of `Camera` in mm.
pub(crate) struct Cameras {
    pub(crate) cameras: Vec<skelsplat_core::study::camera::Camera>,
    pub(crate) unit: Unit,
}

impl Cameras {
    pub(crate) fn new(value: &Bound<'_, PyAny>) -> PyResult<Self> {
        let py = value.py();
        let wrong =
            |actual: String| invalid(py, "cameras", "a CameraRig or a sequence of Camera", actual);
        let unit = match value.getattr_opt("unit")? {
            Some(name) => Unit::by_name(&name.extract::<String>()?).or_raise(py)?,
            None => Unit::default(),
        };
        let items = value.try_iter().map_err(|e| in_words(py, e, |_| wrong(type_name(value))))?;
        let one = |(i, item): (usize, PyResult<Bound<'_, PyAny>>)| {
            let item = item?;
            match item.cast::<Camera>() {
                Ok(camera) => Ok(camera.get().0.clone()),
                Err(_) => Err(invalid(py, &format!("cameras[{i}]"), "a Camera", type_name(&item))),
            }
        };
        let cameras: PyResult<Vec<_>> = items.enumerate().map(one).collect();
        let cameras = cameras?;
        if cameras.is_empty() {
            return Err(wrong("none".to_owned()));
        }
        Ok(Self { cameras, unit })
    }
}

/// A layout, its name, or none.
pub(crate) fn layout(
    value: Option<&Bound<'_, PyAny>>,
) -> PyResult<Option<skelsplat_core::study::layout::Layout>> {
    let Some(value) = value.filter(|v| !v.is_none()) else { return Ok(None) };
    let py = value.py();
    if let Ok(name) = value.cast::<PyString>() {
        let found = skelsplat_core::study::layout::Layout::by_name(&name.to_cow()?);
        return found.map(Some).or_raise(py);
    }
    match value.cast::<Layout>() {
        Ok(layout) => Ok(Some(layout.get().0.clone())),
        Err(_) => Err(invalid(py, "layout", "a Layout, its name or None", type_name(value))),
    }
}

/// Detections of one frame or of several.
pub(crate) struct Frames {
    pub(crate) frames: Vec<Detections>,
    /// T, or 1.
    pub(crate) count: usize,
    /// Whether a leading axis T was given.
    pub(crate) batch: bool,
    pub(crate) n_views: usize,
    pub(crate) n_joints: usize,
}

impl Frames {
    /// From `detections` `([T,] M, N, 2|3)` and `confidence` `([T,] M, N)`.
    pub(crate) fn new(
        detections: &Bound<'_, PyAny>,
        confidence: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let py = detections.py();
        let array = Array::new("detections", detections)?;
        let expected = "(M, N, 2), (M, N, 3) or either with a leading T";
        let ok =
            matches!(array.shape.as_slice(), [.., 2 | 3] if (3..=4).contains(&array.shape.len()));
        let array = array.expect(py, "detections", expected, ok)?;
        let array = array.bounded(py, "detections", ", or NaN where missing")?;
        let (lead, last) = array.shape.split_at(array.shape.len() - 1);
        if lead[lead.len() - 2..].contains(&0) {
            let actual = format!("shape {}", shown(&array.shape));
            return Err(invalid(py, "detections", "at least one view and one joint", actual));
        }
        let (pixels, mut scores) = split(array.values(), last[0]);
        let place = Place { name: "detections", shape: lead, channel: ", 2" };
        scores::check(py, &scores, &pixels, &place)?;
        if let Some(confidence) = confidence.filter(|c| !c.is_none()) {
            if !scores.is_empty() {
                let actual = "detections with a third channel too";
                return Err(invalid(py, "confidence", "only one source of confidences", actual));
            }
            let want: Vec<Option<usize>> = lead.iter().copied().map(Some).collect();
            let array = Array::of_shape("confidence", confidence, &want, &shown(lead))?;
            scores = array.values().to_vec();
            let place = Place { name: "confidence", shape: lead, channel: "" };
            scores::check(py, &scores, &pixels, &place)?;
        }
        let (m, n) = (lead[lead.len() - 2], lead[lead.len() - 1]);
        let count = if lead.len() == 3 { lead[0] } else { 1 };
        let frames: skelsplat_core::Result<Vec<Detections>> = (0..count)
            .map(|t| {
                let at = t * m * n..(t + 1) * m * n;
                let scores = (!scores.is_empty()).then(|| &scores[at.clone()]);
                Detections::new(m, n, &pixels[2 * at.start..2 * at.end], scores)
            })
            .collect();
        let frames = frames.or_raise(py)?;
        Ok(Self { frames, count, batch: lead.len() == 3, n_views: m, n_joints: n })
    }

    /// `shape` with the leading T if there was one.
    pub(crate) fn shape(&self, shape: &[usize]) -> Vec<usize> {
        let lead = self.batch.then_some(self.count);
        lead.into_iter().chain(shape.iter().copied()).collect()
    }

    /// Refuses detections whose number of views is not the number of cameras.
    pub(crate) fn expect_views(&self, py: Python<'_>, n_cameras: usize) -> PyResult<()> {
        if self.n_views == n_cameras {
            return Ok(());
        }
        let expected = format!("one view per camera ({n_cameras})");
        Err(invalid(py, "detections", &expected, format!("{} views", self.n_views)))
    }
}

/// Pixels, and the third channel if there is one.
pub(crate) fn split(values: &[f64], channels: usize) -> (Vec<f64>, Vec<f64>) {
    if channels == 2 {
        return (values.to_vec(), Vec::new());
    }
    let pixels = values.chunks_exact(3).flat_map(|d| [d[0], d[1]]).collect();
    (pixels, values.chunks_exact(3).map(|d| d[2]).collect())
}

/// `values` as an array of `shape`.
pub(crate) fn array_out<'py, T: numpy::Element>(
    py: Python<'py>,
    values: Vec<T>,
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    PyArray1::from_vec(py, values).reshape(shape)
}

/// Vectors as rows of an array of `shape`.
pub(crate) fn points_out<'py>(
    py: Python<'py>,
    points: &[Vector3<f64>],
    shape: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let mut values = Vec::with_capacity(3 * points.len());
    points.iter().for_each(|p| values.extend_from_slice(p.as_slice()));
    array_out(py, values, shape)
}

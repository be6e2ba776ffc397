//! Arrays and plain values between Python and the core: a newtype for each argument, which holds
//! its name and rejects values that do not match.

use nalgebra::{Matrix3, Vector3};
use numpy::{Element, PyArray1, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::pyclass::boolean_struct::True;
use pyo3::types::{PyDict, PyTuple, PyType};
use pyo3::{Borrowed, PyClass};
use skelsplat_core::Error;
use skelsplat_core::study::detections::{FARTHEST, too_far};

use crate::errors::{Failure, Result, in_words, refuse};

/// Arguments that may have a score as their third channel.
const WITH_SCORES: [&str; 2] = ["detections", "people"];

/// A float64 array: name of the argument, values (row-major) and shape.
pub(crate) struct Array {
    pub(crate) name: &'static str,
    pub(crate) values: Vec<f64>,
    pub(crate) shape: Vec<usize>,
}

/// A shape in Python notation: `(4, 17, 3)`.
pub(crate) fn shown(shape: &[usize]) -> String {
    let items: Vec<String> = shape.iter().map(ToString::to_string).collect();
    match items.as_slice() {
        [length] => format!("({length},)"),
        _ => format!("({})", items.join(", ")),
    }
}

/// `name[…]` for entry `k` (row-major) of an array of `shape`; `channel` is appended to the index.
pub(crate) fn place(name: &str, shape: &[usize], k: usize, channel: &str) -> String {
    let below = |axis: usize| shape[axis + 1..].iter().product::<usize>();
    let at = |axis: usize| (k / below(axis) % shape[axis]).to_string();
    let index: Vec<String> = (0..shape.len()).map(at).collect();
    if index.is_empty() {
        name.to_owned()
    } else {
        format!("{name}[{}{channel}]", index.join(", "))
    }
}

impl Array {
    /// Reads anything that holds numbers, in any memory layout, with `skelsplat._arrays.numbers`;
    /// NaN where masked or missing.
    pub(crate) fn read(name: &'static str, value: &Bound<'_, PyAny>) -> Result<Self> {
        let read =
            value.py().import("skelsplat._arrays")?.call_method1("numbers", (value, name))?;
        let array = read.cast_into::<PyArrayDyn<f64>>().map_err(PyErr::from)?;
        let shape = array.shape().to_vec();
        let plain = |actual: String| Error::invalid(name, "a readable array", actual);
        let array = array.try_readonly().map_err(|e| plain(e.to_string()))?;
        let values = array.as_slice().map_err(|e| plain(e.to_string()))?.to_vec();
        Ok(Self { name, values, shape })
    }

    /// The error for an array without the `expected` shape.
    pub(crate) fn misshapen(&self, expected: &str) -> Failure {
        let actual = format!("shape {}", shown(&self.shape));
        Error::invalid(self.name, format!("shape {expected}"), actual).into()
    }

    /// Rejects an array of another shape; `why` is appended to the expected shape in the message.
    pub(crate) fn of(self, shape: &[usize], why: &str) -> Result<Self> {
        let ok = self.shape == shape;
        self.shaped(ok, &format!("{}{why}", shown(shape)))
    }

    /// Rejects an array without the `expected` shape.
    pub(crate) fn shaped(self, ok: bool, expected: &str) -> Result<Self> {
        if ok { Ok(self) } else { Err(self.misshapen(expected)) }
    }

    /// Rejects values that are infinite or too large to compute with, but for the scores of
    /// detections, which count only where there is a pixel; `missing` states in the message how to
    /// mark missing values.
    pub(crate) fn bounded(self, missing: &str) -> Result<Self> {
        if too_far(&self.values).is_none() {
            return Ok(self);
        }
        let scored = WITH_SCORES.contains(&self.name) && self.shape.ends_with(&[3]);
        let wrong = |k: &usize| self.values[*k].abs() > FARTHEST && !(scored && k % 3 == 2);
        let Some(k) = (0..self.values.len()).find(wrong) else { return Ok(self) };
        let expected = format!("values within ±{FARTHEST:e}{missing}");
        Err(self.refused(k, &expected, format!("{:e}", self.values[k])))
    }

    /// The error for a wrong entry `k`.
    pub(crate) fn refused(&self, k: usize, expected: &str, actual: String) -> Failure {
        Error::invalid(place(self.name, &self.shape, k, ""), expected, actual).into()
    }

    /// The values as 3-vectors.
    pub(crate) fn points(&self) -> Vec<Vector3<f64>> {
        self.values.chunks_exact(3).map(Vector3::from_column_slice).collect()
    }

    /// The values as 3×3 matrices.
    pub(crate) fn matrices(&self) -> Vec<Matrix3<f64>> {
        self.values.chunks_exact(9).map(Matrix3::from_row_slice).collect()
    }
}

/// One type per array argument: its name, its shape (`[..]` where it depends on other arguments),
/// and whether its values are bounded (with the message's words for missing values).
macro_rules! arrays {
    ($(
        $type:ident: $name:literal, $shape:pat => $expected:literal $(, bounded $missing:literal)?;
    )*) => {$(
        pub(crate) struct $type(pub(crate) Array);

        impl<'py> FromPyObject<'_, 'py> for $type {
            type Error = Failure;

            fn extract(value: Borrowed<'_, 'py, PyAny>) -> Result<Self> {
                let array = Array::read($name, &value)?;
                let ok = matches!(array.shape.as_slice(), $shape);
                let array = array.shaped(ok, $expected)?;
                $(let array = array.bounded($missing)?;)?
                Ok(Self(array))
            }
        }
    )*};
}

arrays! {
    Points: "points", [.., 3] => "(..., 3)", bounded "";
    Pixels: "points", [.., 2] => "(..., 2)", bounded "";
    Poses: "poses", [_, _, 3] => "(T, N, 3)";
    Monocular: "poses", [..] => "", bounded "";
    Means: "means", [_, 3] => "(N, 3)", bounded "";
    Covariances: "covariances", [..] => "", bounded "";
    TargetMeans: "target_means", [_, 3] => "(N, 3)", bounded "";
    TargetCovariances: "target_covariances", [..] => "", bounded "";
    LogScales: "log_scales", [..] => "";
    Quaternions: "quaternions", [..] => "", bounded "";
    Keypoints: "detections", [..] => "", bounded ", or NaN where missing";
    Confidence: "confidence", [..] => "";
    InitPose: "init_pose", [..] => "", bounded ", or NaN for none";
    InitSigma: "init_sigma", [..] => "", bounded ", or NaN for none";
    Intrinsics: "K", [3, 3] => "(3, 3)";
    Rotation: "R", [3, 3] => "(3, 3)";
    Translation: "t", [3] | [3, 1] | [1, 3] => "(3,)";
    Coefficients: "distortion", [..] => "";
}

/// One type per plain argument: its name, its Rust type, and the expected values for the message.
macro_rules! values {
    ($($type:ident($inner:ty): $name:literal, $expected:literal;)*) => {$(
        pub(crate) struct $type(pub(crate) $inner);

        impl<'py> FromPyObject<'_, 'py> for $type {
            type Error = Failure;

            fn extract(value: Borrowed<'_, 'py, PyAny>) -> Result<Self> {
                value.extract().map(Self).map_err(|e| {
                    let words = || Error::invalid($name, $expected, repr(&value));
                    in_words(value.py(), PyErr::from(e), words)
                })
            }
        }
    )*};
}

values! {
    Size([u32; 2]): "size", "(width, height) as two positive integers";
    Factor(f64): "factor", "a number";
    Tier(u8): "tier", "a whole number from 0 to 255";
    Name(String): "name", "a string";
    JointNames(Vec<String>): "joints", "a sequence of strings";
}

/// `repr` of a value, or its type if that fails, for messages.
pub(crate) fn repr(value: &Bound<'_, PyAny>) -> String {
    value.repr().map_or_else(|_| type_name(value), |r| r.to_string())
}

/// `value`, the argument `name`, as an object of class `T`.
pub(crate) fn object<'a, T>(
    name: &str,
    value: &'a Bound<'_, PyAny>,
    expected: &str,
) -> Result<&'a T>
where
    T: PyClass<Frozen = True> + Sync,
{
    match value.cast::<T>() {
        Ok(object) => Ok(object.get()),
        Err(_) => refuse(name, expected, type_name(value)),
    }
}

/// The name of a value's type, for messages.
pub(crate) fn type_name(value: &Bound<'_, PyAny>) -> String {
    value.get_type().name().map_or_else(|_| "?".to_owned(), |n| n.to_string())
}

/// Values and shape of an array to return to Python.
pub(crate) struct Out<T>(pub(crate) Vec<T>, pub(crate) Vec<usize>);

impl Out<f64> {
    /// Vectors as rows of an array of `shape`.
    pub(crate) fn points(points: &[Vector3<f64>], shape: Vec<usize>) -> Self {
        Self(points.iter().flat_map(|p| [p.x, p.y, p.z]).collect(), shape)
    }

    /// A 3×3 matrix.
    pub(crate) fn matrix(matrix: &Matrix3<f64>) -> Self {
        Self(matrix.transpose().as_slice().to_vec(), vec![3, 3])
    }
}

impl<'py, T: Element> IntoPyObject<'py> for Out<T> {
    type Target = PyArrayDyn<T>;
    type Output = Bound<'py, Self::Target>;
    type Error = PyErr;

    fn into_pyobject(self, py: Python<'py>) -> PyResult<Self::Output> {
        PyArray1::from_vec(py, self.0).reshape(self.1)
    }
}

/// `copyreg.__newobj_ex__` and its arguments: the class, positional arguments and keywords.
pub(crate) type Rebuilt<'py> =
    (Bound<'py, PyAny>, (Bound<'py, PyType>, Bound<'py, PyTuple>, Bound<'py, PyDict>));

/// The result of `__reduce__`, valid for every protocol, for an immutable object made from these
/// arguments.
pub(crate) fn rebuilt<'py>(
    object: &Bound<'py, PyAny>,
    arguments: Bound<'py, PyTuple>,
    keywords: Bound<'py, PyDict>,
) -> PyResult<Rebuilt<'py>> {
    let make = object.py().import("copyreg")?.getattr("__newobj_ex__")?;
    Ok((make, (object.get_type(), arguments, keywords)))
}

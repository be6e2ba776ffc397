//! `skelsplat.Camera`.

use nalgebra::{Matrix3, Vector2, Vector3};
use numpy::{PyArray1, PyArrayDyn};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};
use skelsplat_core::study::camera::{Camera as Core, Distortion, Undistorted, for_camera};

use crate::args::{Array, array_out};
use crate::errors::{OrRaise, in_words, invalid};
use crate::geometry::in_every_view;
use crate::pickle::{Rebuilt, rebuilt};

/// A calibrated camera: pinhole, lens and image size. Immutable.
///
/// World to camera is x_c = R x_w + t with x right, y down, z forward; integer pixel coordinates are pixel
/// centres.
///
/// Parameters
/// ----------
/// K : (3, 3)
///     [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels.
/// R : (3, 3)
///     Rotation world to camera.
/// t : (3,)
///     Translation world to camera, in the unit of the rig.
/// distortion : (4 | 5 | 8 | 12 | 14,), optional
///     OpenCV order k1, k2, p1, p2[, k3[, k4, k5, k6[, s1..s4[, tau_x, tau_y]]]]; 4 with ``fisheye``.
/// fisheye : bool
///     The four coefficients are those of OpenCV's fisheye model.
/// size : (width, height)
///     Image size in pixels.
/// name : str, optional
///
/// Raises
/// ------
/// InvalidInputError
///     A wrong shape, a value that is not finite or outside its range (page Conventions), an R that is not a
///     rotation, a wrong number of coefficients.
#[pyclass(frozen, module = "skelsplat", name = "Camera")]
pub(crate) struct Camera(pub(crate) Core);

type CameraArguments<'py> =
    ((Bound<'py, PyAny>, Bound<'py, PyAny>, Bound<'py, PyAny>), Bound<'py, PyDict>);

fn matrix<'py>(py: Python<'py>, m: &Matrix3<f64>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    array_out(py, m.transpose().as_slice().to_vec(), &[3, 3])
}

fn translation(value: &Bound<'_, PyAny>) -> PyResult<Vector3<f64>> {
    let array = Array::new("t", value)?;
    let ok = matches!(array.shape.as_slice(), [3] | [3, 1] | [1, 3]);
    let array = array.expect(value.py(), "t", "(3,)", ok)?;
    Ok(Vector3::from_column_slice(array.values()))
}

fn lens(
    value: Option<&Bound<'_, PyAny>>,
    fisheye: bool,
) -> PyResult<skelsplat_core::Result<Distortion>> {
    let Some(value) = value.filter(|v| !v.is_none()) else {
        return Ok(Ok(Distortion::None));
    };
    let array = Array::new("distortion", value)?;
    Ok(Distortion::from_coefficients(array.values(), fisheye))
}

#[pymethods]
impl Camera {
    #[new]
    #[pyo3(signature = (K, R, t, *, distortion=None, fisheye=false, size, name=None))]
    #[allow(non_snake_case, reason = "K and R are the field's names")]
    #[allow(clippy::too_many_arguments, reason = "a camera's parameters, all but three by keyword")]
    fn new(
        K: &Bound<'_, PyAny>,
        R: &Bound<'_, PyAny>,
        t: &Bound<'_, PyAny>,
        distortion: Option<&Bound<'_, PyAny>>,
        fisheye: bool,
        size: &Bound<'_, PyAny>,
        name: Option<String>,
    ) -> PyResult<Self> {
        let py = K.py();
        let square = [Some(3), Some(3)];
        let k = Matrix3::from_row_slice(Array::of_shape("K", K, &square, "(3, 3)")?.values());
        let r = Matrix3::from_row_slice(Array::of_shape("R", R, &square, "(3, 3)")?.values());
        let (t, lens) = (translation(t)?, lens(distortion, fisheye)?);
        let size = size.extract::<[u32; 2]>().map_err(|e| {
            let expected = "(width, height) as two positive integers";
            in_words(py, e, |_| invalid(py, "size", expected, size.to_string()))
        })?;
        let camera = Core::new(&k, &r, &t, size).and_then(|c| Ok(c.with_distortion(lens?)));
        match name {
            None => camera.or_raise(py).map(Self),
            Some(name) => {
                let camera = camera.map_err(for_camera(&name)).or_raise(py)?;
                Ok(Self(camera.with_name(name)))
            }
        }
    }

    /// Camera matrix (3, 3).
    #[getter]
    #[pyo3(name = "K")]
    fn k<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        matrix(py, &self.0.k())
    }

    /// Rotation world to camera (3, 3).
    #[getter]
    #[pyo3(name = "R")]
    fn r<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        matrix(py, self.0.rotation())
    }

    /// Translation world to camera (3,).
    #[getter]
    fn t<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.translation().as_slice())
    }

    /// Camera centre −Rᵀt in the world (3,).
    #[getter]
    fn centre<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.centre().as_slice())
    }

    /// Width and height, pixels.
    #[getter]
    fn size(&self) -> (u32, u32) {
        self.0.size().into()
    }

    /// Name, if it has one.
    #[getter]
    fn name(&self) -> Option<&str> {
        self.0.name()
    }

    /// Whether the lens follows OpenCV's fisheye model.
    #[getter]
    fn fisheye(&self) -> bool {
        self.0.distortion().is_fisheye()
    }

    /// Distortion coefficients as given.
    #[getter]
    fn distortion<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f64>>> {
        let coefficients = self.0.distortion().coefficients();
        (!coefficients.is_empty()).then(|| PyArray1::from_vec(py, coefficients))
    }

    /// Return the camera of images resized by ``factor``: u' = (u + ½) · factor − ½.
    fn scaled(&self, py: Python<'_>, factor: f64) -> PyResult<Self> {
        self.0.scaled(factor).or_raise(py).map(Self)
    }

    /// Map pixels (…, 2) to ideal pixels of the same K; NaN where no ray through the lens arrives.
    fn undistort<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let array = Array::new("points", points)?;
        let ok = array.shape.last() == Some(&2);
        let array = array.expect(py, "points", "(..., 2)", ok)?.bounded(py, "points", "")?;
        let pixels = array.values().chunks_exact(2).map(Vector2::from_column_slice).collect();
        let undistort = |camera: &Core, p: &Vector2<f64>| match camera.undistort(*p) {
            Undistorted::Converged(q) => [q.x, q.y],
            Undistorted::OutOfRange => [f64::NAN; 2],
        };
        let ideal = in_every_view(py, vec![self.0.clone()], pixels, undistort)?;
        array_out(py, ideal.into_flattened(), &array.shape)
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<CameraArguments<'py>> {
        let keywords = PyDict::new(py);
        keywords.set_item("distortion", self.distortion(py))?;
        keywords.set_item("fisheye", self.fisheye())?;
        keywords.set_item("size", self.size())?;
        keywords.set_item("name", self.name())?;
        let keywords = keywords.into_py_dict(py)?;
        Ok(((self.k(py)?.into_any(), self.r(py)?.into_any(), self.t(py).into_any()), keywords))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Rebuilt<'py>> {
        let (arguments, keywords) = slf.get().__getnewargs_ex__(slf.py())?;
        rebuilt(slf.as_any(), arguments.into_pyobject(slf.py())?, keywords)
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| self.0 == other.get().0)
    }

    fn __repr__(&self) -> String {
        let [fx, fy] = self.0.focal();
        let [w, h] = self.0.size();
        let name = self.0.name().map_or_else(String::new, |n| format!("'{n}', "));
        format!("Camera({name}{w}x{h} px, fx={fx:.1}, fy={fy:.1})")
    }
}

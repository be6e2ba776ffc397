//! `skelsplat.Camera`, and cameras as an argument.

use nalgebra::{Matrix3, Vector2, Vector3};
use pyo3::Borrowed;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use skelsplat_core::Error;
use skelsplat_core::Unit;
use skelsplat_core::study::camera::for_camera;
use skelsplat_core::{Camera as Core, Distortion};

use crate::args::{
    Coefficients, Factor, Intrinsics, Name, Out, Pixels, Rebuilt, Rotation, Size, Translation,
    object, rebuilt, type_name,
};
use crate::errors::{Failure, Result, in_words, refuse};
use crate::geometry::in_every_view;

/// A calibrated camera: pinhole, lens and image size. Immutable.
///
/// World to camera is x_c = R x_w + t with x right, y down, z forward; integer pixel coordinates
/// are at pixel centres.
///
/// Parameters
/// ----------
/// K : (3, 3)
///     [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels.
/// R : (3, 3)
///     Rotation world to camera. One that is orthonormal to 1e-3 will do: the nearest rotation is
///     taken.
/// t : (3,)
///     Translation world to camera, in the unit of the rig.
/// distortion : (4 | 5 | 8 | 12 | 14,), optional
///     OpenCV order k1, k2, p1, p2[, k3[, k4, k5, k6[, s1..s4[, tau_x, tau_y]]]]; 4 with
///     ``fisheye``.
/// fisheye : bool
///     Whether the coefficients are the four of OpenCV's fisheye model.
/// size : (width, height)
///     Image size in pixels.
/// name : str, optional
///
/// Raises
/// ------
/// InvalidInputError
///     Wrong shape or number of coefficients, a value that is not finite or outside its range (see
///     the page Conventions), or an R that is not a rotation.
#[pyclass(frozen, eq, module = "skelsplat", name = "Camera")]
#[derive(PartialEq)]
pub(crate) struct Camera(pub(crate) Core);

impl<'py> FromPyObject<'_, 'py> for Camera {
    type Error = Failure;

    fn extract(value: Borrowed<'_, 'py, PyAny>) -> Result<Self> {
        object("camera", &value, "a Camera").map(|camera: &Self| Self(camera.0.clone()))
    }
}

/// A `CameraRig`, or a sequence of `Camera` in mm; at least one.
pub(crate) struct Cameras {
    pub(crate) cameras: Vec<Core>,
    pub(crate) unit: Unit,
    /// `joint_sigma` of a `CameraRig`.
    pub(crate) joint_sigma: f64,
}

impl<'py> FromPyObject<'_, 'py> for Cameras {
    type Error = Failure;

    fn extract(value: Borrowed<'_, 'py, PyAny>) -> Result<Self> {
        let expected = "a CameraRig or a sequence of Camera";
        let unit = match value.getattr_opt("unit")? {
            Some(name) => Unit::by_name(&name.extract::<String>()?)?,
            None => Unit::default(),
        };
        let joint_sigma = match value.getattr_opt("joint_sigma")? {
            Some(sigma) => sigma.extract()?,
            None => 0.0,
        };
        let words = || Error::invalid("cameras", expected, type_name(&value));
        let items = value.try_iter().map_err(|e| in_words(value.py(), e, words))?;
        let read = |(i, item): (usize, PyResult<_>)| {
            let item = item?;
            object(&format!("cameras[{i}]"), &item, "a Camera")
                .map(|camera: &Camera| camera.0.clone())
        };
        let cameras: Vec<Core> = items.enumerate().map(read).collect::<Result<_>>()?;
        if cameras.is_empty() {
            return refuse("cameras", expected, "none");
        }
        Ok(Self { cameras, unit, joint_sigma })
    }
}

#[pymethods]
impl Camera {
    #[new]
    #[pyo3(signature = (K, R, t, *, distortion=None, fisheye=false, size, name=None))]
    #[allow(non_snake_case, reason = "K and R are the field's names")]
    #[allow(clippy::too_many_arguments, reason = "a camera's parameters, all but three by keyword")]
    fn new(
        K: Intrinsics,
        R: Rotation,
        t: Translation,
        distortion: Option<Coefficients>,
        fisheye: bool,
        size: Size,
        name: Option<Name>,
    ) -> Result<Self> {
        let model = if fisheye { Distortion::fisheye } else { Distortion::brown_conrady };
        let lens = distortion.map(|c| model(&c.0.values));
        let [k, r] = [K.0, R.0].map(|m| Matrix3::from_row_slice(&m.values));
        let camera = Core::new(&k, &r, &Vector3::from_column_slice(&t.0.values), size.0)
            .and_then(|camera| Ok(camera.with_distortion(lens.unwrap_or(Ok(Distortion::None))?)));
        Ok(Self(match name {
            None => camera?,
            Some(Name(name)) => camera.map_err(for_camera(&name))?.with_name(name),
        }))
    }

    /// Camera matrix (3, 3).
    #[getter]
    #[pyo3(name = "K")]
    fn k(&self) -> Out<f64> {
        Out::matrix(&self.0.k())
    }

    /// Rotation world to camera (3, 3).
    #[getter]
    #[pyo3(name = "R")]
    fn r(&self) -> Out<f64> {
        Out::matrix(self.0.rotation())
    }

    /// Translation world to camera (3,).
    #[getter]
    fn t(&self) -> Out<f64> {
        Out::points(&[*self.0.translation()], vec![3])
    }

    /// Camera centre −Rᵀt in the world (3,).
    #[getter]
    fn centre(&self) -> Out<f64> {
        Out::points(&[self.0.centre()], vec![3])
    }

    /// Width and height, pixels.
    #[getter]
    fn size(&self) -> (u32, u32) {
        self.0.size().into()
    }

    /// Name of the camera, or None.
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
    fn distortion(&self) -> Option<Out<f64>> {
        let coefficients = self.0.distortion().coefficients();
        let shape = vec![coefficients.len()];
        (!coefficients.is_empty()).then_some(Out(coefficients, shape))
    }

    /// Return the camera for images resized by ``factor``: u' = (u + ½) · factor − ½.
    fn scaled(&self, factor: Factor) -> Result<Self> {
        Ok(Self(self.0.scaled(factor.0)?))
    }

    /// Map pixels (…, 2) to ideal pixels of the same K; NaN where no ray through the lens arrives.
    fn undistort(&self, py: Python<'_>, points: Pixels) -> Result<Out<f64>> {
        let Pixels(array) = points;
        let pixels = array.values.chunks_exact(2).map(Vector2::from_column_slice).collect();
        let undistort = |camera: &Core, p: &Vector2<f64>| {
            camera.undistort(*p).map_or([f64::NAN; 2], |ideal| [ideal.x, ideal.y])
        };
        let ideal = in_every_view(py, vec![self.0.clone()], pixels, undistort)?;
        Ok(Out(ideal.into_flattened(), array.shape))
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Rebuilt<'py>> {
        let (py, camera) = (slf.py(), slf.get());
        let keywords = PyDict::new(py);
        keywords.set_item("distortion", camera.distortion())?;
        keywords.set_item("fisheye", camera.fisheye())?;
        keywords.set_item("size", camera.size())?;
        keywords.set_item("name", camera.name())?;
        let arguments = (camera.k(), camera.r(), camera.t()).into_pyobject(py)?;
        rebuilt(slf.as_any(), arguments, keywords)
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let [fx, fy] = self.0.focal();
        let [w, h] = self.0.size();
        let name = match self.0.name() {
            Some(name) => format!("{}, ", PyString::new(py, name).repr()?),
            None => String::new(),
        };
        Ok(format!("Camera({name}{w}x{h} px, fx={fx:.1}, fy={fy:.1})"))
    }
}

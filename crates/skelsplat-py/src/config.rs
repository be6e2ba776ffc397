//! `skelsplat.RefineConfig`: the core's settings by keyword. Only what the user sets is touched.

use pyo3::Borrowed;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString, PyTuple};
use skelsplat_core::Error;
use skelsplat_core::raster::encoding::Encoding;
use skelsplat_core::refine::{Optimizer, PositionLearningRate, RefineConfig as Core, Renderer};

use crate::args::{Array, Rebuilt, rebuilt, repr, type_name};
use crate::errors::{Failure, Result, in_words};

/// Settings of ``refine``; lengths in mm whatever the unit of the cameras. Immutable.
///
/// Every field is a keyword. ``RefineConfig()`` is the robust default: the closed form by Gauss–Newton under
/// a kernel that narrows, from any start. ``RefineConfig.paper()`` is the published method: pixels and Adam.
/// A field that is left out keeps the value of its preset; where the two differ both are given, the default's
/// first.
///
/// Parameters
/// ----------
/// optimizer : {"gauss_newton", "adam"}
///     What moves the joints: "gauss_newton"; "adam" in ``paper()``.
/// renderer : {"closed_form", "raster"}
///     What compares splats with detections: the exact integral of the loss over the plane, which needs no
///     pixels (one-hot encoding only), or the paper's pixels: "closed_form"; "raster" in ``paper()``.
///     Gauss–Newton takes the closed form, Adam either.
/// sigma : float
///     Standard deviation of every joint's splat: 30; e³ ≈ 20.09 in ``paper()``. For Gauss–Newton it is the
///     widest that the kernel ends at, unless the noise is found to be larger; for Adam the initial σ₀.
/// occlusion_sigma : float or None
///     The same for occlusion-prone joints; None: ``sigma``.
/// occlusion_factor : float
///     Instead of ``occlusion_sigma``, the paper's f. It multiplies the *logarithm* of σ₀ in mm, σ = σ₀^f:
///     1.25 gives 42.5 mm, 1.5 gives 90, 2 gives 403 in ``paper()``. Not kept as a field.
/// joint_sigmas : sequence of N floats, or None
///     A standard deviation for each joint instead of the above, None.
/// symmetry_tier : {0, 1, 2, 3}
///     Symmetric limbs up to this tier, 1; 0 switches the symmetry loss off.
/// max_steps : int
///     At most this many steps: 50; 125 in ``paper()``.
/// undistort : bool
///     Remove lens distortion from the detections first, True; False mirrors numbers published without it.
/// min_confidence : float
///     Detections of a lower confidence count as missing, 0.
/// n_threads : int or None
///     Threads for a batch; None: all cores. The result does not depend on it.
///
/// Other Parameters
/// ----------------
/// Of the default, Gauss–Newton; Adam uses ``sigma_per_noise``, ``detection_sigma`` and ``symmetry_sigma``
/// for the error bars alone:
///
/// sigma_start : float
///     Widest kernel that annealing begins with, 320. A joint without a start of its own begins at its
///     farthest ray if that is nearer.
/// sigma_decay : float
///     Factor on the kernel's σ from one step to the next, 0.5.
/// sigma_per_noise : float or None
///     The kernel ends at this multiple of the detections' noise, 2, if that is less than ``sigma``; where
///     the noise is larger, it follows if the frame is more likely so (large noise rather than many wrong
///     detections). None: at ``sigma``, as in ``paper()``.
/// detection_sigma : float or None
///     Standard deviation of the detections' noise per axis, pixels; None: estimated in every frame.
/// view_weights : sequence of M floats, or None
///     How much each view counts, beside the confidence; 0 leaves it out. None: 1 for all. Gauss–Newton only.
/// symmetry_sigma : float
///     Standard deviation of the difference between symmetric limbs, 15.
/// find_swaps : bool
///     Look for detections with left and right exchanged: True; False in ``paper()``.
/// step_tolerance : float
///     Converged once the kernels are narrow and no joint moves by more than this part of the noise, 0.01.
///
/// Of Adam, the paper's method; Gauss–Newton uses none of them:
///
/// dilation : float
///     h, added to the projected variances, 0.3 px².
/// encoding : {"one_hot", "rgb", "single"}
///     Joint encoding, "one_hot"; the others are ablations.
/// symmetry_weight : float
///     λ_sym, 1e-5.
/// views_per_step : int or None
///     Views whose gradients are accumulated before a step; None: all.
/// position_lr : float or "camera_extent"
///     Initial learning rate of the means, 3 mm; or the formula 5e-4 · 1.1 · the largest distance of a camera
///     centre from their mean.
/// position_lr_factor : float
///     Multiplies ``position_lr``, 1; the paper's dome rigs ran with 10 times the formula.
/// log_scale_lr, rotation_lr : float
///     Learning rates of log-scales (0.005) and quaternions (0.001).
/// lr_decay, lr_decay_steps : float
///     The position's learning rate falls by ``lr_decay`` over ``lr_decay_steps``: 0.01 over 1000.
/// adam_betas, adam_epsilon
///     Adam's β (0.9, 0.999) and ε (1e-15).
/// stop_tolerance : float
///     Stop when the window minimum of the loss changes by less, 1e-6.
/// stop_window : int or None
///     Steps per window; None: the number of views.
/// resolution : float
///     Render at this factor of the cameras' resolution, 1.
/// loss_history : bool
///     Keep the loss of every step, False.
///
/// Raises
/// ------
/// InvalidInputError
///     An unknown field, or a value outside its domain; the message names the field.
#[pyclass(frozen, eq, module = "skelsplat", name = "RefineConfig")]
#[derive(PartialEq)]
pub(crate) struct RefineConfig(pub(crate) Core);

/// A setting as Python sees it.
trait Field: Sized {
    const EXPECTED: &'static str;
    fn parse(value: &Bound<'_, PyAny>) -> Result<Self>;
    fn show<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>>;
}

macro_rules! plain_field {
    ($type:ty, $expected:literal) => {
        impl Field for $type {
            const EXPECTED: &'static str = $expected;
            fn parse(value: &Bound<'_, PyAny>) -> Result<Self> {
                Ok(value.extract()?)
            }
            fn show<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
                self.into_bound_py_any(py)
            }
        }
    };
}

use pyo3::IntoPyObjectExt;
plain_field!(f64, "a number");
plain_field!(u8, "0, 1, 2 or 3");
plain_field!(usize, "a whole number of at least 0");
plain_field!(bool, "True or False");
plain_field!([f64; 2], "two numbers");
plain_field!(Option<usize>, "a whole number of at least 1, or None");
plain_field!(Option<f64>, "a number or None");

impl Field for Encoding {
    const EXPECTED: &'static str = "'one_hot', 'rgb' or 'single'";
    fn parse(value: &Bound<'_, PyAny>) -> Result<Self> {
        let name = value.cast::<PyString>().map_err(PyErr::from)?;
        Ok(Self::by_name(&name.to_cow()?)?)
    }
    fn show<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.name().into_bound_py_any(py)
    }
}

impl Field for Renderer {
    const EXPECTED: &'static str = "'raster' or 'closed_form'";
    fn parse(value: &Bound<'_, PyAny>) -> Result<Self> {
        let name = value.cast::<PyString>().map_err(PyErr::from)?;
        Ok(Self::by_name(&name.to_cow()?)?)
    }
    fn show<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.name().into_bound_py_any(py)
    }
}

impl Field for Optimizer {
    const EXPECTED: &'static str = "'adam' or 'gauss_newton'";
    fn parse(value: &Bound<'_, PyAny>) -> Result<Self> {
        let name = value.cast::<PyString>().map_err(PyErr::from)?;
        Ok(Self::by_name(&name.to_cow()?)?)
    }
    fn show<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.name().into_bound_py_any(py)
    }
}

impl Field for Option<Vec<f64>> {
    const EXPECTED: &'static str = "a sequence of numbers, or None";
    fn parse(value: &Bound<'_, PyAny>) -> Result<Self> {
        if value.is_none() {
            return Ok(None);
        }
        let given = Array::read("", value)?;
        let ok = given.shape.len() == 1;
        Ok(Some(given.shaped(ok, Self::EXPECTED)?.values))
    }
    fn show<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let Some(values) = self else { return Ok(py.None().into_bound(py)) };
        Ok(PyTuple::new(py, values)?.into_any())
    }
}

impl Field for PositionLearningRate {
    const EXPECTED: &'static str = "a number of mm, or 'camera_extent'";
    fn parse(value: &Bound<'_, PyAny>) -> Result<Self> {
        if value.cast::<PyString>().is_ok_and(|name| *name == "camera_extent") {
            return Ok(Self::CameraExtent);
        }
        Ok(Self::Millimetres(value.extract()?))
    }
    fn show<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        match self {
            Self::Millimetres(mm) => mm.into_bound_py_any(py),
            Self::CameraExtent => "camera_extent".into_bound_py_any(py),
        }
    }
}

fn parse<T: Field>(name: &str, value: &Bound<'_, PyAny>) -> Result<T> {
    T::parse(value).map_err(|failure| {
        let words = |_: &PyErr| Error::invalid(format!("config.{name}"), T::EXPECTED, repr(value));
        in_words(value.py(), failure.into(), words)
    })
}

/// Getters, setters and the list of fields from one table.
macro_rules! fields {
    ($($field:ident)*) => {
        const FIELDS: &[&str] = &[$(stringify!($field)),*];

        fn set(config: &mut Core, name: &str, value: &Bound<'_, PyAny>) -> Result<()> {
            match name {
                $(stringify!($field) => config.$field = parse(name, value)?,)*
                _ => {
                    let known = FIELDS.iter().map(ToString::to_string).collect();
                    let name = name.to_owned();
                    return Err(Error::UnknownName { argument: "config", name, known }.into());
                }
            }
            Ok(())
        }

        #[pymethods]
        impl RefineConfig {
            #[new]
            #[pyo3(signature = (**fields))]
            fn new(fields: Option<&Bound<'_, PyDict>>) -> Result<Self> {
                Self::with(Core::default(), fields)
            }

            /// Return the published method, with any field changed by keyword.
            #[staticmethod]
            #[pyo3(signature = (**fields))]
            fn paper(fields: Option<&Bound<'_, PyDict>>) -> Result<Self> {
                Self::with(Core::paper(), fields)
            }

            /// Return a copy with some fields changed.
            #[pyo3(signature = (**fields))]
            fn replace(&self, fields: Option<&Bound<'_, PyDict>>) -> Result<Self> {
                Self::with(self.0.clone(), fields)
            }

            /// Return every field with its value.
            fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
                let out = PyDict::new(py);
                $(out.set_item(stringify!($field), self.0.$field.show(py)?)?;)*
                Ok(out)
            }

            fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Rebuilt<'py>> {
                let py = slf.py();
                rebuilt(slf.as_any(), PyTuple::empty(py), slf.get().to_dict(py)?)
            }

            fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
                let mut shown = Vec::new();
                $(shown.push(format!("{}={}", stringify!($field), self.0.$field.show(py)?.repr()?));)*
                Ok(format!("RefineConfig({})", shown.join(", ")))
            }

            $(
                #[getter]
                fn $field<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
                    self.0.$field.show(py)
                }
            )*
        }
    };
}

fields! {
    renderer optimizer sigma occlusion_sigma joint_sigmas sigma_start sigma_decay sigma_per_noise
    detection_sigma view_weights symmetry_tier symmetry_sigma find_swaps max_steps step_tolerance
    dilation encoding symmetry_weight views_per_step position_lr position_lr_factor log_scale_lr rotation_lr lr_decay
    lr_decay_steps adam_betas adam_epsilon stop_tolerance stop_window undistort min_confidence
    resolution loss_history n_threads
}

/// The paper's f, an input beside the fields: it stands for `occlusion_sigma`.
const OCCLUSION_FACTOR: &str = "occlusion_factor";

impl RefineConfig {
    fn with(mut config: Core, fields: Option<&Bound<'_, PyDict>>) -> Result<Self> {
        let Some(fields) = fields else { return Ok(Self(config)) };
        for (name, value) in fields.iter() {
            // not `to_string`: str() runs what Ctrl-C has left to do, and its error would be lost
            let name: String = name.extract()?;
            if name != OCCLUSION_FACTOR {
                set(&mut config, &name, &value)?;
            }
        }
        if let Some(factor) = fields.get_item(OCCLUSION_FACTOR)?.filter(|f| !f.is_none()) {
            if fields.contains("occlusion_sigma")? {
                let actual = "occlusion_sigma as well";
                return Err(
                    Error::invalid("config.occlusion_factor", "one of the two", actual).into()
                );
            }
            let factor = parse(OCCLUSION_FACTOR, &factor)?;
            config.occlusion_sigma = Some(config.occlusion_sigma_of_factor(factor));
        }
        config.validate()?;
        Ok(Self(config))
    }
}

impl<'py> FromPyObject<'_, 'py> for RefineConfig {
    type Error = Failure;

    fn extract(value: Borrowed<'_, 'py, PyAny>) -> Result<Self> {
        let wrong = || Error::invalid("config", "a RefineConfig or None", type_name(&value));
        Ok(value.cast::<Self>().map(|config| Self(config.get().0.clone())).map_err(|_| wrong())?)
    }
}

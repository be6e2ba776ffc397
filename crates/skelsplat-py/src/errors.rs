//! One mapping from the core's errors to the classes of `skelsplat.exceptions`.

use pyo3::exceptions::{PyException, PyKeyboardInterrupt, PyMemoryError};
use pyo3::prelude::*;
use pyo3::types::PyType;
use skelsplat_core::Error;

fn raised(py: Python<'_>, class: &str, message: &str) -> PyErr {
    let class = py
        .import("skelsplat.exceptions")
        .and_then(|module| module.getattr(class))
        .and_then(|class| Ok(class.cast_into::<PyType>()?));
    match class {
        Ok(class) => PyErr::from_type(class, message.to_owned()),
        Err(failed) => failed,
    }
}

/// The Python exception of a core error.
pub(crate) fn to_python(py: Python<'_>, error: &Error) -> PyErr {
    let class = match error {
        Error::Cancelled => return PyKeyboardInterrupt::new_err(()),
        Error::OutOfMemory(needed) => return PyMemoryError::new_err(needed.clone()),
        Error::DegenerateGeometry(_) => "DegenerateGeometryError",
        _ => "InvalidInputError",
    };
    raised(py, class, &error.to_string())
}

/// An `InvalidInputError` for what only the Python boundary can see: shapes and types.
pub(crate) fn invalid(
    py: Python<'_>,
    argument: &str,
    expected: &str,
    actual: impl Into<String>,
) -> PyErr {
    to_python(py, &Error::invalid(argument, expected, actual))
}

/// What Python code raised for a value, in our words; Ctrl-C, which any of it may meet, stays what it is.
pub(crate) fn in_words(
    py: Python<'_>,
    raised: PyErr,
    words: impl FnOnce(&PyErr) -> PyErr,
) -> PyErr {
    if raised.is_instance_of::<PyException>(py) { words(&raised) } else { raised }
}

/// Turns core results into Python results.
pub(crate) trait OrRaise<T> {
    /// The value, or the mapped exception.
    fn or_raise(self, py: Python<'_>) -> PyResult<T>;
}

impl<T> OrRaise<T> for skelsplat_core::Result<T> {
    fn or_raise(self, py: Python<'_>) -> PyResult<T> {
        self.map_err(|e| to_python(py, &e))
    }
}

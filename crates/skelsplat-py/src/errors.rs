//! Errors of the binding, and their mapping to `skelsplat.exceptions`.

use pyo3::exceptions::{PyException, PyKeyboardInterrupt, PyMemoryError};
use pyo3::prelude::*;
use pyo3::types::PyType;
use skelsplat_core::Error;

/// An error of the core, or an exception raised by Python code.
pub(crate) enum Failure {
    Core(Error),
    Python(PyErr),
}

pub(crate) type Result<T> = std::result::Result<T, Failure>;

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::Core(error)
    }
}

impl From<PyErr> for Failure {
    fn from(raised: PyErr) -> Self {
        Self::Python(raised)
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::Core(error) => Python::attach(|py| to_python(py, &error)),
            Failure::Python(raised) => raised,
        }
    }
}

/// Rejects an argument.
pub(crate) fn refuse<T>(
    argument: impl Into<String>,
    expected: impl Into<String>,
    actual: impl Into<String>,
) -> Result<T> {
    Err(Error::invalid(argument, expected, actual).into())
}

fn to_python(py: Python<'_>, error: &Error) -> PyErr {
    let class = match error {
        Error::Cancelled => return PyKeyboardInterrupt::new_err(()),
        Error::OutOfMemory(needed) => return PyMemoryError::new_err(needed.clone()),
        _ => "InvalidInputError",
    };
    let class = py
        .import("skelsplat.exceptions")
        .and_then(|module| module.getattr(class))
        .and_then(|class| Ok(class.cast_into::<PyType>()?));
    class.map_or_else(|failed| failed, |class| PyErr::from_type(class, error.to_string()))
}

/// Replaces an exception raised by Python code with the error `words`; `KeyboardInterrupt` is
/// passed on.
pub(crate) fn in_words(py: Python<'_>, raised: PyErr, words: impl FnOnce() -> Error) -> Failure {
    match raised.is_instance_of::<PyException>(py) {
        true => words().into(),
        false => raised.into(),
    }
}

//! How immutable objects are pickled and copied, by every protocol: they are made anew from their arguments.

use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple, PyType};

/// `copyreg.__newobj_ex__`, and what it is called with: the class, its arguments and its keywords.
pub(crate) type Rebuilt<'py> =
    (Bound<'py, PyAny>, (Bound<'py, PyType>, Bound<'py, PyTuple>, Bound<'py, PyDict>));

/// What `__reduce__` returns for an object of these arguments.
pub(crate) fn rebuilt<'py>(
    object: &Bound<'py, PyAny>,
    arguments: Bound<'py, PyTuple>,
    keywords: Bound<'py, PyDict>,
) -> PyResult<Rebuilt<'py>> {
    let make = object.py().import("copyreg")?.getattr("__newobj_ex__")?;
    Ok((make, (object.get_type(), arguments, keywords)))
}

//! `skelsplat.RefineConfig`: the core's table of settings as keywords.

use pyo3::exceptions::PyAttributeError;
use pyo3::prelude::*;
use pyo3::types::{PyCFunction, PyDict, PyString, PyTuple};
use pyo3::{Borrowed, IntoPyObjectExt};
use skelsplat_core::study::refine::config::OCCLUSION_FACTOR;
use skelsplat_core::study::settings::{Kind, Setting as Line};
use skelsplat_core::{Error, Method, RefineConfig as Core, Value};

use crate::args::{Array, Rebuilt, object, rebuilt, repr, type_name};
use crate::errors::{Failure, Result, in_words, refuse};

#[pyclass(frozen, eq, module = "skelsplat", name = "RefineConfig")]
#[derive(PartialEq)]
pub(crate) struct RefineConfig(pub(crate) Core);

/// One setting of ``RefineConfig``.
///
/// Attributes
/// ----------
/// name : str
///     Keyword.
/// type : str
///     Accepted values.
/// default : object
///     Default value.
/// unit : str
///     Unit, empty for none.
/// sentence : str
///     Description.
/// method : str
///     Method it belongs to: ``"annealed"``, ``"paper"`` or ``"both"``.
#[pyclass(frozen, get_all, module = "skelsplat._skelsplat", name = "Setting")]
pub(crate) struct Setting {
    name: &'static str,
    r#type: String,
    default: Py<PyAny>,
    unit: &'static str,
    sentence: &'static str,
    method: &'static str,
}

#[pymethods]
impl Setting {
    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        Ok(format!("Setting({}={})", self.name, self.default.bind(py).repr()?))
    }
}

/// The keyword that names the method.
const METHOD: &str = "method";

#[pymethods]
impl RefineConfig {
    #[new]
    #[pyo3(signature = (**fields))]
    fn new(fields: Option<&Bound<'_, PyDict>>) -> Result<Self> {
        let named = fields.map(|fields| fields.get_item(METHOD)).transpose()?.flatten();
        let method = match named {
            Some(name) => Method::by_name(&method_name(&name)?)?,
            None => Core::default().method,
        };
        Self::with(Core { method, ..Core::default() }, fields)
    }

    /// Return a configuration of the published method, ``paper``; keywords change its settings.
    #[staticmethod]
    #[pyo3(signature = (**fields))]
    fn paper(fields: Option<&Bound<'_, PyDict>>) -> Result<Self> {
        Self::with(Core::paper(), fields)
    }

    /// Return a copy with the given settings changed.
    #[pyo3(signature = (**fields))]
    fn replace(&self, fields: Option<&Bound<'_, PyDict>>) -> Result<Self> {
        Self::with(self.0.clone(), fields)
    }

    /// Return the method and every setting; ``RefineConfig(**fields)`` recreates the configuration.
    fn to_dict<'py>(&self, py: Python<'py>) -> Result<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        out.set_item(METHOD, self.0.method.name())?;
        for line in self.0.settings() {
            out.set_item(line.name, shown(py, line.kind, self.0.get(line.name)?)?)?;
        }
        Ok(out)
    }

    /// Return the settings of a method, those specific to it first.
    #[staticmethod]
    #[pyo3(signature = (method="annealed"))]
    fn settings(py: Python<'_>, method: &str) -> Result<Vec<Setting>> {
        let config = Core { method: Method::by_name(method)?, ..Core::default() };
        let own = config.method.settings().len();
        let setting = |(k, line): (usize, &'static Line)| {
            let value = config.get(line.name)?;
            Ok(Setting {
                name: line.name,
                r#type: type_text(line.kind),
                default: shown(py, line.kind, value)?.unbind(),
                unit: line.unit,
                sentence: line.sentence,
                method: if k < own { config.method.name() } else { "both" },
            })
        };
        config.settings().enumerate().map(setting).collect()
    }

    /// Name of the method, ``"annealed"`` or ``"paper"``.
    #[getter]
    fn method(&self) -> &'static str {
        self.0.method.name()
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> Result<Rebuilt<'py>> {
        let py = slf.py();
        Ok(rebuilt(slf.as_any(), PyTuple::empty(py), slf.get().to_dict(py)?)?)
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let assignment = |(name, value): (Bound<'_, PyAny>, Bound<'_, PyAny>)| {
            Ok(format!("{name}={}", value.repr()?))
        };
        let all: PyResult<Vec<String>> = self.to_dict(py)?.iter().map(assignment).collect();
        Ok(format!("RefineConfig({})", all?.join(", ")))
    }
}

impl RefineConfig {
    fn with(mut config: Core, fields: Option<&Bound<'_, PyDict>>) -> Result<Self> {
        let Some(fields) = fields else { return Ok(Self(config)) };
        for (name, value) in fields.iter() {
            // not `to_string`: str() runs pending signal handlers, and the error raised by Ctrl-C
            // would be lost
            let name: String = name.extract()?;
            if name == METHOD {
                // the method of a configuration is fixed
                let method = config.method.name();
                if method_name(&value)? != method {
                    return refuse("config.method", format!("'{method}'"), repr(&value));
                }
            } else if name != OCCLUSION_FACTOR.name {
                let line = config.setting(&name, &format_args!("{value:?}"))?;
                let value = read(line, &value)?;
                config.set(&name, &value)?;
            }
        }
        if let Some(factor) = fields.get_item(OCCLUSION_FACTOR.name)?.filter(|f| !f.is_none()) {
            if fields.contains("occlusion_sigma_mm")? {
                let actual = "occlusion_sigma_mm as well";
                return refuse("config.occlusion_factor", "only one of the two", actual);
            }
            if let Value::Number(factor) = read(&OCCLUSION_FACTOR, &factor)? {
                config.set_occlusion_factor(factor);
            }
        }
        config.validate()?;
        Ok(Self(config))
    }
}

impl<'py> FromPyObject<'_, 'py> for RefineConfig {
    type Error = Failure;

    fn extract(value: Borrowed<'_, 'py, PyAny>) -> Result<Self> {
        object("config", &value, "a RefineConfig or None").map(|it: &Self| Self(it.0.clone()))
    }
}

fn method_name(value: &Bound<'_, PyAny>) -> Result<String> {
    let wrong = || Error::invalid("config.method", "a name", type_name(value));
    Ok(value.cast::<PyString>().map_err(|_| wrong())?.to_cow()?.into_owned())
}

/// A Python value converted to the setting's kind.
fn read(line: &Line, value: &Bound<'_, PyAny>) -> Result<Value> {
    read_kind(line.kind, value).map_err(|failure| {
        let field = format!("config.{}", line.name);
        let words = || Error::invalid(field, line.kind.expected(), repr(value));
        in_words(value.py(), failure.into(), words)
    })
}

fn read_kind(kind: Kind, value: &Bound<'_, PyAny>) -> Result<Value> {
    Ok(match kind {
        Kind::NumberOrNothing | Kind::CountOrNothing | Kind::NumbersOrNothing | Kind::OneOrEach
            if value.is_none() =>
        {
            Value::Nothing
        }
        Kind::Number | Kind::NumberOrNothing => Value::Number(value.extract()?),
        Kind::Count | Kind::CountOrNothing => Value::Count(value.extract()?),
        Kind::Switch => Value::Switch(value.extract()?),
        Kind::Pair => Value::Numbers(value.extract::<[f64; 2]>()?.to_vec()),
        Kind::NumbersOrNothing => {
            let given = Array::read("", value)?;
            let ok = given.shape.len() == 1;
            Value::Numbers(given.shaped(ok, "one axis")?.values)
        }
        Kind::OneOrEach => match value.extract() {
            Ok(number) => Value::Number(number),
            Err(_) => read_kind(Kind::NumbersOrNothing, value)?,
        },
        Kind::Name(names) => {
            let given = value.cast::<PyString>().map_err(PyErr::from)?.to_cow()?;
            let known = names.iter().find(|name| **name == given);
            Value::Name(known.ok_or_else(|| Error::invalid("", kind.expected(), given.clone()))?)
        }
        Kind::NumberOrName(name) => {
            let is_name = value.cast::<PyString>().is_ok_and(|given| *given == name);
            if is_name { Value::Name(name) } else { Value::Number(value.extract()?) }
        }
    })
}

/// A value as a Python object.
fn shown<'py>(py: Python<'py>, kind: Kind, value: Value) -> PyResult<Bound<'py, PyAny>> {
    match value {
        Value::Number(x) => x.into_bound_py_any(py),
        Value::Count(n) => n.into_bound_py_any(py),
        Value::Switch(on) => on.into_bound_py_any(py),
        Value::Name(name) => name.into_bound_py_any(py),
        Value::Numbers(pair) if kind == Kind::Pair => pair.into_bound_py_any(py),
        Value::Numbers(all) => Ok(PyTuple::new(py, all)?.into_any()),
        Value::Nothing => Ok(py.None().into_bound(py)),
    }
}

/// The kind of a setting as written in Python's documentation.
fn type_text(kind: Kind) -> String {
    match kind {
        Kind::Number => "float".to_owned(),
        Kind::NumberOrNothing => "float or None".to_owned(),
        Kind::Count => "int".to_owned(),
        Kind::CountOrNothing => "int or None".to_owned(),
        Kind::Switch => "bool".to_owned(),
        Kind::Pair => "(float, float)".to_owned(),
        Kind::NumbersOrNothing => "sequence of float, or None".to_owned(),
        Kind::OneOrEach => "float or sequence of float, or None".to_owned(),
        Kind::Name(names) => {
            let quoted: Vec<String> = names.iter().map(|name| format!("\"{name}\"")).collect();
            format!("{{{}}}", quoted.join(", "))
        }
        Kind::NumberOrName(name) => format!("float or \"{name}\""),
    }
}

/// Adds to the class its documentation and a property per setting, both from the table.
pub(crate) fn describe(py: Python<'_>) -> PyResult<()> {
    let class = py.get_type::<RefineConfig>();
    let property = py.import("builtins")?.getattr("property")?;
    let (annealed, paper) = (Core::default(), Core::paper());
    for line in annealed.settings().chain(paper.method.settings()) {
        let (name, kind) = (line.name, line.kind);
        let get = PyCFunction::new_closure(
            py,
            None,
            None,
            move |arguments: &Bound<'_, PyTuple>, _: Option<&Bound<'_, PyDict>>| {
                let py = arguments.py();
                let config = arguments.get_item(0)?.cast_into::<RefineConfig>()?;
                match config.get().0.get(name) {
                    Ok(value) => shown(py, kind, value).map(Bound::unbind),
                    Err(error) => Err(PyAttributeError::new_err(error.to_string())),
                }
            },
        )?;
        class.setattr(name, property.call1((get, py.None(), py.None(), in_rst(line.sentence)))?)?;
    }
    class.setattr("__doc__", documentation(py)?)
}

/// Converts Rust's code marks to those of reStructuredText.
fn in_rst(text: &str) -> String {
    text.replace('`', "``")
}

const SUMMARY: &str = "\
Settings of ``refine``. Immutable.

``RefineConfig(...)`` configures the default method, ``annealed``: splats that narrow to the noise
of the detections, from any initial pose. ``RefineConfig.paper(...)`` configures the published
method, ``paper``: rendered pixels and Adam. Every setting is a keyword; settings of the other
method are rejected, and settings not given keep their defaults. Lengths are in mm whatever the unit
of the cameras; their names end in ``_mm``.

Parameters
----------
";

const RAISES: &str = "\
Raises
------
InvalidInputError
    An unknown setting, one of the other method, or a value outside its domain; the message names
    it.
";

/// The class's documentation, in the style of numpydoc.
fn documentation(py: Python<'_>) -> Result<String> {
    let entry = |line: &Line, default: Option<String>| -> Result<String> {
        let options = PyDict::new(py);
        options.set_item("width", 106)?;
        options.set_item("initial_indent", "    ")?;
        options.set_item("subsequent_indent", "    ")?;
        let fill = py.import("textwrap")?.getattr("fill")?;
        let unit = if line.unit.is_empty() { String::new() } else { format!(", {}", line.unit) };
        let default = default.map_or_else(String::new, |value| format!(", default {value}"));
        let body: String = fill.call((in_rst(line.sentence),), Some(&options))?.extract()?;
        Ok(format!("{} : {}{unit}{default}\n{body}\n", line.name, type_text(line.kind)))
    };
    let (annealed, paper) = (Core::default(), Core::paper());
    let table = |config: &Core, lines: &[Line]| -> Result<String> {
        let row = |line: &Line| entry(line, Some(config.get(line.name)?.to_string()));
        lines.iter().map(row).collect()
    };
    Ok([
        SUMMARY.to_owned(),
        table(&annealed, Core::SETTINGS)?,
        entry(&OCCLUSION_FACTOR, None)?,
        "\nOther Parameters\n----------------\n".to_owned(),
        // Without code marks: Sphinx prints these headings as plain text.
        "For annealed, accepted by RefineConfig(...):\n\n".to_owned(),
        table(&annealed, annealed.method.settings())?,
        "\nFor paper, accepted by RefineConfig.paper(...):\n\n".to_owned(),
        table(&paper, paper.method.settings())?,
        format!("\n{RAISES}"),
    ]
    .concat())
}

//! Scenes and finite differences for the tests in `suite` and for the benches.

pub mod differences;
pub mod scenes;

use skelsplat_core::{Error, Result};

/// The argument that the error of invalid input names.
pub fn refused<T: std::fmt::Debug>(result: Result<T>) -> String {
    match result.expect_err("the input is broken") {
        Error::InvalidInput { argument, .. } => argument,
        other => panic!("{other:?}"),
    }
}

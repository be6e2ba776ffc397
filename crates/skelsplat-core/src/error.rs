//! Errors, with the same messages in Rust and Python.

use std::sync::atomic::{AtomicBool, Ordering};

/// Result of a fallible core function.
pub type Result<T> = std::result::Result<T, Error>;

/// Why a call was rejected. Missing data and lack of convergence are outcomes with a status, never
/// an `Error`.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An argument has the wrong shape or a value outside its domain.
    #[error("{argument}: expected {expected}, got {actual}")]
    InvalidInput {
        /// Name of the argument as the caller wrote it, with index or camera name where that helps.
        argument: String,
        /// What was expected.
        expected: String,
        /// What was given.
        actual: String,
    },
    /// An unknown name.
    #[error("{argument}: unknown name '{name}', expected one of {}", known.join(", "))]
    UnknownName {
        /// Name of the argument.
        argument: &'static str,
        /// The given name.
        name: String,
        /// Every valid name.
        known: Vec<String>,
    },
    /// Arrays that do not fit into memory: what they are, how much they need and how much is
    /// available.
    #[error("{0}")]
    OutOfMemory(String),
    /// The caller cancelled the work.
    #[error("cancelled by the caller")]
    Cancelled,
}

/// Ends work whose `flag` is set.
/// Errors: [`Error::Cancelled`].
pub(crate) fn unless_cancelled(flag: &AtomicBool) -> Result<()> {
    if flag.load(Ordering::Relaxed) { Err(Error::Cancelled) } else { Ok(()) }
}

impl Error {
    /// An [`Error::InvalidInput`] with these texts.
    pub fn invalid(
        argument: impl Into<String>,
        expected: impl Into<String>,
        actual: impl Into<String>,
    ) -> Self {
        Self::InvalidInput {
            argument: argument.into(),
            expected: expected.into(),
            actual: actual.into(),
        }
    }

    /// An [`Error::UnknownName`] of these.
    pub(crate) fn unknown<'a>(
        argument: &'static str,
        name: &str,
        known: impl IntoIterator<Item = &'a str>,
    ) -> Self {
        let known = known.into_iter().map(str::to_owned).collect();
        Self::UnknownName { argument, name: name.to_owned(), known }
    }

    /// The same input error with another argument name, that of an outer caller.
    #[must_use]
    pub fn of_argument(self, argument: &str) -> Self {
        self.reworded(|_, expected, actual| (argument.to_owned(), expected, actual))
    }

    /// The same input error with other texts: its argument, what was expected, and what was given.
    pub(crate) fn reworded(
        self,
        words: impl FnOnce(String, String, String) -> (String, String, String),
    ) -> Self {
        match self {
            Self::InvalidInput { argument, expected, actual } => {
                let (argument, expected, actual) = words(argument, expected, actual);
                Self::InvalidInput { argument, expected, actual }
            }
            other => other,
        }
    }
}

//! What can be wrong with an input, said once for Rust and Python alike.

/// Result of a fallible core function.
pub type Result<T> = std::result::Result<T, Error>;

/// Why a call was refused. Missing data and missing convergence are outcomes
/// with a status, never an `Error`.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An argument has the wrong shape or a value outside its domain.
    #[error("{argument}: expected {expected}, got {actual}")]
    InvalidInput {
        /// Name of the argument as the caller wrote it, with index or camera name where that helps.
        argument: String,
        /// What would have been right.
        expected: String,
        /// What came.
        actual: String,
    },
    /// A name that is none of the known ones.
    #[error("{argument}: unknown name '{name}', expected one of {}", known.join(", "))]
    UnknownName {
        /// Name of the argument.
        argument: &'static str,
        /// The name that came.
        name: String,
        /// Every name that would have been right.
        known: Vec<String>,
    },
    /// Geometry that admits no answer, such as two cameras at one place.
    #[error("degenerate geometry: {0}")]
    DegenerateGeometry(String),
    /// Arrays that do not fit into memory: what needs how much, and how much there is.
    #[error("{0}")]
    OutOfMemory(String),
    /// The caller asked to stop before the work was done.
    #[error("cancelled by the caller")]
    Cancelled,
}

impl Error {
    /// An [`Error::InvalidInput`] from anything printable.
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

    /// The same input error about the argument as a caller further up knows it.
    #[must_use]
    pub fn of_argument(self, argument: &str) -> Self {
        match self {
            Self::InvalidInput { expected, actual, .. } => {
                Self::invalid(argument, expected, actual)
            }
            other => other,
        }
    }
}

//! Ways to choose one person in a frame without a past: any two figures propose a body, and every
//! view is asked who is there.
//!
//! A body explains a view if the median distance of its joints from those of a figure there is
//! below the view's gate. The more views it explains the better; then the smaller the error, and
//! the larger the figures. Over the frames, `path` follows one of them.
//!
//! The work of a frame is bounded: of very many figures the smallest are left out, and proposals
//! are judged in the order in which their rays agree, until a number of comparisons is reached.

mod figures;
mod kept;
mod path;
mod rules;
mod search;
mod weigh;

pub use path::{Chosen, Linking, choose};
pub use rules::{MOST_WORK, Rules};
pub use search::{Choice, Choices, choices};

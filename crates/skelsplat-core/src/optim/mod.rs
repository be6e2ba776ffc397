//! First-order optimisation of the skeleton: Adam, learning-rate decay and the paper's stopping rule.

pub mod adam;
pub mod schedule;
pub mod stopping;

//! Steps: Adam with learning-rate decay and the paper's stopping rule, and Gauss–Newton.

pub mod adam;
pub mod gauss_newton;
pub mod schedule;
pub mod stopping;

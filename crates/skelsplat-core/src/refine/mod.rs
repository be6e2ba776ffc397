//! Refining a pose: configuration, objective, the paper's loop and what comes out.

mod adam;
mod annealed;
pub mod config;
pub mod objective;
pub mod paper;
pub mod refiner;
pub mod result;
mod starts;

pub use config::{Optimizer, PositionLearningRate, RefineConfig, Renderer};
pub use objective::{Loss, Objective, Targets};
pub use refiner::Refiner;
pub use result::{JointStatus, Refinement, StopReason};

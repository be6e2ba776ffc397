//! The front door: settings, one frame refined by the method that they choose, and what comes out.

pub mod bias;
pub mod config;
pub mod frame;
pub mod refiner;
pub mod results;

pub use bias::JointBias;
pub use config::{Method, RefineConfig};
pub use frame::Frame;
pub use refiner::Refiner;
pub use results::{Refinement, Refinements};

//! The front door: settings, one frame refined by the method that they choose, and what comes out.

pub mod bias;
pub mod config;
pub mod frame;
pub mod refiner;
pub mod result;
pub mod results;

pub use bias::JointBias;
pub use config::{Method, RefineConfig};
pub use frame::{Control, Frame};
pub use refiner::Refiner;
pub use result::Refinement;
pub use results::Refinements;

//! The cameras of a recording set right: bundle adjustment of the cameras that were moved, and of
//! all joints.
//!
//! [`search`] finds out which cameras are wrong, by the measures of [`evidence`] and [`reduced`],
//! [`clocks`] which clocks are off; [`bundle`] adjusts them; [`adjust`] reports what became of
//! each.

pub mod adjust;
pub mod bias;
pub mod bundle;
pub mod calibrate;
pub mod clocks;
pub mod evidence;
pub mod gauge;
pub mod lenses;
pub mod placed;
pub mod prior;
pub mod reduced;
pub mod report;
pub mod scene;
pub mod search;
pub mod unsteady;

pub use adjust::{Adjustable, adjust_cameras};
pub use calibrate::{CalibratedCamera, Filmed, RigCalibration, Unknown, calibrate_cameras};
pub use evidence::Bars;
pub use placed::{Change, Freedom, Placed};
pub use report::{CameraAdjustment, CameraStatus, RigAdjustment};

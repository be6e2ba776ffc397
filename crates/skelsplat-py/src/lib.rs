//! Python module `skelsplat._skelsplat`: parses arguments, releases the interpreter, calls the core
//! and wraps the results. It contains no mathematics, no defaults and no file access.

#![allow(clippy::needless_pass_by_value, reason = "PyO3 passes parsed arguments by value")]

mod args;
mod camera;
mod config;
mod detections;
mod errors;
mod geometry;
mod layout;
mod people;
mod refine;
mod rig;
mod study;
mod watch;

use pyo3::prelude::*;

/// The compiled core.
#[pymodule(gil_used = false)]
mod _skelsplat {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::camera::Camera;
    #[pymodule_export]
    use crate::config::{RefineConfig, Setting};
    #[pymodule_export]
    use crate::geometry::{fuse_monocular, project, triangulate};
    #[pymodule_export]
    use crate::layout::Layout;
    #[pymodule_export]
    use crate::people::{PyTracker, check_people, people_identities, people_scores, track_people};
    #[pymodule_export]
    use crate::refine::{
        PyKnown, PyLive, PyRefiner, checked_detections, implausible_extent, sequence_window_size,
        sequence_windows,
    };
    #[pymodule_export]
    use crate::rig::{adjust_cameras, calibrate_cameras};
    #[pymodule_export]
    use crate::study::{
        frame_evidence, loss_and_gradient, project_gaussians, pseudo_ground_truth, render,
        rig_equations, sequence_equations,
    };

    #[pymodule_init]
    fn init(m: &Bound<'_, PyModule>) -> PyResult<()> {
        crate::config::describe(m.py())?;
        m.add("__version__", env!("CARGO_PKG_VERSION"))?;
        m.add("LAYOUT_NAMES", skelsplat_core::Layout::NAMES.to_vec())?;
        m.add("HIGHEST_CONFIDENCE", crate::detections::HIGHEST_CONFIDENCE)?;
        m.add("REJECTED_WEIGHT", skelsplat_core::study::annealed::consensus::REJECTED)?;
        m.add("JOINT_STATUS", skelsplat_core::JointStatus::NAMES)
    }
}

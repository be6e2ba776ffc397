//! Python module `skelsplat._skelsplat`: parses arguments, releases the interpreter, calls the core, wraps
//! what comes back. It holds no mathematics, no defaults and no files.

mod args;
mod camera;
mod config;
mod errors;
mod geometry;
mod layout;
mod pickle;
mod refine;
mod rendering;
mod scores;
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
    use crate::geometry::{fuse_monocular, project, project_gaussians, triangulate};
    #[pymodule_export]
    use crate::layout::Layout;
    #[pymodule_export]
    use crate::refine::{PyRefiner, implausible_extent};
    #[pymodule_export]
    use crate::rendering::{loss_and_gradient, pseudo_ground_truth, render};
    #[pymodule_export]
    use crate::scores::check_people;

    #[pymodule_init]
    fn init(m: &Bound<'_, PyModule>) -> PyResult<()> {
        crate::config::describe(m.py())?;
        m.add("__version__", env!("CARGO_PKG_VERSION"))?;
        m.add("LAYOUT_NAMES", skelsplat_core::study::layout::Layout::NAMES.to_vec())?;
        m.add("REJECTED_WEIGHT", skelsplat_core::study::annealed::consensus::REJECTED)?;
        m.add(
            "JOINT_STATUS",
            crate::refine::JOINT_STATUS
                .map(skelsplat_core::study::outcome::JointStatus::name)
                .to_vec(),
        )
    }
}

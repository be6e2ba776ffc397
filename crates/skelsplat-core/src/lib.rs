//! Accurate 3D human pose from 2D keypoints of several calibrated cameras, without training.
//!
//! Each joint is a 3D Gaussian (μ_j, Σ_j). It is projected into every view i and matched to a
//! Gaussian at the 2D detection d_ij there. The default method, `annealed`, takes round splats Σ =
//! σ² I and the overlap in closed form: with e_ij the vector from the ray of the detection to the
//! joint,
//!
//! ```text
//! k_ij = exp(−|e_ij|² / 4σ²)                     how much a detection is trusted
//! F    = Σ_ij c_ij (2σ²/ŝ²) (1 − k_ij) + ½ Σ_j (x_j−x⁰_j)ᵀ Π_j (x_j−x⁰_j)
//!        + ½ Σ_p κ_p (‖l_p‖−‖r_p‖)² / σ_sym²
//! ```
//!
//! minimised by re-weighted Gauss–Newton while σ narrows to the detection noise ŝ, from any initial
//! pose. The published method, `paper`, renders the splats on one channel per joint and optimises
//! them with Adam:
//!
//! ```text
//! L_opt    = L_render + λ_sym L_sym
//! L_render = mean_i  mean over the union mask of  (render_ij − pseudo_ij)²
//! L_sym    = Σ (‖l₁−l₂‖ − ‖r₁−r₂‖)²                    over symmetric limbs
//! render   = min(0.99, exp(−½ (p−m)ᵀ(Σ²)⁻¹(p−m)))      m = π(Rμ+t),  Σ² = J W Σ Wᵀ Jᵀ + h·I
//! ```
//!
//! after "SkelSplat: Robust Multi-view 3D Human Pose Estimation with Differentiable Gaussian
//! Rendering" (WACV 2026).
//!
//! ```
//! use skelsplat_core::nalgebra::{Matrix3, Vector3};
//! use skelsplat_core::{Camera, Detections, Frame, JointStatus, RefineConfig, Refiner, Unit};
//!
//! # fn main() -> skelsplat_core::Result<()> {
//! // Three cameras 5 m from the origin that look at it; x right, y down, z forward.
//! let k = Matrix3::new(1100.0, 0.0, 500.0, 0.0, 1100.0, 500.0, 0.0, 0.0, 1.0);
//! let camera = |angle: f64| {
//!     let (sin, cos) = angle.sin_cos();
//!     let rotation = Matrix3::new(-sin, cos, 0.0, 0.0, 0.0, -1.0, -cos, -sin, 0.0);
//!     Camera::new(&k, &rotation, &Vector3::new(0.0, 0.0, 5.0), [1000, 1000])
//! };
//! let cameras = [camera(0.0)?, camera(2.0)?, camera(4.0)?];
//!
//! // Two joints; the last camera detects the second one 90 px off.
//! let truth = [Vector3::new(0.1, 0.2, 0.3), Vector3::new(-0.2, 0.1, -0.4)];
//! let mut pixels = Vec::new();
//! for (i, camera) in cameras.iter().enumerate() {
//!     for (j, joint) in truth.iter().enumerate() {
//!         let p = camera.project(joint).expect("in front of the camera");
//!         pixels.extend([p.x + if (i, j) == (2, 1) { 90.0 } else { 0.0 }, p.y]);
//!     }
//! }
//! let detections = Detections::new(3, 2, &pixels, None)?;
//!
//! let refiner = Refiner::new(&cameras, Unit::Metre, None, RefineConfig::default())?;
//! let found = refiner.refine(&Frame::from(detections))?;
//! assert!((found.pose[0] - truth[0]).norm() < 1e-3);
//! assert!((found.pose[1] - truth[1]).norm() < 1e-3);
//! assert_eq!(found.joint_status, [JointStatus::Ok; 2]);
//! assert!(found.view_weights[2 * 2 + 1] < 0.01, "the wrong detection is rejected");
//! # Ok(())
//! # }
//! ```
//!
//! [`RefineConfig`] has the settings, described by its tables ([`RefineConfig::settings`]).
//! [`refine_batch`] refines many frames on all cores, bit-identical for any number of them.
//! [`study`] exposes the parts. This crate has no dependency on Python, files or data sets.
//! Internally lengths are millimetres; [`Refiner`] accepts any [`Unit`].

mod annealed;
mod batch;
mod bones;
mod camera;
mod detections;
mod error;
mod follow;
mod gaussian;
mod layout;
mod matrix3;
mod memory;
mod names;
mod outcome;
mod overlap;
mod paper;
mod people;
mod projection;
mod refine;
mod rig;
mod sequence;
mod settings;
mod statistics;
mod symmetry;
mod threads;
mod triangulate;
mod triangulation;
mod unit;

pub use annealed::{AnnealedSettings, Bones};
pub use batch::{Progress, refine_batch};
pub use camera::{Camera, Distortion};
pub use detections::Detections;
pub use error::{Error, Result};
pub use follow::follow;
pub use layout::{KnownLength, Layout, LayoutSpec, OwnAngle, SymmetricPair};
pub use nalgebra;
pub use outcome::{JointStatus, StopReason};
pub use paper::PaperSettings;
pub use people::{Person, TrackedPerson, Tracker, track};
pub use refine::{Frame, JointBias, Method, RefineConfig, Refinement, Refinements, Refiner};
pub use rig::{Adjustable, CameraAdjustment, CameraStatus, RigAdjustment, adjust_cameras};
pub use rig::{CalibratedCamera, Filmed, RigCalibration, Unknown, calibrate_cameras};
pub use sequence::{Known, Live, Sequence, learn_sequence, refine_sequence, refine_windows};
pub use settings::Value;
pub use triangulate::fuse_monocular;
pub use triangulation::{TriangulationMethod, triangulate};
pub use unit::Unit;

/// Makes private modules visible as parts of [`study`].
macro_rules! parts {
    ($($name:ident: $sentence:literal,)*) => {
        /// The parts of the methods, for study, tests and bindings. They follow the mathematics and
        /// may change with any release.
        pub mod study {
            $(
                #[doc = $sentence]
                pub mod $name {
                    pub use crate::$name::*;
                }
            )*
        }
    };
}

parts! {
    annealed: "Annealed splatting, the default method.",
    bones: "Lengths of bones.",
    camera: "Cameras and lenses.",
    detections: "2D detections of one frame.",
    gaussian: "The skeleton of Gaussians.",
    layout: "Joint layouts.",
    memory: "Check of available memory before allocation.",
    outcome: "The result of a method.",
    overlap: "The rendering loss in closed form.",
    paper: "The published method.",
    people: "Several people.",
    projection: "Gaussians projected into a view.",
    refine: "Settings, the refiner and its result.",
    rig: "Cameras set right.",
    sequence: "A recording as a whole.",
    settings: "The definition of settings.",
    symmetry: "The limb-symmetry loss.",
    threads: "The pool of threads of a process.",
    triangulate: "Algebraic triangulation.",
    triangulation: "Triangulation with a method given by name.",
    unit: "Units of length.",
}

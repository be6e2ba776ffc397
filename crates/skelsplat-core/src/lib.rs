//! Accurate 3D human pose from 2D keypoints of several calibrated cameras, without training.
//!
//! Each joint is an anisotropic 3D Gaussian (μ_j, Σ_j). It is splatted into every view i on a channel of its
//! own and matched to a Gaussian at the 2D detection d_ij:
//!
//! ```text
//! L_opt    = L_render + λ_sym L_sym
//! L_render = mean_i  mean over the union mask of  (render_ij − pseudo_ij)²
//! L_sym    = Σ (‖l₁−l₂‖ − ‖r₁−r₂‖)²                    over symmetric limbs
//! render   = min(0.99, exp(−½ (p−m)ᵀ(Σ²)⁻¹(p−m)))      m = π(Rμ+t),  Σ² = J W Σ Wᵀ Jᵀ + h·I
//! ```
//!
//! after "SkelSplat: Robust Multi-view 3D Human Pose Estimation with Differentiable Gaussian Rendering"
//! (WACV 2026). This crate knows no Python, no files and no data sets. Lengths are millimetres inside;
//! [`Refiner`] takes any [`Unit`].

mod annealed;
mod batch;
mod camera;
mod detections;
mod error;
mod follow;
mod gaussian;
mod layout;
mod memory;
mod outcome;
mod overlap;
mod paper;
mod projection;
mod refine;
mod settings;
mod symmetry;
#[cfg(feature = "testing")]
pub mod testing;
mod threads;
mod triangulate;
mod triangulation;
mod unit;

pub use annealed::AnnealedSettings;
pub use batch::{Progress, refine_batch};
pub use camera::{BrownConrady, Camera, Distortion, Fisheye, Undistorted};
pub use detections::Detections;
pub use error::{Error, Result};
pub use follow::Follower;
pub use gaussian::{Gaussian, GaussianGradient};
pub use layout::{Layout, LayoutSpec, SymmetricPair};
pub use nalgebra;
pub use outcome::{JointStatus, Loss, StopReason};
pub use paper::{Encoding, LossAndGradient, PaperSettings, PositionLearningRate, Renderer};
pub use refine::{Control, Frame, Method, RefineConfig, Refinement, Refiner};
pub use settings::{Domain, Kind, Setting, Value};
pub use triangulate::{Triangulated, fuse_monocular};
pub use triangulation::{TriangulationMethod, triangulate};
pub use unit::Unit;

/// Makes private modules visible as parts of [`study`].
macro_rules! parts {
    ($($name:ident: $sentence:literal,)*) => {
        /// The parts that the methods are made of, for study, tests and bindings. They follow the mathematics and may
        /// change with any release.
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
    camera: "Cameras and lenses.",
    detections: "2D detections of one frame.",
    gaussian: "The skeleton of Gaussians.",
    layout: "Joint layouts.",
    memory: "Whether memory is there before it is allocated.",
    outcome: "What a method hands back.",
    overlap: "The rendering loss in closed form.",
    paper: "The published method.",
    projection: "Gaussians projected into a view.",
    refine: "Settings, the refiner and its result.",
    symmetry: "The limb-symmetry loss.",
    triangulate: "Triangulation by algebra.",
    unit: "Units of length.",
}

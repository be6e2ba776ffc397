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
//! [`refine::Refiner`] takes any [`unit::Unit`].

pub mod annealed;
pub mod batch;
pub mod camera;
pub mod detections;
pub mod error;
pub mod gaussian;
pub mod layout;
pub mod memory;
pub mod optim;
pub mod overlap;
pub mod projection;
pub mod raster;
pub mod refine;
pub mod symmetry;
pub mod testing;
pub mod threads;
pub mod triangulate;
pub mod uncertainty;
pub mod unit;

pub use error::{Error, Result};

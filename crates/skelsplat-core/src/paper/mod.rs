//! The published method: every joint's Gaussian is rendered into every view and optimised by Adam
//! until the images match heat maps of the detections (paper §3).
//!
//! Channel j of view i holds `a(p) = min(0.99, exp(−½ (p−m)ᵀ(Σ²)⁻¹(p−m)))`, zero where it is below
//! 1/255 (DESIGN §2). Only pixels inside the ellipse a = 1/255 are visited, so the cost of a
//! channel depends on the size of its splat and not on that of the image. Values and gradients are
//! computed together.

pub mod adam;
pub mod composite;
pub mod encoding;
pub mod frame;
pub mod masked_l2;
pub mod objective;
pub mod optimise;
pub mod pseudo_gt;
pub mod render;
pub mod rows;
pub mod settings;
pub mod splat;

pub use encoding::Encoding;
pub use frame::{LossAndGradient, PaperFrame, Shapes};
pub use objective::Objective;
pub use settings::{PaperSettings, PositionLearningRate, Renderer};

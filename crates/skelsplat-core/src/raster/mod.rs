//! The paper's renderer: one window of pixels per joint and view, forward and gradient side by side.
//!
//! Channel j of view i holds `a(p) = min(0.99, exp(−½ (p−m)ᵀ(Σ²)⁻¹(p−m)))`, zero where it is below 1/255
//! (DESIGN §2). Nothing outside the ellipse a = 1/255 is ever touched, so the cost of a channel depends on
//! the size of its splat and not on that of the image.

pub mod composite;
pub mod encoding;
pub mod masked_l2;
pub mod pseudo_gt;
pub mod render;
pub mod rows;
pub mod splat;

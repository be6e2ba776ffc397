//! Annealed splatting: the closed-form loss of a whole pose as a robust M-estimator, solved from
//! any initial pose.
//!
//! With k = exp(−|e|²/4σ²) ([`rays`]), the closed-form loss of a channel, divided by the channel's
//! energy, is 1 − k: a Welsch loss of the width of the splat. On the scale of the detection noise ŝ
//! ([`noise`]), the pose minimises
//!
//! ```text
//! F = Σ_ij c_ij (2σ²/ŝ²)(1 − k_ij) + ½ Σ_j (x_j−x⁰_j)ᵀ Π_j (x_j−x⁰_j)
//!     + ½ Σ_p κ_p (‖l_p‖−‖r_p‖)² / σ_sym²
//! ```
//!
//! where ŝ² is the noise variance of a detection of mean weight c̄, multiplied by c̄ so that a
//! common factor on all confidences has no effect, Π is the precision of an independent prior and κ
//! the weight of a limb pair. Since ∂F/∂x_j = Σ c k e / ŝ² + …, each step of [`solver`] is a
//! weighted least-squares problem: iteratively re-weighted Gauss–Newton. σ starts wide, where every
//! detection counts, and narrows to the noise.

mod across;
pub mod consensus;
mod couplings;
pub mod depth;
pub mod equations;
pub mod evidence;
pub mod frame;
mod joints;
mod lanes;
pub mod noise;
pub mod places;
pub mod posterior;
pub mod problem;
pub mod rays;
mod rivals;
pub mod settings;
pub mod solver;
pub mod starts;
pub mod swaps;
pub mod views;

pub use frame::{Alone, Annealed, AnnealedFrame};
pub use noise::NoiseModel;
pub use problem::{Annealing, Prior, Solution};
pub use rays::{Offset, Ray, Rays};
pub use settings::{AnnealedSettings, Bones};
pub use starts::Before;

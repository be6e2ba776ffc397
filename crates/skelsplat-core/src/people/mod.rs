//! Several people: which detection belongs to whom, across views and over time.
//!
//! The overlap that trusts a detection also says to whom it belongs. A figure, what a detector
//! takes for one person in one view, has a ray d_j of confidence c_j for each joint; at a body with
//! the joints x_j it scores the mean overlap
//!
//! ```text
//! s = Σ_j c_j k_j / (Σ_j c_j + 1.5 c̄)        k_j = exp(−|e_j|²/4σ²)
//! ```
//!
//! over the joints that both have, with e_j from the ray to the joint and σ of a body part's size.
//! The pseudo-joints of k = 0 let a figure of two joints say less than a whole one. Two figures of
//! different views score in the same way, with e_j the distance between their rays.
//!
//! Per frame ([`associate`]): (1) bodies, moved on by their velocity, claim figures, in each view
//! by the assignment with the largest sum of scores; (2) each body is placed by its rays, and
//! figures that do not fit it are handed back; (3) what is left is paired across views, and
//! proposals are accepted in the order of their support ([`births`]): the scores of all views at
//! the proposed body, less a penalty for each view that should see it and does not, times how well
//! its bones match the proportions of people; (4) newcomers take the identity of a body that was
//! lost within reach; (5) of two bodies that are one, one goes ([`doubles`]).
//!
//! A recording ([`track`]) is gone through once; figures are then assigned again, to paths smoothed
//! over both sides, and each person is solved by [`crate::refine_sequence`].

mod agreement;
pub mod associate;
pub mod births;
pub mod body;
pub mod crowd;
mod doubles;
mod identities;
pub mod known;
mod recording;
pub mod score;
mod size;
mod tracker;
mod tracks;

pub use agreement::Agreement;
pub use associate::{Associator, Sighting};
pub use crowd::{Crowd, Figure};
pub use recording::{Everybody, Identities, Identity, Person, identify, track};
pub use tracker::{TrackedPerson, Tracker};

//! A recording solved as a whole: bones keep their length, and joints move smoothly, in the same
//! solve.
//!
//! To the terms of annealed splatting ([`crate::annealed`]) come two for the frames t of a
//! recording,
//!
//! ```text
//! F = Σ_t F_data(x_t) + Σ_tb E((‖x_ta − x_tb‖ − l_b)/σ_b)
//!     + ½ Σ_tj κ_tj ‖x_{t−1,j} − 2 x_tj + x_{t+1,j}‖² / (q_j dt³)
//! ```
//!
//! a robust one ([`crate::bones`]) for the length l_b of each bone, which is one for the whole
//! recording, and white acceleration of the spectral density q_j: a second difference over dt has
//! the variance q dt³, so that the same motion gets the same weight at any frame rate. κ makes the
//! kernel of accelerations a Cauchy kernel. All of l, σ_b, q and the noise are learnt from the
//! recording ([`learn`]). [`solver`] anneals with one sparse system per step ([`system`],
//! [`chain`]); [`posterior`] has the error bars.
//!
//! A recording is solved in windows that overlap on either side ([`windows()`]); what is learnt
//! comes from a sample of them and is common to all ([`Known`]). The result does not depend on the
//! number of threads, nor on whether all windows are solved by one call ([`refine_sequence`]) or by
//! several ([`learn_sequence`], [`refine_windows`]).

pub mod chain;
pub mod lasting;
pub mod learn;
pub mod live;
pub mod noise;
mod outcome;
mod path;
pub mod posterior;
pub mod process_noise;
mod recording;
pub mod scales;
mod size;
pub mod solver;
mod swaps;
pub mod system;
pub(crate) mod times;
pub mod tracks;
mod windows;

pub use learn::{Known, Learnt};
pub use live::Live;
pub(crate) use recording::check;
pub use recording::{
    Equations, Sequence, equations, learn_sequence, refine_in_windows, refine_sequence,
    refine_windows,
};
pub(crate) use size::shown_sizes;
pub use windows::{Window, sample, window_size, windows};

//! Many frames at once: rayon over frames, bit-identical for any number of threads.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::refine::{Control, Frame, Refinement, Refiner};
use crate::threads;

/// Progress and cancellation of a batch, shared between threads.
#[derive(Debug, Default)]
pub struct Progress {
    done: AtomicUsize,
    cancel: AtomicBool,
}

impl Progress {
    /// Number of finished frames.
    #[must_use]
    pub fn done(&self) -> usize {
        self.done.load(Ordering::Relaxed)
    }

    /// Counts a finished frame.
    pub(crate) fn advance(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }

    /// Stops the batch at each frame's next step.
    pub fn cancel(&self) {
        self.cancel.store(true, Ordering::Relaxed);
    }

    /// Checks whether to continue.
    ///
    /// # Errors
    /// [`Error::Cancelled`] once the batch is cancelled.
    pub fn check(&self) -> Result<()> {
        if self.cancel.load(Ordering::Relaxed) { Err(Error::Cancelled) } else { Ok(()) }
    }

    /// The cancel flag.
    #[must_use]
    pub fn cancelled(&self) -> &AtomicBool {
        &self.cancel
    }
}

/// Refines every frame independently; results are in order. A single frame distributes its windows over the threads.
///
/// # Errors
/// The error of the first frame with an error, or [`Error::Cancelled`].
pub fn refine_batch(
    refiner: &Refiner,
    frames: &[Frame],
    progress: &Progress,
) -> Result<Vec<Refinement>> {
    let one = |frame: &Frame, parallel: bool| {
        progress.check()?;
        let out = refiner.refine_under(frame, Control { parallel, cancel: &progress.cancel });
        progress.done.fetch_add(1, Ordering::Relaxed);
        out
    };
    let serial = || frames.iter().map(|frame| one(frame, false)).collect();
    let config = refiner.config();
    match frames {
        _ if config.n_threads == Some(1) => serial(),
        // No windows to distribute.
        [_] if !config.draws_pixels() => serial(),
        [frame] => {
            let out = threads::install(config.n_threads, |parallel| one(frame, parallel));
            out.map(|refined| vec![refined])
        }
        _ => {
            let n_threads = config.n_threads.map(|n| n.min(frames.len()));
            threads::install(n_threads, |parallel| match parallel {
                true => {
                    let out: Vec<_> = frames.par_iter().map(|frame| one(frame, false)).collect();
                    out.into_iter().collect()
                }
                false => serial(),
            })
        }
    }
}

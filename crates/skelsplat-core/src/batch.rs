//! Many frames at once: rayon over frames, the same bits on any number of threads.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::refine::refiner::Frame;
use crate::refine::{Refinement, Refiner};

/// How far a batch has come, and the switch that stops it; shared between threads.
#[derive(Debug, Default)]
pub struct Progress {
    done: AtomicUsize,
    cancel: AtomicBool,
}

impl Progress {
    /// Frames that are finished.
    #[must_use]
    pub fn done(&self) -> usize {
        self.done.load(Ordering::Relaxed)
    }

    /// Stops the batch at each frame's next step.
    pub fn cancel(&self) {
        self.cancel.store(true, Ordering::Relaxed);
    }
}

/// Refines every frame on its own, in order. One frame alone shares its windows among the threads.
///
/// # Errors
/// The error of the first frame that has one, or [`Error::Cancelled`].
pub fn refine_batch(
    refiner: &Refiner,
    frames: &[Frame],
    progress: &Progress,
) -> Result<Vec<Refinement>> {
    let one = |(frame, parallel): (&Frame, bool)| {
        if progress.cancel.load(Ordering::Relaxed) {
            return Err(Error::Cancelled);
        }
        let out = refiner.refine(frame, parallel, &progress.cancel);
        progress.done.fetch_add(1, Ordering::Relaxed);
        out
    };
    let threads = refiner.config().n_threads;
    let all = || match frames {
        [frame] => one((frame, threads != Some(1))).map(|r| vec![r]),
        _ if threads == Some(1) => frames.iter().map(|f| one((f, false))).collect(),
        _ => {
            let out: Vec<Result<Refinement>> = frames.par_iter().map(|f| one((f, false))).collect();
            out.into_iter().collect()
        }
    };
    match threads {
        None | Some(1) => all(),
        Some(n) => rayon::ThreadPoolBuilder::new()
            .num_threads(n)
            .build()
            .map_err(|e| Error::invalid("config.n_threads", "a number of threads", e.to_string()))?
            .install(all),
    }
}

//! Many frames at once: rayon over frames, bit-identical for any number of threads.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::error::{Result, unless_cancelled};
use crate::refine::results::size;
use crate::refine::{Frame, Refinement, Refinements, Refiner};
use crate::threads;

/// Frames that are shared between threads at a time: their results are in memory twice.
const CHUNK: usize = 1024;

/// Progress and cancellation of a batch, shared between threads.
#[derive(Debug, Default)]
pub struct Progress {
    done: AtomicUsize,
    expected: AtomicUsize,
    cancel: AtomicBool,
}

impl Progress {
    /// Number of finished frames.
    pub fn done(&self) -> usize {
        self.done.load(Ordering::Relaxed)
    }

    /// Number of frames found to be necessary beyond those given: several people are solved one by
    /// one.
    pub fn expected(&self) -> usize {
        self.expected.load(Ordering::Relaxed)
    }

    /// Expects so many more frames.
    pub(crate) fn expect(&self, frames: usize) {
        self.expected.fetch_add(frames, Ordering::Relaxed);
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
    /// [`crate::Error::Cancelled`] once the batch is cancelled.
    pub fn check(&self) -> Result<()> {
        unless_cancelled(&self.cancel)
    }

    /// The cancel flag.
    pub fn cancelled(&self) -> &AtomicBool {
        &self.cancel
    }
}

/// Refines every frame independently; results are in order. A single frame distributes its windows
/// over the threads.
///
/// # Errors
/// The error of the first frame with an error, [`crate::Error::InvalidInput`] if frames differ in
/// the number of joints, or [`crate::Error::Cancelled`].
pub fn refine_batch(
    refiner: &Refiner,
    frames: &[Frame],
    progress: &Progress,
) -> Result<Refinements> {
    let (_, n) = size(frames)?;
    let mut out = Refinements::new(refiner.joint_bias(n));
    let refine = |frame: &Frame, parallel: bool| {
        progress.check()?;
        let done = refiner.refine_under(frame, parallel, &progress.cancel);
        progress.advance();
        done
    };
    let single = frames.len() == 1;
    let run = |parallel: bool| {
        for chunk in frames.chunks(CHUNK) {
            let done: Result<Vec<Refinement>> = if parallel && !single {
                let done: Vec<_> = chunk.par_iter().map(|frame| refine(frame, false)).collect();
                done.into_iter().collect()
            } else {
                chunk.iter().map(|frame| refine(frame, parallel)).collect()
            };
            done?.iter().for_each(|frame| out.push(frame));
        }
        Ok(out)
    };
    let config = refiner.config();
    // Without pixels a single frame has no windows to distribute.
    if config.n_threads == Some(1) || single && !config.draws_pixels() {
        return run(false);
    }
    let most = if single { usize::MAX } else { frames.len() };
    threads::install(config.n_threads.map(|n| n.min(most)), run)
}

//! Many frames at once: rayon over frames, bit-identical for any number of threads.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::prelude::*;

use crate::error::{Result, unless_cancelled};
use crate::refine::results::Part;
use crate::refine::{Control, Frame, Refinements, Refiner};
use crate::threads;

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
    let mut out = Refinements::room(frames, refiner)?;
    let mut rest = out.part();
    let parts: Vec<Part<'_>> = frames.iter().map(|_| rest.take(1)).collect();
    let refine_into = |(frame, mut part): (&Frame, Part<'_>), parallel: bool| {
        progress.check()?;
        let done = refiner.refine_under(frame, Control { parallel, cancel: &progress.cancel });
        progress.done.fetch_add(1, Ordering::Relaxed);
        part.write(0, &done?);
        Ok(())
    };
    let serial = |parts: Vec<Part<'_>>, parallel| {
        frames.iter().zip(parts).try_for_each(|job| refine_into(job, parallel))
    };
    let config = refiner.config();
    match frames {
        _ if config.n_threads == Some(1) => serial(parts, false),
        // No windows to distribute.
        [_] if !config.draws_pixels() => serial(parts, false),
        [_] => threads::install(config.n_threads, |parallel| serial(parts, parallel)),
        _ => {
            let n_threads = config.n_threads.map(|n| n.min(frames.len()));
            threads::install(n_threads, |parallel| match parallel {
                true => {
                    let out: Vec<_> =
                        frames.par_iter().zip(parts).map(|job| refine_into(job, false)).collect();
                    out.into_iter().collect()
                }
                false => serial(parts, false),
            })
        }
    }?;
    Ok(out)
}

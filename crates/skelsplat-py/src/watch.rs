//! Long calls that Ctrl-C ends: the work has a thread of its own, the calling one looks for signals.

use std::panic::resume_unwind;
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread::Builder;
use std::time::Duration;

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use skelsplat_core::Progress;
use skelsplat_core::Result as CoreResult;

use crate::errors::Result;

/// How often a call looks for signals and reports progress.
const POLL: Duration = Duration::from_millis(50);

/// Views squared times joints, over all frames, up to which they are triangulated within about 5 ms, pairs of views
/// being judged in the worst case.
const SHORT_VIEWS: usize = 50_000;

/// Whether `frames` frames are triangulated within a few milliseconds.
pub(crate) fn is_short(frames: usize, n_views: usize, n_joints: usize) -> bool {
    let size = n_views.saturating_pow(2).saturating_mul(n_joints).saturating_mul(frames);
    size <= SHORT_VIEWS
}

/// Runs `work`, here if it is `short` (a tenth of a second at most), else as [`watched`].
pub(crate) fn run<T: Send + 'static>(
    py: Python<'_>,
    short: bool,
    work: impl FnOnce(&Progress) -> CoreResult<T> + Send + 'static,
) -> Result<T> {
    if short {
        return Ok(py.detach(|| work(&Progress::default()))?);
    }
    watched(py, 0, None, work)
}

/// Runs `work` on a thread of its own while this one tells `report` how much of `total` is done and listens for Ctrl-C.
///
/// Ctrl-C, like an error of `report`, is raised at once; the progress is cancelled, and the thread ends by itself where
/// `work` next looks at that. It owns what it works on and knows nothing of Python.
pub(crate) fn watched<T: Send + 'static>(
    py: Python<'_>,
    total: usize,
    report: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Progress) -> CoreResult<T> + Send + 'static,
) -> Result<T> {
    let (send, mut receive) = channel();
    let progress = Arc::new(Progress::default());
    let shared = Arc::clone(&progress);
    let tell = || report.map_or(Ok(()), |f| f.call1((progress.done(), total)).map(|_| ()));
    // Nobody receives what is done after Ctrl-C.
    let body = move || drop(send.send(work(&shared)));
    let thread = Builder::new()
        .spawn(body)
        .map_err(|e| PyRuntimeError::new_err(format!("no thread could be started: {e}")))?;
    loop {
        let received;
        // A receiver belongs to one thread at a time, so that it moves into the closure and back.
        (receive, received) = py.detach(move || {
            let received = receive.recv_timeout(POLL);
            (receive, received)
        });
        if let Err(stop) = py.check_signals().and_then(|()| tell()) {
            progress.cancel();
            return Err(stop.into());
        }
        match received {
            Ok(done) => return Ok(done?),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => match thread.join() {
                Err(panicked) => resume_unwind(panicked),
                Ok(()) => {
                    return Err(PyRuntimeError::new_err("the work ended without a result").into());
                }
            },
        }
    }
}

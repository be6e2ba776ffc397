//! Long calls that Ctrl-C can interrupt: the work runs on its own thread while the calling thread
//! checks for signals.

use std::panic::resume_unwind;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::Builder;
use std::time::Duration;

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use skelsplat_core::Progress;
use skelsplat_core::Result as CoreResult;

use crate::errors::Result;

/// Interval at which a call checks for signals and reports progress.
const POLL: Duration = Duration::from_millis(50);

/// Views squared times joints, over all frames, up to which triangulation takes at most about 5 ms,
/// also in the worst case of scoring pairs of views.
const SHORT_VIEWS: usize = 50_000;

/// Locks a state, also after a panic of a holder.
pub(crate) fn locked<T>(state: &Mutex<T>) -> MutexGuard<'_, T> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Whether `frames` frames are triangulated within a few milliseconds.
pub(crate) fn is_short(frames: usize, n_views: usize, n_joints: usize) -> bool {
    let size = n_views.saturating_pow(2).saturating_mul(n_joints).saturating_mul(frames);
    size <= SHORT_VIEWS
}

/// Runs `work`: on this thread if it is `short` (at most a tenth of a second), else like
/// [`watched`].
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

/// Runs `work` on its own thread while this one calls `report` with the progress out of `total` and
/// checks for Ctrl-C.
///
/// Ctrl-C and errors of `report` are raised at once. The progress is then cancelled, and the thread
/// ends when `work` next checks it. The thread owns its data and does not use Python.
pub(crate) fn watched<T: Send + 'static>(
    py: Python<'_>,
    total: usize,
    report: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Progress) -> CoreResult<T> + Send + 'static,
) -> Result<T> {
    let (send, mut receive) = channel();
    let progress = Arc::new(Progress::default());
    let shared = Arc::clone(&progress);
    let tell = || {
        let told = (progress.done(), total + progress.expected());
        report.map_or(Ok(()), |f| f.call1(told).map(|_| ()))
    };
    // After Ctrl-C there is no receiver: the error of `send` is ignored.
    let body = move || drop(send.send(work(&shared)));
    let thread = Builder::new()
        .spawn(body)
        .map_err(|e| PyRuntimeError::new_err(format!("no thread could be started: {e}")))?;
    loop {
        let received;
        // A receiver is not `Sync`: move it into the closure and back.
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

//! Threads for frames and windows: one pool per process.
//!
//! Threads do not survive a fork. A child process inherits the memory of its parent's pool but none
//! of its threads, so work submitted to that pool would wait for ever. The pool is therefore stored
//! with the id of the process that owns its threads; another process creates its own.

use std::sync::{Arc, Mutex, PoisonError, TryLockError};
use std::time::Duration;

use rayon::{ThreadPool, ThreadPoolBuilder};

/// A pool and the process that owns its threads.
pub struct Kept {
    /// Its id.
    pub process: u32,
    /// The pool.
    pub pool: Arc<ThreadPool>,
}

/// Locked only to read or replace the value, never while a pool is built or used.
pub static POOL: Mutex<Option<Kept>> = Mutex::new(None);

/// How often the lock is tried. It is held for nanoseconds: if it stays locked, another thread held
/// it at the moment of a fork, and no thread is left to release it.
const TRIES: usize = 200;
/// Time between two tries.
const PAUSE: Duration = Duration::from_millis(1);

/// Runs `work(true)` in a pool of `n_threads` (`None`: the process's pool, one thread per core), or
/// `work(false)` on this thread if no pool can be started.
pub fn install<R: Send>(n_threads: Option<usize>, work: impl FnOnce(bool) -> R + Send) -> R {
    let pool = match n_threads {
        None => pool(),
        Some(n) => ThreadPoolBuilder::new().num_threads(n).build().ok().map(Arc::new),
    };
    match pool {
        Some(pool) => pool.install(|| work(true)),
        None => work(false),
    }
}

/// The pool of this process, created by the first call.
pub fn pool() -> Option<Arc<ThreadPool>> {
    let process = std::process::id();
    let own = |kept: &Option<Kept>| {
        kept.as_ref().filter(|k| k.process == process).map(|k| Arc::clone(&k.pool))
    };
    let found = with_slot(|slot| own(slot));
    if let Some(Some(pool)) = found {
        return Some(pool);
    }
    let made = Arc::new(ThreadPoolBuilder::new().build().ok()?);
    let keep = |slot: &mut Option<Kept>| {
        own(slot).unwrap_or_else(|| {
            // Dropping the parent's pool would signal threads that do not exist here.
            std::mem::forget(slot.replace(Kept { process, pool: Arc::clone(&made) }));
            Arc::clone(&made)
        })
    };
    Some(found.and_then(|_| with_slot(keep)).unwrap_or(made))
}

/// Calls `f` with the slot; `None` if a fork left its lock locked.
pub fn with_slot<R>(f: impl FnOnce(&mut Option<Kept>) -> R) -> Option<R> {
    for _ in 0..TRIES {
        match POOL.try_lock().map_err(poisoned) {
            Ok(mut slot) | Err(Some(mut slot)) => return Some(f(&mut slot)),
            Err(None) => std::thread::sleep(PAUSE),
        }
    }
    None
}

/// Locks the slot, also after a panic of a holder, which cannot corrupt the value; `None` if the
/// lock is held.
fn poisoned<T>(error: TryLockError<T>) -> Option<T> {
    match error {
        TryLockError::Poisoned(held) => Some(PoisonError::into_inner(held)),
        TryLockError::WouldBlock => None,
    }
}

//! The pool of threads of a process, and of one that was forked from it.

use std::sync::{Arc, PoisonError};

use rayon::ThreadPoolBuilder;
use skelsplat_core::study::threads::{Kept, POOL, install, pool, with_slot};

/// A single test, because the slot is global to the process.
#[test]
fn the_pool_belongs_to_the_process() {
    let (first, two) = (pool().unwrap(), pool().unwrap());
    assert!(Arc::ptr_eq(&first, &two));
    assert!(install(None, |parallel| parallel && rayon::current_thread_index().is_some()));

    // The state in a child after a fork: a pool of another process, without its threads. It
    // must not be dropped: the slot keeps its reference.
    let stale = Arc::new(ThreadPoolBuilder::new().num_threads(1).build().unwrap());
    let process = std::process::id().wrapping_add(1);
    let parents = Kept { process, pool: Arc::clone(&stale) };
    std::mem::forget(with_slot(|slot| slot.replace(parents)));
    let own = pool().unwrap();
    assert!(!Arc::ptr_eq(&own, &stale));
    assert_eq!(Arc::strong_count(&stale), 2);

    // A lock that was held at the moment of a fork is abandoned; the work is still done.
    let held = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    assert_eq!(install(None, |_| 6 * 7), 42);
    drop(held);
    assert!(Arc::ptr_eq(&own, &pool().unwrap()));
}

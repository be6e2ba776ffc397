//! Checks that enough memory is available before allocating it.
//!
//! Linux grants more memory than it has and kills the process when it is used, so allocation does
//! not fail. The available memory is therefore checked first.

use std::fs;

use crate::error::{Error, Result};

/// Sizes up to this are not checked.
pub const SMALL: u128 = 64 << 20;
/// Memory limits of a container: Linux control groups version 2 and 1.
const GROUP_LIMITS: [&str; 2] =
    ["/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"];

/// Rejects `bytes` that are not available; `what` names in the message what needs them.
/// Errors: [`Error::OutOfMemory`].
pub fn check(bytes: u128, what: impl FnOnce() -> String) -> Result<()> {
    if bytes <= SMALL {
        return Ok(());
    }
    let gigabytes = |bytes: u128| bytes as f64 / 1e9;
    let refused = |rest: String| {
        Err(Error::OutOfMemory(format!("{} need {:.1} GB{rest}", what(), gigabytes(bytes))))
    };
    match available().map(u128::from) {
        Some(available) if bytes > available => {
            refused(format!(", {:.1} GB are available", gigabytes(available)))
        }
        _ if !reservable(bytes) => refused(", more than this process may use".to_owned()),
        _ => Ok(()),
    }
}

/// Whether the allocator grants `bytes`, which are released at once.
fn reservable(bytes: u128) -> bool {
    usize::try_from(bytes).is_ok_and(|n| Vec::<u8>::new().try_reserve_exact(n).is_ok())
}

/// Bytes that are free or can be freed; `None` if the system does not provide the number.
fn available() -> Option<u64> {
    let machine = fs::read_to_string("/proc/meminfo").ok().and_then(|text| of_meminfo(&text));
    let groups = GROUP_LIMITS.iter().filter_map(|path| fs::read_to_string(path).ok());
    groups.filter_map(|text| text.trim().parse().ok()).chain(machine).min()
}

/// Sum of `MemAvailable` and `SwapFree` of `/proc/meminfo` (in kB), in bytes.
pub fn of_meminfo(text: &str) -> Option<u64> {
    let field = |name: &str| {
        let line = text.lines().find_map(|line| line.strip_prefix(name))?;
        line.trim().trim_end_matches(" kB").parse::<u64>().ok()
    };
    Some(1024 * (field("MemAvailable:")? + field("SwapFree:").unwrap_or(0)))
}

//! The windows in which a recording is solved, and those from which is learnt.

use std::ops::Range;

use super::times::{OVERLAP, frames_in};

/// Least overlap, frames.
const LEAST_OVERLAP: usize = 30;
/// Length of a window, in overlaps, without them.
const WINDOW: usize = 20;
/// Number of windows from which is learnt.
const SAMPLE: usize = 3;

/// A window: the frames it answers for, and those it looks at.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Window {
    /// The frames it answers for.
    pub own: Range<usize>,
    /// Those it looks at: its own, and some on either side.
    pub all: Range<usize>,
}

/// The largest number of frames of a window at this rate, and how many it looks at on either side.
pub fn window_size(fps: f64) -> [usize; 2] {
    let overlap = frames_in(OVERLAP, fps).max(LEAST_OVERLAP);
    [WINDOW.saturating_mul(overlap), overlap]
}

/// Windows over `n` frames of at most `length`, that overlap by `overlap` on either side.
pub fn windows(n: usize, [length, overlap]: [usize; 2]) -> Vec<Window> {
    let count = n.div_ceil(length);
    let cut = |k: usize| k * n / count;
    let window = |k: usize| {
        let own = cut(k)..cut(k + 1);
        let all = own.start.saturating_sub(overlap)..(own.end + overlap).min(n);
        Window { own, all }
    };
    (0..count).map(window).collect()
}

/// The frames of at most `SAMPLE` windows, evenly spread; those that overlap in one.
pub fn sample(windows: &[Window]) -> Vec<Range<usize>> {
    let n = windows.len().min(SAMPLE);
    let mut out: Vec<Range<usize>> = Vec::new();
    for k in 0..n {
        let next = &windows[(2 * k + 1) * windows.len() / (2 * n)].all;
        match out.last_mut() {
            Some(last) if next.start <= last.end => last.end = next.end,
            _ => out.push(next.clone()),
        }
    }
    out
}

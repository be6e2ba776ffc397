//! Times, s, over which things stay the same.

use std::ops::Range;

/// Half of the time over which weights of detections, accelerations and positions are averaged:
/// errors last longer, and motion hardly changes.
pub(crate) const SHORT: f64 = 0.1;
/// Time in which errors become independent.
pub(crate) const INDEPENDENT: f64 = 0.2;
/// Half of the time over which the information of a joint's detections is averaged and the process
/// noise is measured; live, all of the time, also for noise and the body's spread. For so long a
/// chain of joints goes on as it was, and live a joint is bridged.
pub(super) const AROUND: f64 = 0.5;
/// Longest gap over which a joint is bridged, and half of the time over which the scale of noise is
/// measured.
pub(crate) const BRIDGE: f64 = 1.0;
/// Overlap of windows on either side: what is longer ago tells nothing of a frame.
pub(super) const OVERLAP: f64 = 2.0;

/// Number of frames in `seconds`, at least one.
pub(super) fn frames_in(seconds: f64, fps: f64) -> usize {
    ((seconds * fps).round() as usize).max(1)
}

/// Frames up to `reach` away from `t`, of `n`.
pub(super) fn around(t: usize, reach: usize, n: usize) -> Range<usize> {
    t.saturating_sub(reach)..(t + reach + 1).min(n)
}

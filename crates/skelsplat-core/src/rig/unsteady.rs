//! Clocks that change while a camera records: frames were skipped, or its rate is another.
//!
//! Two parts of a recording each have odds over lags. If the clock stays, one lag has to do for
//! both, against which the odds are those of both parts together: min over c of a(c) + b(c). They
//! are to exceed the number of other lags, and of moments, that were tried.

use super::placed::Placed;
use super::search::Scope;
use crate::statistics::STRONG;

/// Quarters of the recording after which its division is tried.
const BEGINNINGS: [usize; 3] = [2, 1, 3];
/// Fewer frames tell no clock.
const LEAST_FRAMES: usize = 30;

/// A clock that changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockChange {
    /// The view.
    pub view: usize,
    /// The first frame of the other clock.
    pub since: usize,
    /// By how many frames it changes.
    pub by: f64,
    /// The logarithm of the odds.
    odds: f64,
}

impl Scope<'_> {
    /// The clock that changes most clearly in a rig, if one does.
    pub(super) fn clock_change(&self, rig: &[Placed]) -> Option<ClockChange> {
        let all = (0..rig.len()).filter_map(|view| self.change_of(rig, view));
        all.max_by(|a, b| a.odds.total_cmp(&b.odds))
    }

    fn change_of(&self, rig: &[Placed], view: usize) -> Option<ClockChange> {
        let begun = |q: &usize| self.divided(rig, view, self.frames.len() * q / 4);
        let (since, _) = BEGINNINGS.iter().find_map(begun)?;
        let (since, change) = self.divided(rig, view, since)?;
        Some(ClockChange { since: *self.frames.get(since)?, ..change })
    }

    /// The change of the clock between the parts divided at a place, and where it changes.
    fn divided(&self, rig: &[Placed], view: usize, at: usize) -> Option<(usize, ClockChange)> {
        if at.min(self.frames.len() - at) < LEAST_FRAMES {
            return None;
        }
        let (before, after) = self.frames.split_at(at);
        let [a, b] = [before, after].map(|frames| Scope { frames, ..*self }.lags(rig, view, None));
        let odds = a.one_for_both(&b)? - (STRONG * (a.count() * BEGINNINGS.len()) as f64).ln();
        let by = b.best - a.best;
        let changes = odds > 0.0 && by != 0.0;
        let since = changes.then(|| self.crossing(rig, view, [a.best, b.best]))?;
        Some((since, ClockChange { view, since, by, odds }))
    }
}

//! A camera that is another from a time on: its clock changes, or it is knocked.

use super::{JUDGED, SEARCHED, Task};
use crate::batch::Progress;
use crate::error::Result;
use crate::rig::calibrate::knocked::moved_camera;
use crate::rig::placed::{Change, Freedom};
use crate::rig::report::{CameraStatus, Changes};
use crate::rig::scene::spread;
use crate::rig::search::{Fault, SearchResult, Supposed};
use crate::rig::unsteady::ClockChange;

impl Task<'_> {
    /// The camera whose clock changes while it records.
    pub(super) fn unsteady(&self, found: &SearchResult) -> Option<Changes> {
        let mut some = spread(&self.fitted, JUDGED);
        some.sort_by_key(|t| self.filmed.times[*t]);
        let ClockChange { view, since, by, .. } =
            self.scope(&some).clock_change(&found.rig.cameras)?;
        let given = &self.given[view];
        let change = Change { clock: by, ..Change::between(given, given) };
        let (since, status) = (self.filmed.times[since], CameraStatus::Unsteady);
        Some(Changes { view, since, status, change, bars: None })
    }

    /// The camera that was moved while it recorded, and where it is in the part of the recording in
    /// which it is not as given.
    pub(super) fn knocked(
        &self,
        found: &SearchResult,
        progress: &Progress,
    ) -> Result<Option<Changes>> {
        let m = self.given.len();
        let views: Vec<usize> = (0..m).filter(|i| !self.is_unseen(*i)).collect();
        if views.len() < 3 || self.what.free.is_some() {
            return Ok(None);
        }
        let rig = &found.rig.cameras;
        let Some((view, since)) = moved_camera(rig, self.filmed, &views, progress)? else {
            return Ok(None);
        };
        let (before, after): (Vec<usize>, Vec<usize>) =
            self.fitted.iter().partition(|t| self.filmed.times[**t] < since);
        let mut cameras = rig.clone();
        cameras[view] = self.given[view].clone();
        let placed = |frames: Vec<usize>| {
            let some = spread(&frames, SEARCHED);
            let scope = self.scope(&some);
            let sigma = scope.sigma(&cameras);
            let still = scope.explain(cameras.clone(), vec![Freedom::default(); m], sigma, 1.0);
            scope.suppose(&still, view, Fault::Place, sigma)
        };
        let parts = [before, after].into_iter().filter_map(placed);
        let elsewhere = parts.max_by(|a: &Supposed, b| a.odds.total_cmp(&b.odds));
        let changes = |Supposed { rig, bars, .. }| {
            let change = Change::between(&self.given[view], &rig.cameras[view]);
            Changes { view, since, status: CameraStatus::Knocked, change, bars: Some(bars) }
        };
        Ok(elsewhere.map(changes))
    }

    /// Leaves a camera as given.
    pub(super) fn put_back(&self, found: &mut SearchResult, view: usize) {
        found.rig.cameras[view] = self.given[view].clone();
        found.rig.freedom[view] = Freedom::default();
        found.rivals.retain(|rival| rival.view != view);
    }
}

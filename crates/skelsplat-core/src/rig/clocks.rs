//! Clocks of cameras: which are off, by how much, and whether they still are once other faults are
//! corrected.
//!
//! Motion tells clocks, so they are judged against errors of detections that last, with places as
//! they are.

use nalgebra::Vector3;

use super::bias::LastingErrors;
use super::bundle::{Bundle, unknowns};
use super::evidence::{odds, wald};
use super::placed::{Change, Freedom, Placed};
use super::search::{CONFIRMED_WALD, Explanation, FAULT_WALD, LEAST, Scope};
use crate::statistics::median;

/// Most frames by which clocks may differ.
const MOST_OFFSET: isize = 30;
/// They differ by at most this part of the recording.
const PART: usize = 3;
/// Odds of strong evidence (Jeffreys, Theory of Probability, appendix B).
const STRONG: f64 = 10.0;
/// The least recording that tells clocks, frames.
const LEAST_FRAMES: usize = 12;

impl Scope<'_> {
    /// Takes back the clocks that are not off any more now that other faults are corrected, the
    /// least sure first.
    pub fn with_sure_clocks(&self, mut rig: Explanation) -> Explanation {
        loop {
            let free = (0..rig.cameras.len()).filter(|i| rig.freedom[*i].clock);
            let odds = free.map(|i| (i, self.clock_odds(&rig, i)));
            match odds.min_by(|a, b| a.1.total_cmp(&b.1)) {
                Some((i, odds)) if odds <= 0.0 => rig = self.without_clocks(&rig, |k| k == i),
                _ => return rig,
            }
        }
    }

    /// The logarithm of the odds that a clock is off now that other faults are corrected, of as
    /// many whole lags as are no longer: where a movement repeats itself, one a period away fits as
    /// well as the true one.
    fn clock_odds(&self, rig: &Explanation, view: usize) -> f64 {
        if self.clock_wald(rig, view) <= CONFIRMED_WALD || !self.is_within(rig, view) {
            return f64::NEG_INFINITY;
        }
        let mut given = rig.cameras.clone();
        given[view].clock = self.given[view].clock;
        let [before, after] = self.moving(&given, &rig.cameras, self.sigma(&rig.cameras));
        let lag = (rig.cameras[view].clock - given[view].clock).abs();
        odds(&before, &after) - (STRONG * (2.0 * lag.ceil() + 1.0)).ln()
    }

    /// The rig with some clocks as given.
    pub fn without_clocks(&self, rig: &Explanation, which: impl Fn(usize) -> bool) -> Explanation {
        let (mut cameras, mut freedom) = (rig.cameras.clone(), rig.freedom.clone());
        for i in (0..cameras.len()).filter(|i| which(*i)) {
            cameras[i].clock = self.given[i].clock;
            freedom[i].clock = false;
        }
        let sigma = self.sigma(&cameras);
        self.explain(cameras, freedom, sigma, 1.0)
    }

    /// Whether a clock is sure also in a rig in which that of another camera is free.
    pub fn clock_stays_off(
        &self,
        rig: &Explanation,
        view: usize,
        other: usize,
        sigma: f64,
    ) -> bool {
        let mut freedom = rig.freedom.clone();
        freedom[other].clock = true;
        let rig = self.explain(rig.cameras.clone(), freedom, sigma, 1.0);
        self.clock_wald(&rig, view) > FAULT_WALD
    }

    /// Whether a clock is off by no more than it may be: where places are wrong, some clock far
    /// away seems to fit.
    pub fn is_within(&self, rig: &Explanation, view: usize) -> bool {
        (rig.cameras[view].clock - self.given[view].clock).abs() <= self.most_offset() as f64 + 1.0
    }

    /// The Wald statistic of a clock's offset: see [`wald`].
    pub fn clock_wald(&self, rig: &Explanation, view: usize) -> f64 {
        let change = Change::between(&self.given[view], &rig.cameras[view]);
        wald(&rig.judged, &unknowns(&rig.freedom, self.lenses), view, Freedom::CLOCK, &change)
    }

    /// The most frames by which a clock may be off.
    pub fn most_offset(&self) -> isize {
        let n = self.scene.n_frames();
        if n < LEAST_FRAMES { 0 } else { MOST_OFFSET.min((n / PART) as isize) }
    }

    /// The whole number of frames by which a camera's clock fits best; `None` if only a part of a
    /// frame is left, which is not asked for, or nothing fits.
    pub fn clock_offset(
        &self,
        camera: &Placed,
        view: usize,
        points: &[Vector3<f64>],
    ) -> Option<f64> {
        let now = camera.clock.round();
        let count = self.scene.distances(self.frames, points, view, camera).len();
        let off = |shift: isize| {
            let tried = Placed { clock: now + shift as f64, ..camera.clone() };
            let sights = self.scene.distances(self.frames, points, view, &tried);
            let enough = 2 * sights.len() >= count && sights.len() >= LEAST;
            enough.then(|| median(sights.iter().map(|(px, mm)| px * mm)))
        };
        let most = self.most_offset();
        let tried = (-most..=most).filter_map(|shift| Some((shift, off(shift)?)));
        let (best, _) = tried.min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.abs().cmp(&b.0.abs())))?;
        (best != 0 || self.clock).then_some(now + best as f64)
    }

    /// What tells clocks alone: errors of detections that last are unknown, and places stay.
    pub fn timing<'a>(&self, bundle: Bundle<'a>) -> Bundle<'a> {
        let clock = |freedom: &Freedom| Freedom { clock: freedom.clock, ..Freedom::default() };
        Bundle {
            freedom: bundle.freedom.iter().map(clock).collect(),
            offsets: Some(LastingErrors::new(self.given.len(), self.scene.n_joints())),
            ..bundle
        }
    }

    /// What every joint costs in every part of the recording without the errors of detections that
    /// last: before and after a change, in frames that both have.
    pub fn moving(&self, before: &[Placed], after: &[Placed], sigma: f64) -> [Vec<f64>; 2] {
        let last = self.scene.n_frames() as f64 - 1.0;
        let inside =
            |t: usize, camera: &Placed| (0.0..=last).contains(&(t as f64 + camera.clock.round()));
        let there = |t: &usize| after.iter().chain(before).all(|camera| inside(*t, camera));
        let frames: Vec<usize> = self.frames.iter().copied().filter(there).collect();
        let scope = Scope { frames: &frames, ..*self };
        [before, after].map(|cameras| {
            let points = scope.scene.points(&frames, cameras, &vec![true; cameras.len()]);
            let still = vec![Freedom::default(); cameras.len()];
            let mut bundle = scope.timing(scope.bundle(cameras.to_vec(), still, points));
            bundle.solve(sigma, sigma);
            bundle.costs(sigma)
        })
    }
}

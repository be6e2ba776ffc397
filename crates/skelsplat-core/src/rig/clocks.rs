//! Clocks of cameras: which are off, by how much, and whether they still are once other faults are
//! corrected.
//!
//! Motion tells clocks, so they are judged against errors of detections that last, with places as
//! they are.

use nalgebra::{Vector2, Vector3};

use super::bias::LastingErrors;
use super::bundle::{Bundle, CHUNK, PER_NOISE, unknowns};
use super::evidence::{log_odds, odds, wald};
use super::placed::{Change, Freedom, Placed};
use super::search::{CONFIRMED_WALD, Explanation, FAULT_WALD, LEAST, RAYLEIGH, Scope};
use crate::statistics::median;

/// Most frames by which clocks may differ.
const MOST_OFFSET: isize = 30;
/// They differ by at most this part of the recording.
const PART: usize = 3;
/// Odds of strong evidence (Jeffreys, Theory of Probability, appendix B).
const STRONG: f64 = 10.0;
/// The least recording that tells clocks, frames.
const LEAST_FRAMES: usize = 12;
/// Frames by which a clock's error bar tells lags apart.
const NEXT: f64 = 2.0;

/// Errors of the detections of one view, (frames, N); `None` where there is none.
type Errors = Vec<Option<Vector2<f64>>>;

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

    /// A clock, and how far it may be from there: the root mean square over whole lags, by their
    /// odds. The next two frames either way are left to its error bar. If no `clock` is named, that
    /// of the lags that are tied which is nearest to the given one.
    pub fn clock_range(&self, rig: &Explanation, view: usize, clock: Option<f64>) -> (f64, f64) {
        let others: Vec<bool> = (0..rig.cameras.len()).map(|i| i != view).collect();
        let points = self.scene.points(self.frames, &rig.cameras, &others);
        let now = rig.cameras[view].clock;
        let odds = self.odds_of_lags(&rig.cameras, view, now, &points);
        let off = |clock: &f64| (clock - self.given[view].clock).abs();
        let tied = odds.iter().filter(|(_, odds)| *odds >= 1.0).map(|(lag, _)| now + lag);
        let nearest = tied.min_by(|a, b| off(a).total_cmp(&off(b)));
        let other = nearest.filter(|clock| (clock - now).abs() > NEXT).unwrap_or(now);
        let clock = clock.unwrap_or(other);
        let far = odds.iter().map(|(lag, odds)| ((now + lag - clock).abs(), odds));
        let far: f64 = far.filter(|(d, _)| *d > NEXT).map(|(d, odds)| odds * d * d).sum();
        let all: f64 = odds.iter().map(|(_, odds)| odds).sum();
        (clock, (far / all.max(1.0)).sqrt())
    }

    /// The whole lags of a clock relative to `now`, each with its odds against the one that fits
    /// best, corrected for the number of lags tried: at most 1, which means tied.
    ///
    /// An error e of the view, less what lasts, costs ρ(e) = 1 − exp(−|e|²/4σ²) where the others
    /// place the joint. If the best lag is right, another with e' costs D more in a cell, a joint
    /// in a part of the recording, in proportion to d = Σ ρ(e' − e): T is the slope of D over d
    /// by the error that allows cells their own noise (White 1980).
    fn odds_of_lags(
        &self,
        rig: &[Placed],
        view: usize,
        now: f64,
        points: &[Vector3<f64>],
    ) -> Vec<(f64, f64)> {
        let most = self.most_offset();
        let errors = |lag: f64| (lag, self.passing(rig, view, now + lag, points));
        let mut all: Vec<(f64, Errors)> = (-most..=most).map(|lag| errors(lag as f64)).collect();
        let known = |errors: &Errors| errors.iter().flatten().count();
        let enough = LEAST.max(all.iter().map(|(_, errors)| known(errors)).max().unwrap_or(0) / 2);
        all.retain(|(_, errors)| known(errors) >= enough);
        let size = |errors: &Errors| median(errors.iter().flatten().map(Vector2::norm));
        let least = all.iter().map(|(_, errors)| size(errors)).fold(f64::INFINITY, f64::min);
        let kernel = 2.0 * PER_NOISE * (least / RAYLEIGH).max(f64::MIN_POSITIVE);
        let cost = |e: &Vector2<f64>| 1.0 - (-(e / kernel).norm_squared()).exp();
        let mean =
            |errors: &Errors| errors.iter().flatten().map(cost).sum::<f64>() / known(errors) as f64;
        let rated = all.iter().map(|(_, errors)| (mean(errors), errors));
        let Some((_, best)) = rated.min_by(|a, b| a.0.total_cmp(&b.0)) else {
            return Vec::new();
        };
        let n = self.scene.n_joints();
        let odds = |errors: &Errors| {
            let mut cells = vec![[0.0; 2]; n * self.frames.len().div_ceil(CHUNK)];
            for (k, (own, other)) in errors.iter().zip(best).enumerate() {
                if let (Some(own), Some(other)) = (own, other) {
                    let [more, due] = &mut cells[k % n + n * (k / n / CHUNK)];
                    *more += cost(own) - cost(other);
                    *due += cost(&(own - other));
                }
            }
            let due: f64 = cells.iter().map(|[_, due]| due * due).sum();
            let slope = cells.iter().map(|[more, due]| more * due).sum::<f64>() / due;
            let noise = |[more, due]: &[f64; 2]| (due * (more - slope * due)).powi(2);
            let error = cells.iter().map(noise).sum::<f64>().sqrt() / due;
            let t = if slope > 0.0 { slope / error } else { 0.0 };
            (all.len() as f64 * (-log_odds(t, cells.len())).exp()).min(1.0)
        };
        all.iter().map(|(lag, errors)| (*lag, odds(errors))).collect()
    }

    /// Errors of the detections of a view with another clock, mm, less those that last. Of two
    /// cameras, both place the joints.
    fn passing(&self, rig: &[Placed], view: usize, clock: f64, points: &[Vector3<f64>]) -> Errors {
        let mut cameras = rig.to_vec();
        cameras[view].clock = clock;
        let pair = (rig.len() == 2).then(|| self.scene.points(self.frames, &cameras, &[true; 2]));
        let (n, camera) = (self.scene.n_joints(), &cameras[view]);
        let error = |(k, x): (usize, &Vector3<f64>)| {
            let sight = self.scene.sight(self.frames[k / n], view, k % n, camera, false)?;
            let residual = camera.residual(x, &sight).filter(|_| x.x.is_finite())?;
            Some(residual.value * residual.pixel)
        };
        let points = pair.as_deref().unwrap_or(points);
        let mut errors: Errors = points.iter().enumerate().map(error).collect();
        for j in 0..n {
            let of_joint = || errors.iter().skip(j).step_by(n).flatten();
            let lasting = [0, 1].map(|axis| median(of_joint().map(|e| e[axis])));
            let lasting = Vector2::from(lasting);
            errors.iter_mut().skip(j).step_by(n).flatten().for_each(|e| *e -= lasting);
        }
        errors
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

//! Clocks of cameras: which are off, by how much, and whether they still are once other faults are
//! corrected.
//!
//! Motion tells clocks, so they are judged against errors of detections that last, with places as
//! they are.

use nalgebra::{Vector2, Vector3};

use super::bias::LastingErrors;
use super::bundle::{Bundle, CHUNK, PER_NOISE, unknowns};
use super::evidence::{excess, log_odds, turning_point, wald};
use super::placed::{Change, Freedom, Placed};
use super::search::{CONFIRMED_WALD, Explanation, FAULT_WALD, LEAST, Scope};
use crate::statistics::{STRONG, median, variance_of};

/// Most frames by which clocks may differ.
const MOST_OFFSET: isize = 30;
/// They differ by at most this part of the recording.
const PART: usize = 3;
/// The least recording that tells clocks, frames.
const LEAST_FRAMES: usize = 12;
/// Frames by which a clock's error bar tells lags apart.
const NEXT: f64 = 2.0;

/// Errors of the detections of one view, (frames, N); `None` where there is none.
type Errors = Vec<Option<Vector2<f64>>>;

/// The clocks that a camera may have, by what its detections say.
#[derive(Debug, Clone)]
pub struct Lags {
    /// The one that fits best.
    pub best: f64,
    /// Each with the logarithm of the odds of the best one against it.
    all: Vec<(f64, f64)>,
}

impl Lags {
    /// Each clock with its odds against the best one, corrected for the number of clocks: at most
    /// 1, which means tied.
    fn odds(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        let count = self.all.len() as f64;
        self.all.iter().map(move |(clock, odds)| (*clock, (count * (-odds).exp()).min(1.0)))
    }

    /// Of the clocks that are tied the one nearest to the `given` one; `now` if it is next to it.
    pub fn nearest(&self, now: f64, given: f64) -> f64 {
        let off = |clock: &f64| (clock - given).abs();
        let tied = self.odds().filter(|(_, odds)| *odds >= 1.0).map(|(clock, _)| clock);
        let nearest = tied.min_by(|a, b| off(a).total_cmp(&off(b)));
        nearest.filter(|clock| (clock - now).abs() > NEXT).unwrap_or(now)
    }

    /// How many there are.
    pub(super) fn count(&self) -> usize {
        self.all.len()
    }

    /// The logarithm of the odds against one clock for these detections and others; `None` where
    /// they have none in common.
    pub(super) fn one_for_both(&self, others: &Self) -> Option<f64> {
        let other = |clock: f64| others.all.iter().find(|(other, _)| *other == clock);
        let both = |(clock, odds): &(f64, f64)| Some(odds + other(*clock)?.1);
        self.all.iter().filter_map(both).min_by(f64::total_cmp)
    }

    /// How far the camera's clock may be from `clock`: the root mean square by the odds. The next
    /// two frames either way are left to its error bar.
    pub fn range(&self, clock: f64) -> f64 {
        let far = self.odds().map(|(other, odds)| ((other - clock).abs(), odds));
        let far: f64 = far.filter(|(d, _)| *d > NEXT).map(|(d, odds)| odds * d * d).sum();
        let all: f64 = self.odds().map(|(_, odds)| odds).sum();
        (far / all.max(1.0)).sqrt()
    }
}

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
        let (now, mut given) = (&rig.cameras, rig.cameras.clone());
        given[view].clock = self.given[view].clock;
        let lag = (now[view].clock - given[view].clock).abs();
        let [before, after] = self.moving([&given, now]);
        log_odds(excess(&before, &after), before.len()) - (STRONG * (2.0 * lag.ceil() + 1.0)).ln()
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
        wald(&rig.judged, &unknowns(&rig.freedom), view, Freedom::CLOCK, &change, 0.0)
    }

    /// The most frames by which a clock may be off.
    pub fn most_offset(&self) -> isize {
        let n = self.scene.n_frames();
        if n < LEAST_FRAMES { 0 } else { MOST_OFFSET.min((n / PART) as isize) }
    }

    /// What the detections of a view say of its clock, of that of `rig` and those a whole number of
    /// frames from there, with joints at `points` or where the others place them.
    ///
    /// An error e of the view, less what lasts, costs ρ(e) = 1 − exp(−|e|²/4σ²) where the others
    /// place the joint. If the best clock is right, another with e' costs D more in a cell, a joint
    /// in a part of the recording, in proportion to d = Σ ρ(e' − e): T is the slope of D over d
    /// by the error that allows cells their own noise (White 1980).
    pub fn lags(&self, rig: &[Placed], view: usize, points: Option<&[Vector3<f64>]>) -> Lags {
        let own = points.is_none().then(|| self.scene.points(self.frames, rig, |i| i != view));
        let points = points.or(own.as_deref()).unwrap_or_default();
        let (most, now) = (self.most_offset(), rig[view].clock);
        let errors = |clock: f64| (clock, self.passing(rig, view, clock, points, own.is_some()));
        let mut all: Vec<(f64, Errors)> =
            (-most..=most).map(|lag| errors(now + lag as f64)).collect();
        let known = |errors: &Errors| errors.iter().flatten().count();
        let enough = LEAST.max(all.iter().map(|(_, errors)| known(errors)).max().unwrap_or(0) / 2);
        all.retain(|(_, errors)| known(errors) >= enough);
        let kernel = kernel(all.iter().map(|(_, errors)| errors));
        let cost = |e: &Vector2<f64>| 1.0 - (-(e / kernel).norm_squared()).exp();
        let mean =
            |errors: &Errors| errors.iter().flatten().map(cost).sum::<f64>() / known(errors) as f64;
        let rated = all.iter().map(|(clock, errors)| (mean(errors), *clock, errors));
        let Some((_, best, least)) = rated.min_by(|a, b| a.0.total_cmp(&b.0)) else {
            return Lags { best: now, all: Vec::new() };
        };
        let n = self.scene.n_joints();
        let against = |errors: &Errors| {
            let mut cells = vec![[0.0; 2]; n * self.frames.len().div_ceil(CHUNK)];
            for (k, (own, other)) in errors.iter().zip(least).enumerate() {
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
            if slope > 0.0 { log_odds(slope / error, cells.len()) } else { 0.0 }
        };
        let all = all.iter().map(|(clock, errors)| (*clock, against(errors))).collect();
        Lags { best, all }
    }

    /// The place among the frames from which on the second of two clocks of a view explains its
    /// detections better.
    pub(super) fn crossing(&self, rig: &[Placed], view: usize, clocks: [f64; 2]) -> usize {
        let points = self.scene.points(self.frames, rig, |i| i != view);
        let [first, second] = clocks.map(|clock| self.passing(rig, view, clock, &points, true));
        let kernel = kernel([&first, &second]);
        let cost = |e: &Vector2<f64>| 1.0 - (-(e / kernel).norm_squared()).exp();
        let more = |(first, second): (&Option<_>, &Option<_>)| {
            first.as_ref().zip(second.as_ref()).map_or(0.0, |(a, b)| cost(a) - cost(b))
        };
        let n = self.scene.n_joints();
        let frames = first.chunks(n).zip(second.chunks(n));
        turning_point(frames.map(|(first, second)| first.iter().zip(second).map(more).sum()))
    }

    /// Errors of the detections of a view with another clock, mm, less those that last, which
    /// two cameras place `again`.
    fn passing(
        &self,
        rig: &[Placed],
        view: usize,
        clock: f64,
        points: &[Vector3<f64>],
        again: bool,
    ) -> Errors {
        let mut cameras = rig.to_vec();
        cameras[view].clock = clock;
        let pair = again && rig.len() == 2;
        let pair = pair.then(|| self.scene.points(self.frames, &cameras, |_| true));
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
    /// last, in two rigs and the frames that both have.
    fn moving(&self, rigs: [&[Placed]; 2]) -> [Vec<f64>; 2] {
        let (last, sigma) = (self.scene.n_frames() as f64 - 1.0, self.sigma(rigs[1]));
        let inside =
            |t: usize, camera: &Placed| (0.0..=last).contains(&(t as f64 + camera.clock.round()));
        let there = |t: &usize| rigs.iter().all(|rig| rig.iter().all(|camera| inside(*t, camera)));
        let frames: Vec<usize> = self.frames.iter().copied().filter(there).collect();
        let scope = Scope { frames: &frames, ..*self };
        rigs.map(|cameras| {
            let points = scope.scene.points(&frames, cameras, |_| true);
            let still = vec![Freedom::default(); cameras.len()];
            let mut bundle = scope.timing(scope.bundle(cameras.to_vec(), still, points));
            bundle.solve(sigma, sigma);
            bundle.costs(sigma)
        })
    }
}

/// Width of the kernel of errors with several clocks: that of the least.
fn kernel<'a>(all: impl IntoIterator<Item = &'a Errors>) -> f64 {
    let size = |errors: &Errors| median(errors.iter().flatten().map(Vector2::norm));
    let least = all.into_iter().map(size).fold(f64::INFINITY, f64::min);
    2.0 * PER_NOISE * variance_of(least * least).sqrt().max(f64::MIN_POSITIVE)
}

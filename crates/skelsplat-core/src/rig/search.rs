//! Which cameras are wrong: one fault after the other is supposed, and the one that explains most
//! is kept.
//!
//! A calibration is either right or wrong, so the prior of a camera is a spike at its calibration
//! and a wide normal: a camera stays exactly where it is unless it is shown to be elsewhere. Each
//! supposition is solved on its own: the other cameras place the joints, the camera is placed by
//! them, then everything is adjusted together. A fault counts where the change is several times its
//! error bar; it is told from another where the joints agree that it explains more. Clocks come
//! first, because motion shows them even while places are wrong.

use nalgebra::Vector3;

use super::bundle::{Bundle, PER_NOISE, unknowns};
use super::evidence::{Bars, bars, is_worse, odds_changed, shared_turn, total, wald};
use super::placed::{CLOCK, Change, Freedom, Placed, reach};
use super::prior::Lenses;
use super::reduced::Judged;
use super::scene::Scene;
use crate::batch::Progress;
use crate::error::Result;
use crate::statistics::{median, variance_of};

/// Fewer detections do not place a camera.
pub(super) const LEAST: usize = 20;
/// Least noise, pixels.
const LEAST_PX: f64 = 0.05;
/// A clock is off, and a place in doubt, from this Wald statistic on.
pub(super) const FAULT_WALD: f64 = 3.5;
/// A change that was found is confirmed from this Wald statistic on where more is known.
pub const CONFIRMED_WALD: f64 = 2.0;
/// A place is in doubt that explains this part of the mean cost of a view, as joints agree, but not
/// by the odds: people contradict each other.
const DOUBTFUL_GAIN: f64 = 0.2;
/// What a search may suppose.
#[derive(Debug, Clone, Copy)]
pub struct Scope<'a> {
    /// The detections.
    pub scene: Scene<'a>,
    /// Frames that are looked at.
    pub frames: &'a [usize],
    /// Those and others, on which clocks compare.
    pub all: &'a [usize],
    /// Cameras as given.
    pub given: &'a [Placed],
    /// Whether focal lengths may be wrong.
    pub focal: bool,
    /// Whether clocks may be wrong.
    pub clock: bool,
    /// What is known of focal lengths.
    pub lenses: &'a Lenses,
}

/// What a camera is supposed to have done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// It was turned.
    Turn,
    /// It was zoomed.
    Zoom,
    /// It was turned and moved, or zoomed.
    Place,
    /// Its frames are counted differently.
    Clock,
}

/// A rig that explains the detections.
#[derive(Debug, Clone)]
pub struct Explanation {
    /// Cameras.
    pub cameras: Vec<Placed>,
    /// What of each was free.
    pub freedom: Vec<Freedom>,
    /// What it costs, and how sure it is of what was free.
    pub judged: Judged,
}

/// A fault of one camera on top of what is known.
#[derive(Debug, Clone)]
pub struct Supposed {
    /// The camera.
    pub view: usize,
    /// The fault.
    pub fault: Fault,
    /// The rig with it corrected.
    pub rig: Explanation,
    /// Error bars of the camera.
    pub bars: Bars,
    /// The logarithm of the odds that its place changed: see [`odds_changed`].
    pub odds: f64,
    /// The turn that all detections of its view share, rad.
    pub shared: f64,
}

/// What a search found.
#[derive(Debug, Clone)]
pub struct SearchResult {
    /// The rig with every fault corrected that could be told.
    pub rig: Explanation,
    /// Faults of which one is there that could not be told from each other; empty where there is no
    /// doubt.
    pub rivals: Vec<Supposed>,
    /// The same of faults that are there besides those corrected, where no more may be.
    pub besides: Vec<Supposed>,
    /// Error bars of cameras that are sound.
    pub bars: Vec<Bars>,
}

/// The rigs before each correction, and the correction, first among what explained as much.
type Rounds = Vec<(Explanation, Vec<Supposed>)>;

impl Supposed {
    fn is_clock(&self) -> bool {
        self.fault == Fault::Clock
    }
}

impl Explanation {
    /// Cameras of which nothing is known yet.
    pub fn start(cameras: Vec<Placed>, freedom: Vec<Freedom>) -> Self {
        Self { cameras, freedom, judged: Judged::unknown(Vec::new(), 0) }
    }
}

impl Scope<'_> {
    /// Corrects at most as many cameras as leave a majority that is sound.
    /// Errors: [`crate::Error::Cancelled`].
    pub fn search(&self, progress: &Progress) -> Result<SearchResult> {
        let m = self.given.len();
        let start = Explanation::start(self.given.to_vec(), vec![Freedom::default(); m]);
        let bars = vec![Bars::UNKNOWN; m];
        let mut found = SearchResult { rig: start, rivals: Vec::new(), besides: Vec::new(), bars };
        let mut rounds = self.rounds(&mut found.rig, progress)?;
        found.rig = self.with_sure_clocks(found.rig);
        rounds.retain(|(_, best)| covers(found.rig.freedom[best[0].view], best[0].fault));
        // What was corrected later is a fault of its own.
        let (corrected, sigma) = (found.rig.freedom.clone(), self.sigma(&found.rig.cameras));
        for (_, best) in &mut rounds {
            let first = best[0].clone();
            let told = |supposed: &Supposed| {
                covers(corrected[supposed.view], supposed.fault)
                    || first.is_clock()
                        && self.clock_stays_off(&found.rig, first.view, supposed.view, sigma)
            };
            best.retain(|supposed| supposed.view == first.view || !told(supposed));
        }
        if let Some(k) = rounds.iter().position(|(_, best)| best.len() > 1) {
            (found.rig, found.rivals) = rounds.swap_remove(k);
        }
        (found.bars, found.besides) = self.left(&found.rig, progress)?;
        Ok(found)
    }

    /// Corrects one fault after the other.
    fn rounds(&self, rig: &mut Explanation, progress: &Progress) -> Result<Rounds> {
        let mut rounds = Vec::new();
        loop {
            let sigma = self.sigma(&rig.cameras);
            *rig = self.explain(rig.cameras.clone(), rig.freedom.clone(), sigma, 1.0);
            let best = self.best(rig, sigma, progress)?;
            let Some(first) = best.first() else { return Ok(rounds) };
            rounds.push((std::mem::replace(rig, first.rig.clone()), best));
        }
    }

    /// The fault that explains most, and those of other cameras that explain as much: of clocks, or
    /// else of places, since motion tells clocks also while places are wrong.
    fn best(&self, rig: &Explanation, sigma: f64, progress: &Progress) -> Result<Vec<Supposed>> {
        let (clocks, places): (Vec<_>, Vec<_>) =
            self.candidates(rig).into_iter().partition(|(_, fault)| *fault == Fault::Clock);
        for candidates in [clocks, places] {
            let mut faults = Vec::new();
            for (view, fault) in candidates {
                progress.check()?;
                faults.extend(self.suppose(rig, view, fault, sigma));
            }
            faults.retain(|supposed| self.is_fault(supposed));
            if !faults.is_empty() {
                return Ok(self.told_apart(faults, sigma));
            }
        }
        Ok(Vec::new())
    }

    /// How far off each uncorrected camera may be if the others are right. Also the place that is
    /// in doubt, or still wrong where no more places may be corrected, with its rivals.
    fn left(&self, rig: &Explanation, progress: &Progress) -> Result<(Vec<Bars>, Vec<Supposed>)> {
        let m = rig.cameras.len();
        let full = !self.may_place(rig);
        let sigma = self.sigma(&rig.cameras);
        let still = self.explain(rig.cameras.clone(), vec![Freedom::default(); m], sigma, 1.0);
        let (mut bars, mut more) = (vec![Bars::UNKNOWN; m], Vec::new());
        for (view, fault) in self.candidates(&still) {
            progress.check()?;
            let needed = full || matches!(fault, Fault::Place | Fault::Clock);
            if rig.freedom[view].any() || !needed {
                continue;
            }
            let Some(supposed) = self.suppose(&still, view, fault, sigma) else { continue };
            let change = Change::between(&self.given[view], &supposed.rig.cameras[view]);
            let mut known = supposed.bars.besides(&change);
            if fault == Fault::Clock {
                let lags = self.lags(&supposed.rig.cameras, view, None);
                known.clock = known.clock.max(lags.range(self.given[view].clock));
            }
            learn(&mut bars[view], fault, &known);
            let is_place = !supposed.is_clock();
            if is_place
                && (self.explains_much(&still, &supposed) || full && self.is_fault(&supposed))
            {
                more.push(supposed);
            }
        }
        Ok((bars, self.told_apart(more, sigma)))
    }

    /// The strongest fault, and those of other cameras that explain as much.
    fn told_apart(&self, faults: Vec<Supposed>, sigma: f64) -> Vec<Supposed> {
        let Some(best) = strongest(&faults).cloned() else { return faults };
        let is_rival = |supposed: &Supposed| {
            best.view != supposed.view && !self.explains_less(supposed, &best, sigma)
        };
        let rivals: Vec<Supposed> = faults.into_iter().filter(is_rival).collect();
        std::iter::once(best).chain(rivals).collect()
    }

    /// Whether joints agree that one fault explains less than another: clocks without the errors
    /// that last, or in all frames with both free.
    fn explains_less(&self, supposed: &Supposed, other: &Supposed, sigma: f64) -> bool {
        let (own, others) = (&supposed.rig.judged, &other.rig.judged);
        if !supposed.is_clock() {
            return is_worse(&own.costs, &others.costs);
        }
        let scope = Scope { frames: self.all, ..*self };
        is_worse(&own.moving, &others.moving)
            || scope.clock_stays_off(&other.rig, other.view, supposed.view, sigma)
    }

    /// Whether the place of another camera may be corrected: a majority stays.
    fn may_place(&self, rig: &Explanation) -> bool {
        let corrected = rig.freedom.iter().filter(|freedom| freedom.turn || freedom.focal).count();
        2 * (corrected + 1) < rig.freedom.len()
    }

    /// Faults that may be supposed next.
    fn candidates(&self, rig: &Explanation) -> Vec<(usize, Fault)> {
        let m = self.given.len();
        let place = self.may_place(rig);
        let clock = rig.freedom.iter().filter(|freedom| freedom.clock).count() + 1 < m;
        let mut out = Vec::new();
        for (i, freedom) in rig.freedom.iter().enumerate() {
            if m > 2 && (place || freedom.focal) && !freedom.turn {
                out.extend([(i, Fault::Turn), (i, Fault::Place)]);
                out.extend(self.focal.then_some((i, Fault::Zoom)));
            }
            // Of two clocks, only the difference can be told.
            if (clock || m == 2 && i == 1) && !freedom.clock && self.most_offset() > 0 {
                out.push((i, Fault::Clock));
            }
        }
        out
    }

    /// Width of the kernel for these cameras, mm.
    pub fn sigma(&self, cameras: &[Placed]) -> f64 {
        let points = self.scene.points(self.frames, cameras, |_| true);
        let all = cameras.iter().enumerate();
        let sights: Vec<(f64, f64)> = all
            .flat_map(|(i, camera)| self.scene.distances(self.frames, &points, i, camera))
            .collect();
        let noise = variance_of(median(sights.iter().map(|(px, mm)| px * mm)).powi(2)).sqrt();
        let least = LEAST_PX * median(sights.iter().map(|(_, mm)| *mm));
        PER_NOISE * if noise > least { noise } else { least.max(f64::MIN_POSITIVE) }
    }

    /// Adjusts what is free, from kernels `wider` than the final ones.
    pub fn explain(
        &self,
        cameras: Vec<Placed>,
        freedom: Vec<Freedom>,
        sigma: f64,
        wider: f64,
    ) -> Explanation {
        let points = self.scene.points(self.frames, &cameras, |_| true);
        let mut bundle = self.bundle(cameras, freedom.clone(), points);
        bundle.solve(wider * sigma, sigma);
        if !freedom.iter().any(|freedom| freedom.clock) {
            let judged = bundle.judge(sigma);
            return Explanation { cameras: bundle.cameras, freedom, judged };
        }
        let mut clocks = self.timing(bundle.clone());
        clocks.solve(sigma, sigma);
        bundle.freedom.iter_mut().for_each(|freedom| freedom.clock = false);
        bundle.cameras = clocks.cameras.clone();
        bundle.solve(sigma, sigma);
        let is_clock: Vec<bool> = unknowns(&freedom).iter().map(|(_, k)| *k == CLOCK).collect();
        let judged = bundle.judge(sigma).timed(clocks.judge(sigma), &is_clock);
        Explanation { cameras: bundle.cameras, freedom, judged }
    }

    /// The cameras with joints.
    pub fn bundle(
        &self,
        cameras: Vec<Placed>,
        freedom: Vec<Freedom>,
        points: Vec<Vector3<f64>>,
    ) -> Bundle<'_> {
        let Self { scene, frames, given, lenses, .. } = *self;
        let (fixed, offsets) = (false, None);
        Bundle { scene, frames, given, cameras, freedom, lenses, points, fixed, offsets }
    }

    /// The rig in which one more fault is corrected; `None` if the camera sees too little to say.
    pub fn suppose(
        &self,
        rig: &Explanation,
        view: usize,
        fault: Fault,
        sigma: f64,
    ) -> Option<Supposed> {
        let m = rig.cameras.len();
        let points = self.scene.points(self.frames, &rig.cameras, |i| i != view || m == 2);
        let kind = match fault {
            Fault::Turn => Freedom { shift: false, ..Freedom::PLACE },
            Fault::Zoom => Freedom { focal: true, ..Freedom::default() },
            Fault::Place => Freedom { focal: self.focal, ..Freedom::PLACE },
            Fault::Clock => Freedom::CLOCK,
        };
        let camera = self.placed(rig, view, kind, &points, sigma)?;
        let (mut cameras, mut freedom) = (rig.cameras.clone(), rig.freedom.clone());
        cameras[view] = camera;
        freedom[view] = both(freedom[view], kind);
        let explained = self.explain(cameras, freedom, sigma, 2.0);
        let frames = |rig: &Explanation| rig.cameras[view].clock.round();
        // Parts of a frame may not be asked for.
        if fault == Fault::Clock && !self.clock && frames(&explained) == frames(rig) {
            return None;
        }
        let unknowns = unknowns(&explained.freedom);
        let reach = reach(&points, self.given)[view];
        let shared = shared_turn(sigma / PER_NOISE, reach, m);
        let bars = bars(&explained.judged.steady, &unknowns, view).sharing(shared);
        let prior_sigma = |k| self.lenses.sigma_of(k, reach);
        let judged = [&rig.judged, &explained.judged];
        let change = Change::between(&rig.cameras[view], &explained.cameras[view]);
        let odds = odds_changed(judged, &unknowns, view, kind, &change, shared, prior_sigma);
        Some(Supposed { view, fault, rig: explained, bars, odds, shared })
    }

    /// By how much each camera seems to be turned as its detections share an error.
    pub fn shared_turns(&self, cameras: &[Placed]) -> Vec<f64> {
        let noise = self.sigma(cameras) / PER_NOISE;
        let points = self.scene.points(self.frames, cameras, |_| true);
        let turn = |reach: f64| shared_turn(noise, reach, cameras.len());
        reach(&points, self.given).into_iter().map(turn).collect()
    }

    /// One camera placed by joints that the others place.
    pub fn placed(
        &self,
        rig: &Explanation,
        view: usize,
        kind: Freedom,
        points: &[Vector3<f64>],
        sigma: f64,
    ) -> Option<Placed> {
        let mut camera = rig.cameras[view].clone();
        if kind.clock {
            let best = self.lags(&rig.cameras, view, Some(points)).best;
            // Parts of a frame may not be asked for.
            camera.clock = Some(best).filter(|best| self.clock || *best != camera.clock)?;
        }
        let off = self.scene.distances(self.frames, points, view, &camera);
        if off.len() < LEAST {
            return None;
        }
        let start = median(off.iter().map(|(px, mm)| px * mm));
        let mut cameras = rig.cameras.clone();
        cameras[view] = camera;
        let mut freedom = vec![Freedom::default(); cameras.len()];
        freedom[view] = kind;
        let mut bundle = self.bundle(cameras, freedom, points.to_vec());
        bundle.fixed = true;
        bundle.solve(start, sigma);
        Some(bundle.cameras.swap_remove(view))
    }

    /// Whether a change of a place explains much of what a camera costs, and joints agree on it.
    fn explains_much(&self, rig: &Explanation, supposed: &Supposed) -> bool {
        let Supposed { view, rig: changed, shared, .. } = supposed;
        let [before, after] = [rig, changed].map(|rig| total(&rig.judged.costs));
        let change = Change::between(&rig.cameras[*view], &changed.cameras[*view]);
        let (free, of) = (unknowns(&changed.freedom), changed.freedom[*view]);
        self.given.len() as f64 * (before - after) > DOUBTFUL_GAIN * before
            && wald(&changed.judged, &free, *view, of, &change, *shared) > FAULT_WALD
    }

    /// Whether a change is more than chance; of clocks, chance is judged when all are known.
    fn is_fault(&self, supposed: &Supposed) -> bool {
        match supposed.is_clock() {
            true => {
                self.clock_wald(&supposed.rig, supposed.view) > FAULT_WALD
                    && self.is_within(&supposed.rig, supposed.view)
            }
            false => supposed.odds > 0.0,
        }
    }
}

/// The fault that explains most, of clocks or of places.
fn strongest(faults: &[Supposed]) -> Option<&Supposed> {
    let cost = |supposed: &Supposed| {
        let judged = &supposed.rig.judged;
        total(if supposed.is_clock() { &judged.moving } else { &judged.costs })
    };
    faults.iter().min_by(|a, b| cost(a).total_cmp(&cost(b)))
}

/// Takes what a supposed fault says of how far off its camera may be, of the place from the one
/// with all of it free.
fn learn(bars: &mut Bars, fault: Fault, supposed: &Bars) {
    match fault {
        Fault::Place => *bars = Bars { clock: bars.clock, ..*supposed },
        Fault::Clock => bars.clock = supposed.clock,
        Fault::Turn | Fault::Zoom => {}
    }
}

/// What either leaves free.
pub fn both(a: Freedom, b: Freedom) -> Freedom {
    Freedom {
        turn: a.turn || b.turn,
        shift: a.shift || b.shift,
        focal: a.focal || b.focal,
        clock: a.clock || b.clock,
        radial: a.radial || b.radial,
    }
}

/// Whether a fault is among those that were corrected.
fn covers(corrected: Freedom, fault: Fault) -> bool {
    if fault == Fault::Clock { corrected.clock } else { corrected.turn || corrected.focal }
}

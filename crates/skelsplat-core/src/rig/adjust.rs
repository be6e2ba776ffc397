//! The cameras of a recording set right.

mod changes;

use nalgebra::Vector3;

use super::bundle::unknowns;
use super::calibrate::{Filmed, check_filmed};
use super::evidence::{ALIKE, Bars, bars, is_worse, total, wald};
use super::placed::{Change, Freedom, Placed, rebuilt};
use super::prior::CALIBRATED;
use super::reduced::Reduced;
use super::report::{CameraAdjustment, CameraStatus, Changes, RigAdjustment};
use super::scene::{JointMotion, Scene, spread};
use super::search::{CONFIRMED_WALD, Explanation, Fault, Scope, SearchResult, Supposed, both};
use crate::batch::Progress;
use crate::camera::{Camera, Distortion};
use crate::detections::Detections;
use crate::error::{Error, Result};
use crate::refine::RefineConfig;
use crate::statistics::median;
use crate::threads;
use crate::unit::Unit;

/// Most frames on which cameras are adjusted.
const FITTED: usize = 1000;
/// Most frames on which faults are searched.
const SEARCHED: usize = 120;
/// Most frames on which the result is judged.
const JUDGED: usize = 200;
/// Most parts into which a recording is divided.
const PARTS: usize = 50;
/// Of so many parts one is left out.
const EVERY: usize = 5;
/// Which of them.
const LEFT_OUT: usize = 2;
/// Fewer frames are all used.
const LEAST_DIVIDED: usize = 10;
/// A change also explains its camera where the distance of its detections in frames that were left
/// out is at most this part of the one before.
const NEARER: f64 = 0.85;
/// Part of the image's diagonal that poor detections are off.
const POOR: f64 = 0.012;
/// Solutions with kernels that follow the noise.
const ROUNDS: usize = 2;

/// What may be adjusted.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Adjustable {
    /// Views whose cameras are wrong; `None`: found out.
    pub free: Option<Vec<usize>>,
    /// Also focal lengths.
    pub focal: bool,
    /// Also clocks.
    pub clock: bool,
}

/// Finds cameras that are wrong, and sets them right.
///
/// # Errors
/// [`Error::InvalidInput`] if the numbers of views do not match, a view of `free` does not exist or
/// all are free, [`Error::Cancelled`].
pub fn adjust_cameras(
    cameras: &[Camera],
    unit: Unit,
    filmed: Filmed<'_>,
    what: &Adjustable,
    config: &RefineConfig,
    progress: &Progress,
) -> Result<RigAdjustment> {
    let Filmed { frames, times } = filmed;
    check(cameras, filmed, what)?;
    threads::install(config.n_threads, |_| {
        let used: Vec<Detections> =
            frames.iter().map(|frame| frame.above(config.min_confidence)).collect();
        let mm = |camera: &Camera| {
            let camera = camera.clone().with_length_scale(unit.millimetres());
            let ideal = !config.undistort;
            let camera = if ideal { camera.with_distortion(Distortion::None) } else { camera };
            Placed { camera, clock: 0.0 }
        };
        let given: Vec<Placed> = cameras.iter().map(mm).collect();
        let (fitted, judged) = divided(frames.len());
        let plain = Scene::new(&used);
        let looked: Vec<usize> = fitted.iter().chain(&judged).copied().collect();
        let motion = JointMotion::of(plain, &looked, &given);
        let (scene, filmed) = (plain.moving(&motion), Filmed { frames: &used, times });
        let task = Task { scene, filmed, given: &given, what, fitted, judged };
        let (mut found, bars) = task.solve(progress)?;
        let changes = match task.unsteady(&found) {
            None => task.knocked(&found, progress)?,
            clock => clock,
        };
        changes.iter().for_each(|Changes { view, .. }| task.put_back(&mut found, *view));
        task.report(&found, &bars, changes.as_ref(), cameras, unit)
    })
}

fn check(
    cameras: &[Camera],
    Filmed { frames, times }: Filmed<'_>,
    what: &Adjustable,
) -> Result<()> {
    let m = cameras.len();
    if m < 2 {
        return Err(Error::invalid("cameras", "at least two cameras", m.to_string()));
    }
    if frames.is_empty() {
        return Err(Error::invalid("detections", "at least one frame", "none"));
    }
    check_filmed(frames, times, m)?;
    let Some(free) = &what.free else { return Ok(()) };
    if let Some(i) = free.iter().find(|i| **i >= m) {
        return Err(Error::invalid("free", format!("cameras 0 to {}", m - 1), i.to_string()));
    }
    match (0..m).filter(|i| !free.contains(i)).count() {
        0 => Err(Error::invalid("free", "at least one camera that stays", "all cameras")),
        _ => Ok(()),
    }
}

struct Task<'a> {
    scene: Scene<'a>,
    filmed: Filmed<'a>,
    given: &'a [Placed],
    what: &'a Adjustable,
    fitted: Vec<usize>,
    judged: Vec<usize>,
}

impl Task<'_> {
    fn scope<'a>(&'a self, frames: &'a [usize]) -> Scope<'a> {
        let Adjustable { focal, clock, .. } = *self.what;
        let (scene, all, given, lenses) =
            (self.scene, self.fitted.as_slice(), self.given, &CALIBRATED);
        Scope { scene, frames, all, given, focal, clock, lenses }
    }

    /// The cameras, and the error bars of each.
    fn solve(&self, progress: &Progress) -> Result<(SearchResult, Vec<Bars>)> {
        let some = spread(&self.fitted, SEARCHED);
        let scope = self.scope(&some);
        let mut found = match &self.what.free {
            None => scope.search(progress)?,
            Some(free) => self.free(&scope, free),
        };
        let mut bars = found.bars.clone();
        if !found.rig.freedom.iter().any(|freedom| freedom.any()) {
            found.rivals.append(&mut found.besides);
            return Ok((found, bars));
        }
        progress.check()?;
        let searched = found.rig.freedom.clone();
        let all = self.scope(&self.fitted);
        found.rig = self.whole(&all, found.rig, &mut bars)?;
        let late = found.rig.clone();
        if self.what.free.is_none() {
            found.rig = all.with_sure_clocks(found.rig);
        }
        for (i, bars) in bars.iter_mut().enumerate().filter(|(i, _)| late.freedom[*i].clock) {
            let camera = &mut found.rig.cameras[i];
            let bar = bars.clock.hypot(late.cameras[i].clock - camera.clock);
            let lags = all.lags(&late.cameras, i, None);
            if found.rig.freedom[i].clock {
                camera.clock = lags.nearest(camera.clock, self.given[i].clock);
            }
            bars.clock = bar.max(lags.range(camera.clock));
        }
        if self.what.free.is_none() && !self.holds(&found.rig) {
            self.doubt(&mut found, &searched, &bars);
            return Ok((found, bars));
        }
        if found.rivals.is_empty() {
            found.rivals = std::mem::take(&mut found.besides);
        }
        if self.what.free.is_none() {
            let unsure = self.unsure_clocks(&found.rig, &bars);
            self.doubt(&mut found, &unsure, &bars);
        }
        Ok((found, bars))
    }

    /// Whether every change is confirmed on all frames, and its camera fits frames that were left
    /// out about as the others do, or clearly better than before. Where cameras change places, they
    /// and all together fit those frames better.
    fn holds(&self, rig: &Explanation) -> bool {
        let (before, after) = (self.left_out(self.given), self.left_out(&rig.cameras));
        let free = unknowns(&rig.freedom);
        let shared = self.scope(&self.fitted).shared_turns(&rig.cameras);
        let holds = |(i, freedom): (usize, &Freedom)| {
            let change = Change::between(&self.given[i], &rig.cameras[i]);
            let sure = wald(&rig.judged, &free, i, *freedom, &change, shared[i]);
            let others = (0..after.len()).filter(|k| *k != i).map(|k| after[k]);
            let size = self.given[i].camera.size().map(f64::from);
            let poor = POOR * size[0].hypot(size[1]);
            let unexplained =
                after[i] > ALIKE * median(others) && after[i] > (NEARER * before[i]).min(poor);
            let worse = (freedom.turn || freedom.shift || freedom.focal)
                && (after[i] > before[i] || total(&after) > total(&before));
            sure > CONFIRMED_WALD && !unexplained && !worse
        };
        rig.freedom.iter().enumerate().filter(|(_, freedom)| freedom.any()).all(holds)
    }

    /// What was free of each camera with a clock that may be right after all: where a movement
    /// repeats itself, clocks a period apart fit alike.
    fn unsure_clocks(&self, rig: &Explanation, bars: &[Bars]) -> Vec<Freedom> {
        let unsure = |(i, freedom): (usize, &Freedom)| {
            let off = (rig.cameras[i].clock - self.given[i].clock).abs();
            let is_unsure = freedom.clock && off <= CONFIRMED_WALD * bars[i].clock;
            if is_unsure { *freedom } else { Freedom::default() }
        };
        rig.freedom.iter().enumerate().map(unsure).collect()
    }

    /// Takes changes back: their cameras are doubtful.
    fn doubt(&self, found: &mut SearchResult, changes: &[Freedom], bars: &[Bars]) {
        let changed = found.rig.clone();
        for (view, freedom) in changes.iter().enumerate().filter(|(_, freedom)| freedom.any()) {
            let fault = if freedom.turn { Fault::Place } else { Fault::Clock };
            let (rig, own) = (changed.clone(), bars[view]);
            found.rivals.push(Supposed { view, fault, rig, bars: own, odds: 0.0, shared: 0.0 });
            found.rig.cameras[view] = self.given[view].clone();
            found.rig.freedom[view] = Freedom::default();
        }
    }

    /// The cameras that are known to be wrong, placed by the others one after the other.
    fn free(&self, scope: &Scope<'_>, free: &[usize]) -> SearchResult {
        let m = self.given.len();
        let Adjustable { focal, clock, .. } = *self.what;
        let mut rig = Explanation::start(self.given.to_vec(), vec![Freedom::default(); m]);
        let mut trusted: Vec<bool> = (0..m).map(|i| !free.contains(&i)).collect();
        for &i in free {
            let kind = Freedom { focal, clock, ..Freedom::PLACE };
            let few = trusted.iter().filter(|is_trusted| **is_trusted).count() < 2;
            let points = scope.scene.points(scope.frames, &rig.cameras, |k| few || trusted[k]);
            let sigma = scope.sigma(&rig.cameras);
            if let Some(camera) = scope.placed(&rig, i, kind, &points, sigma) {
                rig.cameras[i] = camera;
                rig.freedom[i] = kind;
                trusted[i] = true;
            }
        }
        let bars = vec![Bars::UNKNOWN; m];
        SearchResult { rig, rivals: Vec::new(), besides: Vec::new(), bars }
    }

    /// Adjusts on all frames. The error bars are those with every part of a change free, also where
    /// one of them is enough.
    fn whole(&self, scope: &Scope<'_>, rig: Explanation, all: &mut [Bars]) -> Result<Explanation> {
        let Adjustable { focal, clock, .. } = *self.what;
        let full = |freedom: &Freedom| match freedom.turn || freedom.focal {
            true => both(*freedom, Freedom { focal, clock, ..Freedom::PLACE }),
            false => *freedom,
        };
        let freedom: Vec<Freedom> = rig.freedom.iter().map(full).collect();
        let mut rig = self.settle(scope, rig.cameras, freedom.clone());
        let shared = scope.shared_turns(&rig.cameras);
        let free = unknowns(&freedom);
        for (i, _) in freedom.iter().enumerate().filter(|(_, freedom)| freedom.any()) {
            all[i] = bars(&rig.judged.steady, &free, i).sharing(shared[i]);
        }
        for i in 0..freedom.len() {
            rig = self.simplified(scope, rig, i)?;
        }
        Ok(rig)
    }

    /// Only the part of a camera's change that explains as much as all of it, and more than any
    /// other part alone; else all of it.
    fn simplified(&self, scope: &Scope<'_>, rig: Explanation, i: usize) -> Result<Explanation> {
        let parts: Vec<Freedom> = rig.freedom[i].parts().collect();
        if parts.len() < 2 {
            return Ok(rig);
        }
        let alone = |part: Freedom| -> Result<Explanation> {
            let (mut cameras, mut freedom) = (rig.cameras.clone(), rig.freedom.clone());
            cameras[i] = self.reset(i, &cameras[i], part)?;
            freedom[i] = part;
            Ok(self.settle(scope, cameras, freedom))
        };
        let mut single = parts.into_iter().map(alone).collect::<Result<Vec<_>>>()?;
        single.sort_by(|a, b| total(&a.judged.costs).total_cmp(&total(&b.judged.costs)));
        let best = single.swap_remove(0);
        let enough = !is_worse(&best.judged.costs, &rig.judged.costs)
            && single.iter().all(|other| is_worse(&other.judged.costs, &best.judged.costs));
        Ok(if enough { best } else { rig })
    }

    fn settle(
        &self,
        scope: &Scope<'_>,
        cameras: Vec<Placed>,
        freedom: Vec<Freedom>,
    ) -> Explanation {
        let mut rig = Explanation::start(cameras, freedom);
        for _ in 0..ROUNDS {
            let sigma = scope.sigma(&rig.cameras);
            rig = scope.explain(rig.cameras, rig.freedom, sigma, 1.0);
        }
        rig
    }

    /// The camera with what is not free as given.
    fn reset(&self, i: usize, now: &Placed, freedom: Freedom) -> Result<Placed> {
        let given = &self.given[i];
        let from = |free: bool| if free { now } else { given };
        let centre = from(freedom.shift).camera.centre();
        let zoom = from(freedom.focal).camera.focal()[0] / given.camera.focal()[0];
        let rotation = *from(freedom.turn).camera.rotation();
        let camera = rebuilt(&given.camera, &rotation, &centre, zoom)?;
        Ok(Placed { camera, clock: from(freedom.clock).clock })
    }

    fn report(
        &self,
        found: &SearchResult,
        bars: &[Bars],
        changes: Option<&Changes>,
        cameras: &[Camera],
        unit: Unit,
    ) -> Result<RigAdjustment> {
        let before = self.left_out(self.given);
        let after = self.left_out(&found.rig.cameras);
        let mm = unit.millimetres();
        let of_camera = |i: usize| {
            let (mut change, mut bars, mut status) = self.verdict(found, bars, i);
            let changes = changes.filter(|changes| changes.view == i);
            if let Some(changes) = changes {
                (change, status) = (changes.change, changes.status);
                bars = changes.bars.unwrap_or(bars);
            }
            CameraAdjustment {
                status,
                change: Change { shift: change.shift / mm, ..change },
                bars: Bars { shift: bars.shift / mm, place: bars.place / (mm * mm), ..bars },
                since: changes.map(|changes| changes.since),
                before: before[i],
                after: after[i],
            }
        };
        let report: Vec<CameraAdjustment> = (0..cameras.len()).map(of_camera).collect();
        let returned = |(i, camera): (usize, &Camera)| -> Result<Camera> {
            let new = &found.rig.cameras[i].camera;
            let freedom = found.rig.freedom[i];
            if !(freedom.turn || freedom.shift || freedom.focal) {
                return Ok(camera.clone());
            }
            let zoom = new.focal()[0] / self.given[i].camera.focal()[0];
            rebuilt(camera, new.rotation(), &(new.centre() / mm), zoom)
        };
        let cameras: Result<Vec<Camera>> = cameras.iter().enumerate().map(returned).collect();
        let frames = [self.fitted.len(), self.judged.len()];
        Ok(RigAdjustment { cameras: cameras?, report, frames })
    }

    fn verdict(
        &self,
        found: &SearchResult,
        bars: &[Bars],
        i: usize,
    ) -> (Change, Bars, CameraStatus) {
        let now = |rig: &Explanation| Change::between(&self.given[i], &rig.cameras[i]);
        if let Some(rival) = found.rivals.iter().find(|rival| rival.view == i) {
            return (now(&rival.rig), rival.bars, CameraStatus::Doubtful);
        }
        let change = now(&found.rig);
        let freedom = found.rig.freedom[i];
        let seeing = (0..self.given.len()).filter(|k| !self.is_unseen(*k)).count();
        let status = match freedom.any() {
            true if freedom == Freedom::CLOCK => CameraStatus::Late,
            true => CameraStatus::Adjusted,
            false if seeing < 3 || self.is_unseen(i) => CameraStatus::Unseen,
            false => CameraStatus::Sound,
        };
        (change, bars[i], status)
    }

    fn is_unseen(&self, i: usize) -> bool {
        let n = self.scene.n_joints();
        let seen = |t: &usize| {
            (0..n).filter(|j| self.scene.sight(*t, i, *j, &self.given[i], false).is_some()).count()
        };
        self.fitted.iter().map(seen).sum::<usize>() < 20
    }

    /// Median distance of each view's detections from where the others place the joints, px, in
    /// frames that were left out.
    fn left_out(&self, cameras: &[Placed]) -> Vec<f64> {
        let m = cameras.len();
        let of_view = |i: usize| {
            let points = self.scene.points(&self.judged, cameras, |k| k != i || m == 2);
            let off = self.scene.distances(&self.judged, &points, i, &cameras[i]);
            median(off.iter().map(|(px, _)| *px))
        };
        (0..m).map(of_view).collect()
    }
}

/// The equations of all parameters of all cameras, mm, with joints `(T, N)` at `points`, which move
/// as these do, and what the detections cost: S, s.
///
/// # Errors
/// [`Error::InvalidInput`] if the numbers of views or points do not match.
pub fn equations(
    cameras: &[Placed],
    frames: &[Detections],
    points: Vec<Vector3<f64>>,
    sigma: f64,
) -> Result<Reduced> {
    let all: Vec<Camera> = cameras.iter().map(|placed| placed.camera.clone()).collect();
    let times: Vec<usize> = (0..frames.len()).collect();
    check(&all, Filmed { frames, times: &times }, &Adjustable::default())?;
    let scene = Scene::new(frames);
    if points.len() != frames.len() * scene.n_joints() {
        let expected = format!("{} x {} points", frames.len(), scene.n_joints());
        return Err(Error::invalid("points", expected, points.len().to_string()));
    }
    let motion = JointMotion::known(scene.n_joints(), points.clone());
    let free = Freedom { focal: true, clock: true, ..Freedom::PLACE };
    let freedom = vec![free; cameras.len()];
    let (scene, frames, all) = (scene.moving(&motion), times.as_slice(), times.as_slice());
    let lenses = &CALIBRATED;
    let scope = Scope { scene, frames, all, given: cameras, focal: true, clock: true, lenses };
    let bundle = scope.bundle(cameras.to_vec(), freedom, points);
    Ok(Reduced::sum(&bundle.clusters(sigma)))
}

/// Frames to adjust on and to judge on.
fn divided(n: usize) -> (Vec<usize>, Vec<usize>) {
    if n < LEAST_DIVIDED {
        return ((0..n).collect(), Vec::new());
    }
    let parts = PARTS.min(n);
    let (judged, fitted): (Vec<usize>, Vec<usize>) =
        (0..n).partition(|t| (t * parts / n) % EVERY == LEFT_OUT);
    (spread(&fitted, FITTED), spread(&judged, JUDGED))
}

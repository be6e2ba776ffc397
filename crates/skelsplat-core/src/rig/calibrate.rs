//! Cameras from the people who are filmed: a first guess of a rig is adjusted with all cameras
//! free, by the bundle of [`super::bundle`] from wide kernels to narrow ones.

mod fit;
pub(super) mod knocked;
mod stature;

use nalgebra::DVector;

use self::fit::Fit;
use self::stature::stature_of;
use super::bundle::PER_NOISE;
use super::evidence::{Bars, shared_turn};
use super::gauge::{Sureness, Zooms};
use super::lenses::{FOCAL_SIGMA, LensPosterior, alike};
use super::placed::{Freedom, Placed, reach, rebuilt};
use super::prior::Lenses;
use super::scene::{JointMotion, Scene, spread};
use super::search::{Explanation, Scope};
use crate::batch::Progress;
use crate::camera::{Camera, Distortion};
use crate::detections::Detections;
use crate::error::{Error, Result};
use crate::layout::Layout;
use crate::refine::RefineConfig;
use crate::threads;

/// Frames by which the rig is judged.
const COMPARED: usize = 150;
/// Most frames on which the rig is adjusted at first.
const FEW: usize = 80;
/// Most frames on which it is adjusted in the end.
const MANY: usize = 300;
/// The first kernels are so many times wider.
const WIDER: f64 = 8.0;
/// How far the principal point of an unknown lens may be from the middle of the image, relative to
/// its longer side: another turn as well.
const OFF_CENTRE: f64 = 0.012;
/// A clock that was not asked for is off if it differs by this many standard errors,
const SHOWN: f64 = 4.0;
/// and by this many frames: less costs little.
const LEAST_CLOCK: f64 = 0.5;

/// A recording.
#[derive(Debug, Clone, Copy)]
pub struct Filmed<'a> {
    /// What is seen in every frame.
    pub frames: &'a [Detections],
    /// Its time, by which the recording is divided: several people may be one after another.
    pub times: &'a [usize],
}

/// What is unknown besides the cameras' places.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Unknown {
    /// Focal lengths, and how lenses without coefficients distort.
    pub focal: bool,
    /// All cameras have one focal length.
    pub same_focal: bool,
    /// Clocks; otherwise they are those of the first guess unless they are clearly not.
    pub clock: bool,
}

/// One camera of a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibratedCamera {
    /// In the rig's frame, mm; as given where the camera was left out.
    pub placed: Placed,
    /// Whether it belongs to the rig.
    pub used: bool,
    /// Error bars, of the rig as a whole free: NaN where nothing was estimated.
    pub bars: Bars,
    /// Median distance of its detections from where all cameras place the joints, px.
    pub distance: f64,
    /// The part of them that this explains.
    pub explained: f64,
    /// By which factor its focal length seems to be wrong, if it was given or is that of all; 1 if
    /// it may be right.
    pub zoom: f64,
}

/// A rig found from the people who are filmed.
#[derive(Debug, Clone, PartialEq)]
pub struct RigCalibration {
    /// The cameras, in the frame of the first that belongs to the rig, with lengths of any scale.
    pub cameras: Vec<CalibratedCamera>,
    /// The stature that the population's proportions give the person, in this scale, and its
    /// standard error; NaN for layouts without proportions, and where no such bone is seen.
    pub stature: [f64; 2],
    /// Standard deviation per axis by which joints are off because the cameras are, with all joints
    /// aligned.
    pub joint_sigma: f64,
    /// The camera that was moved while it recorded, and the time from which on it is elsewhere: the
    /// rig is that of neither then.
    pub moved: Option<(usize, usize)>,
}

/// Adjusts `cameras`, of which only a first guess is known, by the joints that they see: those with
/// a clock, frames; the others are left out.
///
/// # Errors
/// [`Error::InvalidInput`] if numbers do not match, [`Error::Cancelled`].
pub fn calibrate_cameras(
    cameras: &[Camera],
    clocks: &[Option<f64>],
    Filmed { frames, times }: Filmed<'_>,
    layout: &Layout,
    unknown: Unknown,
    config: &RefineConfig,
    progress: &Progress,
) -> Result<RigCalibration> {
    check_filmed(frames, times, cameras.len())?;
    let placed = clocks.iter().flatten().count();
    if placed < 2 {
        let expected = "those of at least two cameras";
        return Err(Error::invalid("clocks", expected, placed.to_string()));
    }
    threads::install(config.n_threads, |_| {
        let used: Vec<Detections> =
            frames.iter().map(|frame| frame.above(config.min_confidence)).collect();
        let ideal = |camera: &Camera| match config.undistort {
            true => camera.clone(),
            false => camera.clone().with_distortion(Distortion::None),
        };
        let given: Vec<Camera> = cameras.iter().map(ideal).collect();
        let placed = |(camera, clock): (&Camera, &Option<f64>)| {
            clock.map(|clock| Placed { camera: camera.clone(), clock })
        };
        let start: Vec<Option<Placed>> = given.iter().zip(clocks).map(placed).collect();
        let distorted = config.undistort;
        let makes = |i: usize| if unknown.same_focal { 0 } else { i };
        let makes: Vec<usize> = (0..cameras.len()).map(makes).collect();
        let lenses = Lenses::unknown(&alike(&makes, FOCAL_SIGMA));
        let task = Task {
            given: &given,
            frames: &used,
            times,
            part: None,
            unknown,
            lenses: &lenses,
            distorted,
        };
        task.solve(&start, layout, progress)
    })
}

pub(super) fn check_filmed(frames: &[Detections], times: &[usize], views: usize) -> Result<()> {
    if times.len() != frames.len() {
        let expected = format!("one per frame ({})", frames.len());
        return Err(Error::invalid("times", expected, times.len().to_string()));
    }
    if let Some(frame) = frames.iter().find(|frame| frame.n_views() != views) {
        let expected = format!("one view per camera ({views})");
        return Err(Error::invalid("detections", expected, format!("{} views", frame.n_views())));
    }
    Ok(())
}

/// A part of a recording.
#[derive(Clone, Copy)]
enum Part {
    Before(usize),
    From(usize),
}

impl Part {
    fn holds(self, time: usize) -> bool {
        match self {
            Self::Before(middle) => time < middle,
            Self::From(middle) => time >= middle,
        }
    }
}

#[derive(Clone, Copy)]
struct Task<'a> {
    given: &'a [Camera],
    frames: &'a [Detections],
    times: &'a [usize],
    /// Frames before a time, or from it on; `None`: all.
    part: Option<Part>,
    unknown: Unknown,
    lenses: &'a Lenses,
    /// Whether pixels are as lenses distort them.
    distorted: bool,
}

impl Task<'_> {
    fn solve(
        &self,
        start: &[Option<Placed>],
        layout: &Layout,
        progress: &Progress,
    ) -> Result<RigCalibration> {
        let mut views: Vec<usize> = (0..start.len()).filter(|i| start[*i].is_some()).collect();
        let mut cameras: Vec<Placed> = start.iter().flatten().cloned().collect();
        cameras = self.adjusted(&views, cameras, FEW, WIDER, progress)?.cameras;
        let mut task = *self;
        if !self.unknown.clock {
            task.unknown.clock = true;
            let rig = task.adjusted(&views, cameras.clone(), FEW, WIDER, progress)?;
            task.unknown.clock = self.is_out_of_step(&rig);
            if task.unknown.clock {
                cameras = rig.cameras;
            }
        }
        let mut moved;
        let rough = loop {
            let rig = task.adjusted(&views, cameras.clone(), FEW, 1.0, progress)?;
            moved = task.moved(&views, &cameras, progress)?;
            let worst = task.fit(&views, &rig.cameras).worst().filter(|_| views.len() > 2);
            let Some(k) = worst.filter(|_| moved.is_none()) else { break rig };
            cameras = rig.cameras;
            cameras.remove(k);
            views.remove(k);
        };
        let Unknown { focal, same_focal, .. } = self.unknown;
        let kinds = (focal && !same_focal).then(|| task.zooms(&views, &rough)).flatten();
        let kinds = kinds.and_then(LensPosterior::of_kinds);
        let lenses = kinds.as_ref().map(|kinds| Lenses::unknown(kinds.prior()));
        let task = Task { lenses: lenses.as_ref().unwrap_or(task.lenses), ..task };
        let rig = task.adjusted(&views, rough.cameras, MANY, 1.0, progress)?;
        let lenses = match kinds {
            None => task.other_lenses(&views, &rig, progress)?,
            kinds => kinds,
        };
        let judged = task.judged(&views, &rig, lenses.as_ref(), layout);
        Ok(RigCalibration { cameras: self.report(&views, judged.cameras), moved, ..judged })
    }

    /// Whether clocks that are free show that some camera is not in step.
    fn is_out_of_step(&self, rig: &Explanation) -> bool {
        let Some(sureness) = Sureness::of(rig) else { return false };
        let shown = |camera: &Placed, bars: &Bars| {
            camera.clock.abs() > f64::max(LEAST_CLOCK, SHOWN * bars.clock)
        };
        rig.cameras.iter().zip(&sureness.bars()).any(|(camera, bars)| shown(camera, bars))
    }

    /// How focal lengths that are given, or the same, may be wrong: that of one camera, or of all.
    /// Two views would take a detector's lasting errors for another lens.
    fn other_lenses(
        &self,
        views: &[usize],
        rig: &Explanation,
        progress: &Progress,
    ) -> Result<Option<LensPosterior>> {
        let Unknown { focal, same_focal, .. } = self.unknown;
        if focal && !same_focal || views.len() < 3 {
            return Ok(None);
        }
        let unknown = Unknown { focal: true, ..self.unknown };
        let each: Vec<usize> = (0..views.len()).collect();
        let lenses = Lenses::unknown(&alike(&each, FOCAL_SIGMA));
        let task = Task { unknown, lenses: &lenses, distorted: false, ..*self };
        let free = task.adjusted(views, rig.cameras.clone(), FEW, 1.0, progress)?;
        let judge = if focal { LensPosterior::of_one_make } else { LensPosterior::of_given };
        Ok(task.zooms(views, &free).and_then(judge))
    }

    /// What a rig with free lenses says of them, relative to those expected.
    fn zooms(&self, views: &[usize], free: &Explanation) -> Option<Zooms> {
        let focal = |k: usize| free.cameras[k].camera.focal()[0];
        let zoom = |k: usize| (focal(k) / self.given[views[k]].focal()[0]).ln();
        Sureness::of(free)?.zooms(DVector::from_fn(views.len(), |k, _| zoom(k)))
    }

    /// All cameras, also those that do not belong to the rig.
    fn report(&self, views: &[usize], rig: Vec<CalibratedCamera>) -> Vec<CalibratedCamera> {
        let left_out = |camera: &Camera| CalibratedCamera {
            placed: Placed { camera: camera.clone(), clock: 0.0 },
            used: false,
            bars: Bars::UNKNOWN,
            distance: f64::NAN,
            explained: f64::NAN,
            zoom: 1.0,
        };
        let mut all: Vec<CalibratedCamera> = self.given.iter().map(left_out).collect();
        views.iter().zip(rig).for_each(|(i, camera)| all[*i] = camera);
        all
    }

    fn n_joints(&self) -> usize {
        self.frames.first().map_or(0, Detections::n_joints)
    }

    /// The detections of some views.
    fn of_views(&self, views: &[usize]) -> Vec<Detections> {
        let n = self.n_joints();
        let some = |frame: &Detections| {
            Detections::gathered(views.len(), n, |k, j| frame.get(views[k], j))
        };
        self.frames.iter().map(some).collect()
    }

    /// Frames in which at least two views see somebody.
    fn shared(&self, seen: &[Detections], cameras: &[Placed], most: usize) -> Vec<usize> {
        let scene = Scene::new(seen);
        let n = self.n_joints();
        let sees =
            |t: usize, i: usize| (0..n).any(|j| scene.sight(t, i, j, &cameras[i], false).is_some());
        let enough = |t: &usize| (0..cameras.len()).filter(|i| sees(*t, *i)).count() >= 2;
        let within = |t: &usize| self.part.is_none_or(|part| part.holds(self.times[*t]));
        let all: Vec<usize> = (0..seen.len()).filter(within).filter(enough).collect();
        spread(&all, most)
    }

    /// The bundle of the rig of some views on so many frames, from kernels `wider` than the final.
    fn adjusted(
        &self,
        views: &[usize],
        mut cameras: Vec<Placed>,
        frames: usize,
        wider: f64,
        progress: &Progress,
    ) -> Result<Explanation> {
        progress.check()?;
        let first = cameras.first().map_or(0.0, |camera| camera.clock);
        cameras.iter_mut().for_each(|camera| camera.clock -= first);
        let seen = self.of_views(views);
        let Unknown { focal, clock, .. } = self.unknown;
        let distorted = |i: &usize| self.distorted && self.given[*i].distortion().is_none();
        let lens = |i| Freedom { focal, radial: focal && distorted(i), ..Freedom::default() };
        let free = |i| Freedom { turn: true, shift: true, clock, ..lens(i) };
        let mut freedom: Vec<Freedom> = views.iter().map(free).collect();
        freedom[0] = lens(&views[0]);
        let chosen = self.shared(&seen, &cameras, frames);
        let plain = Scene::new(&seen);
        let motion = clock.then(|| JointMotion::of(plain, &chosen, &cameras));
        let scene = motion.as_ref().map_or(plain, |motion| plain.moving(motion));
        let given = self.expected(views, &cameras)?;
        let scope = self.scope(scene, &chosen, &given);
        let sigma = scope.sigma(&cameras);
        Ok(scope.explain(cameras, freedom, sigma, wider))
    }

    fn scope<'a>(
        &'a self,
        scene: Scene<'a>,
        frames: &'a [usize],
        given: &'a [Placed],
    ) -> Scope<'a> {
        let Self { unknown: Unknown { focal, clock, .. }, lenses, .. } = *self;
        Scope { scene, frames, all: frames, given, focal, clock, lenses }
    }

    /// The cameras where they are now with the focal lengths that were given.
    fn expected(&self, views: &[usize], cameras: &[Placed]) -> Result<Vec<Placed>> {
        let given = |(i, now): (&usize, &Placed)| {
            let (rotation, centre) = (now.camera.rotation(), now.camera.centre());
            let camera = rebuilt(&self.given[*i], rotation, &centre, 1.0)?;
            Ok(Placed { camera, clock: now.clock })
        };
        views.iter().zip(cameras).map(given).collect()
    }

    /// What each camera's detections say of the joints, and error bars.
    fn judged(
        &self,
        views: &[usize],
        rig: &Explanation,
        lenses: Option<&LensPosterior>,
        layout: &Layout,
    ) -> RigCalibration {
        let fit = self.fit(views, &rig.cameras);
        let mut sureness = Sureness::of(rig);
        if let (Some(known), Some(lenses)) = (&mut sureness, lenses) {
            lenses.widen(known);
        }
        let joints = |known: &Sureness| self.joints(views, rig, &fit, known);
        let joint_sigma = sureness.as_ref().map_or(f64::NAN, joints);
        sureness.iter_mut().for_each(|known| known.turn(&self.turns(&rig.cameras, &fit)));
        let unknown = || vec![Bars::UNKNOWN; views.len()];
        let bars = sureness.as_ref().map_or_else(unknown, Sureness::bars);
        let zooms = lenses.map_or_else(|| vec![1.0; views.len()], LensPosterior::zooms);
        let camera = |k: usize| CalibratedCamera {
            placed: rig.cameras[k].clone(),
            used: true,
            bars: bars[k],
            distance: fit.of_cameras[k].distance,
            explained: fit.of_cameras[k].explained,
            zoom: zooms[k],
        };
        let cameras = (0..views.len()).map(camera).collect();
        let stature = stature_of(&fit.points, layout);
        RigCalibration { cameras, stature, joint_sigma, moved: None }
    }

    /// By how much cameras may be turned so that all their detections are off alike, rad.
    fn turns(&self, cameras: &[Placed], fit: &Fit) -> Vec<f64> {
        let turn = |(placed, reach): (&Placed, f64)| {
            let [width, height] = placed.camera.size().map(f64::from);
            let off = OFF_CENTRE * width.max(height) / placed.camera.focal()[0];
            let shared = shared_turn(fit.noise, reach, cameras.len());
            if self.unknown.focal { shared.hypot(off) } else { shared }
        };
        cameras.iter().zip(reach(&fit.points, cameras)).map(turn).collect()
    }

    /// How far joints are off because of the cameras.
    fn joints(&self, views: &[usize], rig: &Explanation, fit: &Fit, known: &Sureness) -> f64 {
        let seen = self.of_views(views);
        let scope = self.scope(Scene::new(&seen), &fit.frames, &rig.cameras);
        let still = vec![Freedom::default(); views.len()];
        let bundle = scope.bundle(rig.cameras.clone(), still, fit.points.clone());
        known.joints(&bundle.follows(PER_NOISE * fit.noise))
    }

    /// How well a rig fits.
    fn fit(&self, views: &[usize], cameras: &[Placed]) -> Fit {
        let seen = self.of_views(views);
        let chosen = self.shared(&seen, cameras, COMPARED);
        let scene = Scene::new(&seen);
        let noise = self.scope(scene, &chosen, cameras).sigma(cameras) / PER_NOISE;
        Fit::of(scene, chosen, noise, cameras)
    }
}

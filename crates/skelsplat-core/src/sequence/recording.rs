//! A recording in windows: what is common to all is learnt from a sample of them, then each is
//! solved.

use std::ops::RangeInclusive;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::lasting::memories;
use super::learn::{self, Known, Learnt};
use super::noise::{DetectionNoise, Kernel};
use super::outcome::{SolvedWindow, errors};
use super::posterior::posterior;
use super::process_noise;
use super::scales::{Residuals, TAKEN};
use super::size::{LEAST_SPREAD, USUAL_SPREAD, body_size};
use super::solver::{Common, NARROW, NARROWEST, SETTLE, WIDE, WindowSolver};
use super::swaps::{self, FrameSwap};
use super::tracks::{BRIDGE, Tracks};
use super::windows::{Window, frames_in, sample, window_size, windows};
use crate::annealed::Alone;
use crate::annealed::posterior::BodyExtent;
use crate::batch::Progress;
use crate::bones::{Length, other_end};
use crate::error::{Error, Result};
use crate::refine::results::{numbers, size};
use crate::refine::{Frame, Method, Refinements, Refiner};
use crate::statistics::median;
use crate::threads;

/// Frames per second that can be computed with.
const RATES: RangeInclusive<f64> = 1e-3..=1e6;
/// A bone that is never seen.
const UNKNOWN: Length = Length { mean: f64::NAN, sigma: f64::INFINITY };

/// A refined recording, in the unit of the cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct Sequence {
    /// The frames; `init_pose` is the pose of each frame alone.
    pub frames: Refinements,
    /// Velocities `(T, N, 3)`, unit/s; NaN where unknown.
    pub velocity: Vec<f64>,
    /// Their covariances `(T, N, 3, 3)`.
    pub velocity_covariance: Vec<f64>,
    /// Joints at both ends of every bone `(B)`.
    pub bones: Vec<[usize; 2]>,
    /// Their lengths with standard errors; infinite error where no frame shows the bone.
    pub lengths: Vec<Length>,
    /// Standard deviation of every view's detections across their rays, per axis: the median over
    /// the joints `(M)`.
    pub view_noise: Vec<f64>,
}

/// Refines the frames of one motion, recorded `fps` times per second, in order and without leaving
/// frames out.
///
/// # Errors
/// [`Error::InvalidInput`] if views or joints do not match, if `fps` is not from 1e-3 to 1e6, or
/// for another method than `annealed`; [`Error::Cancelled`] once cancelled.
pub fn refine_sequence(
    refiner: &Refiner,
    frames: &[Frame],
    fps: f64,
    progress: &Progress,
) -> Result<Sequence> {
    refine_in_windows(refiner, frames, fps, window_size(fps), progress)
}

/// [`refine_sequence`] in windows of at most this length, which overlap by so many frames on either
/// side.
pub fn refine_in_windows(
    refiner: &Refiner,
    frames: &[Frame],
    fps: f64,
    size: [usize; 2],
    progress: &Progress,
) -> Result<Sequence> {
    check(refiner, fps, "'annealed' for a sequence")?;
    let windows = windows(frames.len(), size);
    let out = Sequence::none(frames, refiner)?;
    let parts: Vec<&[Frame]> = sample(&windows).into_iter().map(|part| &frames[part]).collect();
    let refiner = &refiner.at_size(size_of(refiner, &parts)?);
    let recording = Recording { refiner, frames, fps, progress };
    threads::install(refiner.config().n_threads, |_| match windows.as_slice() {
        [] => Ok(out),
        [window] => recording.learn_and_solve(window, out),
        windows => {
            let known = recording.learn_from(&parts)?;
            recording.solve(windows, &known, out)
        }
    })
}

/// What a [`sample`], stretches of consecutive frames, shows about a recording, for
/// [`refine_windows`].
///
/// # Errors
/// As [`refine_sequence`], and [`Error::InvalidInput`] if there is no frame.
pub fn learn_sequence(
    refiner: &Refiner,
    stretches: &[&[Frame]],
    fps: f64,
    progress: &Progress,
) -> Result<Known> {
    check(refiner, fps, "'annealed' for a sequence")?;
    size(stretches.iter().copied().flatten())?;
    if stretches.is_empty() || stretches.iter().any(|frames| frames.is_empty()) {
        return Err(Error::invalid("detections", "frames to learn from", "none"));
    }
    let refiner = &refiner.at_size(size_of(refiner, stretches)?);
    let recording = Recording { refiner, frames: &[], fps, progress };
    threads::install(refiner.config().n_threads, |_| recording.learn_from(stretches))
}

/// Refines consecutive `windows` of a recording of more than one, of which these are the `frames`,
/// as [`refine_sequence`] refines them in the whole recording: the results are those of the frames
/// that the windows answer for. The bones' lengths have their errors in these windows.
///
/// # Errors
/// As [`refine_sequence`], and [`Error::InvalidInput`] if windows are not those of the frames, or
/// `known` is of other joints or bones.
pub fn refine_windows(
    refiner: &Refiner,
    frames: &[Frame],
    windows: &[Window],
    known: &Known,
    progress: &Progress,
) -> Result<Sequence> {
    let fps = known.learnt.common.fps;
    check(refiner, fps, "'annealed' for a sequence")?;
    let inside = |w: &Window| {
        let ends = [w.all.start, w.own.start, w.own.end, w.all.end, frames.len()];
        ends.is_sorted() && !w.own.is_empty()
    };
    let joined = windows.windows(2).all(|pair| pair[0].own.end == pair[1].own.start);
    if windows.is_empty() || !joined || !windows.iter().all(inside) {
        let expected = format!("consecutive windows of the {} frames", frames.len());
        return Err(Error::invalid("windows", expected, format!("{windows:?}")));
    }
    let (_, n) = size(frames)?;
    if n != known.n_joints() || known.first.bones != refiner.bones() {
        let actual = format!("{} joints of another recording", known.n_joints());
        return Err(Error::invalid("known", format!("{n} joints"), actual));
    }
    let refiner = &refiner.at_size(known.size);
    let recording = Recording { refiner, frames, fps, progress };
    let own = windows[0].own.start..windows[windows.len() - 1].own.end;
    let out = Sequence::none(&frames[own], refiner)?;
    threads::install(refiner.config().n_threads, |_| recording.solve(windows, known, out))
}

/// The body's size, as some frames show it; a person's where they show none.
fn size_of(refiner: &Refiner, stretches: &[&[Frame]]) -> Result<f64> {
    let size = body_size(refiner, stretches)?;
    Ok(if size.is_finite() { size } else { 1.0 })
}

/// Rejects a rate that is none, and another method than the `expected` one.
pub(crate) fn check(refiner: &Refiner, fps: f64, expected: &str) -> Result<()> {
    if !(fps.is_finite() && fps > 0.0) {
        let expected = "a positive number of frames per second";
        return Err(Error::invalid("fps", expected, fps.to_string()));
    }
    if !RATES.contains(&fps) {
        return Err(Error::invalid("fps", "a number from 1e-3 to 1e6", format!("{fps:e}")));
    }
    if !matches!(refiner.config().method, Method::Annealed(_)) {
        let name = refiner.config().method.name();
        return Err(Error::invalid("config.method", expected, format!("'{name}'")));
    }
    Ok(())
}

struct Recording<'a> {
    refiner: &'a Refiner,
    frames: &'a [Frame],
    fps: f64,
    progress: &'a Progress,
}

/// Tracks with their sides corrected, and the path found in them.
struct Path {
    tracks: Tracks,
    swapped: Vec<FrameSwap>,
    points: Vec<Vector3<f64>>,
    steps: usize,
}

/// The results of a window, and the standard errors of the bones' lengths, mm; infinite for a bone
/// that is not seen.
type Solved = (Sequence, Vec<f64>);

impl Recording<'_> {
    /// Solves the only window, from which is learnt as well.
    fn learn_and_solve(&self, window: &Window, out: Sequence) -> Result<Sequence> {
        let alone = [self.alone(self.frames)?];
        let (Known { learnt, .. }, path) = self.learn(&alone)?;
        let solved = self.finish(window, &alone[0], path, &learnt)?;
        Ok(self.joined(out, vec![solved], &learnt))
    }

    fn learn_from(&self, stretches: &[&[Frame]]) -> Result<Known> {
        let alone: Result<Vec<Vec<Alone>>> =
            stretches.iter().map(|frames| self.alone(frames)).collect();
        Ok(self.learn(&alone?)?.0)
    }

    /// Solves consecutive windows.
    fn solve(&self, windows: &[Window], known: &Known, out: Sequence) -> Result<Sequence> {
        let solved = windows.par_iter().map(|window| self.window(window, known));
        let solved: Vec<Solved> = solved.collect::<Result<_>>()?;
        Ok(self.joined(out, solved, &known.learnt))
    }

    /// The results of windows one after the other in `out`, and what all frames share, in the unit
    /// of the cameras: the noise, and the lengths of the bones that the recording shows, with the
    /// median of the errors in each window; infinite where none of these shows the bone.
    fn joined(&self, mut out: Sequence, solved: Vec<Solved>, learnt: &Learnt) -> Sequence {
        let mm = self.refiner.millimetres();
        let with_error = |(b, length): (usize, &Length)| {
            let finite = solved.iter().map(|(_, errors)| errors[b]).filter(|e| e.is_finite());
            match median(finite) {
                error if error.is_finite() => Length { mean: length.mean / mm, sigma: error / mm },
                _ if learnt.shown[b] => Length { mean: length.mean / mm, ..UNKNOWN },
                _ => UNKNOWN,
            }
        };
        out.lengths = learnt.common.lengths.iter().enumerate().map(with_error).collect();
        out.view_noise = learnt.common.noise.of_views().into_iter().map(|s| s / mm).collect();
        for (mut window, _) in solved {
            out.frames.append(window.frames);
            out.velocity.append(&mut window.velocity);
            out.velocity_covariance.append(&mut window.velocity_covariance);
        }
        out
    }

    fn alone(&self, frames: &[Frame]) -> Result<Vec<Alone>> {
        let solve = |frame: &Frame| {
            self.progress.check()?;
            self.refiner.alone(frame)
        };
        frames.par_iter().map(solve).collect()
    }

    fn tracks(&self, stretches: &[&[Alone]], noise: &DetectionNoise) -> Tracks {
        Tracks::new(stretches, frames_in(BRIDGE, self.fps), noise)
    }

    /// What is common to all windows, from the frames of some of them, and their path.
    fn learn(&self, sample: &[Vec<Alone>]) -> Result<(Known, Path)> {
        let (first, tracks) = self.first(sample);
        self.path(tracks, first, None)
    }

    /// What the frames alone show, and their tracks.
    fn first(&self, sample: &[Vec<Alone>]) -> (Common, Tracks) {
        let all = || sample.iter().flatten();
        let noise = median(all().map(|f| f.bars.noise).filter(|n| n.is_finite()));
        let noise = if noise.is_finite() { noise } else { 1.0 };
        let spread = median(all().filter_map(|f| BodyExtent::spread(&f.points)));
        let rays = &sample[0][0].rays;
        let views = 0..rays.n_views();
        let confidence = views.map(|i| confidence(all(), i)).collect();
        let kernel = Kernel::of(self.refiner, rays.n_joints());
        let noise_of = DetectionNoise::uniform(confidence, noise * noise, kernel);
        let stretches: Vec<&[Alone]> = sample.iter().map(Vec::as_slice).collect();
        let tracks = self.tracks(&stretches, &noise_of);
        let bones = self.refiner.bones().to_vec();
        let common = Common {
            fps: self.fps,
            lengths: learn::lengths(&tracks, &tracks.alone, &bones, &self.refiner.expected),
            process_noise: process_noise::learn(&tracks, self.fps, &noise_of.of_joints()),
            bones,
            noise: noise_of,
            reach: if spread > LEAST_SPREAD * noise { spread } else { USUAL_SPREAD },
        };
        (common, tracks)
    }

    /// The noise that the path of `run` shows, unless the user gives it.
    fn noise(&self, run: &WindowSolver<'_>, residuals: &Residuals) -> DetectionNoise {
        let before = &run.common.noise;
        match self.refiner.config().detection_sigma_px {
            Some(_) => before.clone(),
            None => before.learnt(residuals, &self.refiner.classes(run.tracks.joints)),
        }
    }

    /// How the noise varies in time, unless the user gives it.
    fn factors(&self, noise: &DetectionNoise, residuals: &Residuals) -> Vec<f64> {
        match self.refiner.config().detection_sigma_px {
            Some(_) => Vec::new(),
            None => noise.in_time(residuals, self.fps),
        }
    }

    /// The path from wide kernels down to the final ones, the sides that it shows to be swapped,
    /// and what is common to all frames, which it shows unless it is `known`. Windows find theirs
    /// with the same knowledge: where two paths are as good, they take the same.
    fn path(&self, tracks: Tracks, first: Common, known: Option<&Known>) -> Result<(Known, Path)> {
        let (mut path, wide) = self.wide(tracks, &first, known)?;
        self.narrow(&mut path, &wide)?;
        let tracks = &path.tracks;
        let learnt = known.map(|known| &known.learnt);
        let lengths = match learnt {
            None => learn::lengths(tracks, &path.points, &wide.bones, &self.refiner.expected),
            Some(learnt) => learnt.common.lengths.clone(),
        };
        let common = Common { lengths, ..wide.clone() };
        let mut run = WindowSolver::new(tracks, &common, Some(std::mem::take(&mut path.points)));
        run.anneal(SETTLE, self.progress)?;
        let residuals = Residuals::of(&run, 1.0, TAKEN);
        let learn = || {
            let noise = self.noise(&run, &residuals);
            let classes = self.refiner.classes(tracks.joints);
            let memory = memories(&run, &noise, &classes, residuals.absorbed(TAKEN));
            let shown = learn::shown(tracks, &wide.bones);
            Learnt { common: Common { noise, ..common.clone() }, memory, shown }
        };
        let learnt = learnt.cloned().unwrap_or_else(learn);
        (path.points, path.steps) = (run.points, path.steps + run.n_iter);
        let factors = self.factors(&learnt.common.noise, &residuals);
        path.tracks.weigh(&learnt.common.noise, &factors);
        Ok((Known { size: self.refiner.size, first, wide, learnt }, path))
    }

    /// The path under wide kernels, and what is common to all frames by it unless it is `known`.
    fn wide(
        &self,
        mut tracks: Tracks,
        first: &Common,
        known: Option<&Known>,
    ) -> Result<(Path, Common)> {
        let chains = &self.refiner.chains;
        let swapped = swaps::exchanged(&tracks, chains, first);
        for swap in swapped.iter().filter(|swap| swap.view == 0) {
            chains[swap.chain].iter().for_each(|[l, r]| tracks.exchange(swap.frame, *l, *r));
        }
        tracks.find_cuts(first.fps, &first.usual());
        let mut run = WindowSolver::new(&tracks, first, None);
        run.anneal(WIDE, self.progress)?;
        let residuals = Residuals::of(&run, NARROWEST, TAKEN);
        let shown = || {
            let noise = self.noise(&run, &residuals);
            let process_noise = process_noise::learn(&tracks, self.fps, &noise.of_joints());
            let lengths =
                learn::lengths(&tracks, &run.points, &first.bones, &self.refiner.expected);
            Common { noise, process_noise, lengths, ..first.clone() }
        };
        let wide = known.map_or_else(shown, |known| known.wide.clone());
        let (points, steps) = (run.points, run.n_iter);
        tracks.weigh(&wide.noise, &self.factors(&wide.noise, &residuals));
        tracks.process_noise =
            process_noise::local(&tracks, self.fps, &wide.bones, &wide.process_noise);
        Ok((Path { tracks, swapped, points, steps }, wide))
    }

    /// The path under the final kernels, and the sides that it shows to be swapped.
    fn narrow(&self, path: &mut Path, wide: &Common) -> Result<()> {
        let chains = &self.refiner.chains;
        let points = std::mem::take(&mut path.points);
        let mut run = WindowSolver::new(&path.tracks, wide, Some(points));
        run.anneal(NARROW, self.progress)?;
        (path.points, path.steps) = (run.points, path.steps + run.n_iter);
        let found = swaps::find(&path.tracks, chains, &path.points, wide);
        for swap in &found {
            for [l, r] in &chains[swap.chain] {
                path.tracks.swap(swap.view, swap.frame, *l, *r);
            }
        }
        path.swapped.extend(found);
        Ok(())
    }

    fn window(&self, window: &Window, known: &Known) -> Result<Solved> {
        let alone = self.alone(&self.frames[window.all.clone()])?;
        let tracks = self.tracks(&[&alone], &known.first.noise);
        let (_, path) = self.path(tracks, known.first.clone(), Some(known))?;
        self.finish(window, &alone, path, &known.learnt)
    }

    /// The solution along a path, with its error bars.
    fn finish(
        &self,
        window: &Window,
        alone: &[Alone],
        path: Path,
        learnt: &Learnt,
    ) -> Result<Solved> {
        let Path { tracks, swapped, points, steps } = path;
        let mut used: Vec<Vec<usize>> = alone.iter().map(|frame| frame.used_for.clone()).collect();
        for swap in &swapped {
            let of_view = swap.view * tracks.joints..(swap.view + 1) * tracks.joints;
            for pair in &self.refiner.chains[swap.chain] {
                for joint in &mut used[swap.frame][of_view.clone()] {
                    *joint = other_end(*pair, *joint).unwrap_or(*joint);
                }
            }
        }
        let mut run = WindowSolver::new(&tracks, &learnt.common, Some(points));
        run.anneal(SETTLE, self.progress)?;
        run.linearise(1.0);
        let found = posterior(&run, learnt);
        let errors = errors(&run, &found);
        let steps = steps + run.n_iter;
        let state = SolvedWindow::of(&run, &found);
        let mm = self.refiner.millimetres();
        let frames = &self.frames[window.own.clone()];
        let mut out = Sequence::none(frames, self.refiner)?;
        for (k, frame) in (window.own.start - window.all.start..).zip(frames) {
            let used = std::mem::take(&mut used[k]);
            let (outcome, bars) = state.outcome(k, &alone[k], used, steps);
            out.frames.push(&self.refiner.result(&frame.detections, outcome, &bars));
            let joints = || (0..tracks.joints).map(|j| j * tracks.frames + k);
            let velocities: Vec<_> = joints().map(|k| found.velocities[k] / mm).collect();
            let spreads: Vec<_> = joints().map(|k| found.of_velocities[k] / (mm * mm)).collect();
            out.velocity.extend(numbers(&velocities));
            out.velocity_covariance.extend(numbers(&spreads));
            self.progress.advance();
        }
        Ok((out, errors))
    }
}

/// Mean confidence of the detections of view `i`; 1 without any.
fn confidence<'a>(frames: impl Iterator<Item = &'a Alone>, i: usize) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for frame in frames {
        let rays = (0..frame.rays.n_joints()).map(|j| &frame.rays.of_joint(j)[i]);
        for ray in rays.filter(|ray| ray.is_there()) {
            (sum, n) = (sum + ray.weight, n + 1.0);
        }
    }
    if n > 0.0 { sum / n } else { 1.0 }
}

impl Sequence {
    /// No results yet of these frames.
    fn none(frames: &[Frame], refiner: &Refiner) -> Result<Self> {
        let (bones, (_, n)) = (refiner.bones(), size(frames)?);
        Ok(Self {
            frames: Refinements::new(refiner.joint_bias(n)),
            velocity: Vec::new(),
            velocity_covariance: Vec::new(),
            lengths: vec![UNKNOWN; bones.len()],
            view_noise: vec![f64::NAN; refiner.cameras.len()],
            bones: bones.to_vec(),
        })
    }
}

/// H, minus the gradient, and the process noise of a step, and the noise with its factors in time.
pub type Equations = (Vec<f64>, Vec<Vector3<f64>>, Vec<f64>, DetectionNoise, Vec<f64>);

/// The equations of one step at `points` `(N, T)` under kernels `wider` than the final ones: H,
/// row-major, and minus the gradient `(N, T)`, joint after joint, and the process noise `(N, T)`;
/// and the noise that the points show, with its factors in time `(M, T)`.
/// `common` is used with the bones of the refiner and the process noise of the frames.
///
/// # Errors
/// [`Error::InvalidInput`] if a frame does not match the refiner.
pub fn equations(
    refiner: &Refiner,
    frames: &[Frame],
    points: Vec<Vector3<f64>>,
    mut common: Common,
    wider: f64,
) -> Result<Equations> {
    let alone: Result<Vec<Alone>> = frames.iter().map(|frame| refiner.alone(frame)).collect();
    let mut tracks = Tracks::new(&[&alone?], frames_in(BRIDGE, common.fps), &common.noise);
    common.bones = refiner.bones().to_vec();
    common.process_noise = process_noise::learn(&tracks, common.fps, &common.noise.of_joints());
    tracks.process_noise =
        process_noise::local(&tracks, common.fps, &common.bones, &common.process_noise);
    let mut run = WindowSolver::new(&tracks, &common, Some(points));
    run.linearise(wider);
    let residuals = Residuals::of(&run, wider, TAKEN);
    let noise = common.noise.learnt(&residuals, &refiner.classes(tracks.joints));
    let factors = noise.in_time(&residuals, common.fps);
    Ok((run.system.dense(), run.system.pulls, tracks.process_noise, noise, factors))
}

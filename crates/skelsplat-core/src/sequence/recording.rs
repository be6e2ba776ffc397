//! A recording in windows: what is common to all is learnt from a sample of them, then each is
//! solved.

use std::ops::RangeInclusive;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::known::{Known, Learnt};
use super::learn;
use super::noise::DetectionNoise;
use super::outcome::{SolvedWindow, errors};
use super::posterior::{Posterior, posterior};
use super::process_noise;
use super::solver::{ANNEAL, Common, SETTLE, WindowSolver};
use super::swaps::{self, FrameSwap};
use super::tracks::{BRIDGE, Tracks};
use super::windows::{Window, frames_in, sample, window_size, windows};
use crate::annealed::Alone;
use crate::annealed::posterior::BodyExtent;
use crate::batch::Progress;
use crate::bones::{Length, other_end};
use crate::error::{Error, Result};
use crate::refine::results::{Part, first, numbers, put, size};
use crate::refine::{Frame, Method, Refinements, Refiner};
use crate::statistics::median;
use crate::threads;

/// Frames per second that can be computed with.
const RATES: RangeInclusive<f64> = 1e-3..=1e6;
/// Least spread of a body in multiples of the noise.
pub(super) const LEAST_SPREAD: f64 = 2.0;
/// The spread where nothing is known, mm.
pub(super) const USUAL_SPREAD: f64 = 500.0;

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
    let recording = Recording { refiner, frames, fps, progress };
    let out = Sequence::blank(frames, refiner)?;
    threads::install(refiner.config().n_threads, |_| match windows.as_slice() {
        [] => Ok(out),
        [window] => recording.learn_and_solve(window, out),
        windows => {
            let parts = sample(windows).into_iter().map(|part| &frames[part]);
            let known = recording.learn_from(&parts.collect::<Vec<_>>())?;
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
    let recording = Recording { refiner, frames: &[], fps, progress };
    threads::install(refiner.config().n_threads, |_| recording.learn_from(stretches))
}

/// Refines consecutive `windows` of a recording of more than one, of which these are the `frames`,
/// as [`refine_sequence`] refines them in the whole recording: the results are those of the frames
/// that the windows answer for. The bones' lengths have their errors in these windows.
///
/// # Errors
/// As [`refine_sequence`], and [`Error::InvalidInput`] if windows are not those of the frames, or
/// `known` is of other joints.
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
    if n != known.n_joints() {
        let actual = known.n_joints().to_string();
        return Err(Error::invalid("known", format!("{n} joints"), actual));
    }
    let recording = Recording { refiner, frames, fps, progress };
    let own = windows[0].own.start..windows[windows.len() - 1].own.end;
    let out = Sequence::blank(&frames[own], refiner)?;
    threads::install(refiner.config().n_threads, |_| recording.solve(windows, known, out))
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

/// Where the frames of a window are written.
struct Place<'a> {
    frames: Part<'a>,
    velocity: &'a mut [f64],
    velocity_covariance: &'a mut [f64],
}

impl Recording<'_> {
    /// Solves the only window, from which is learnt as well.
    fn learn_and_solve(&self, window: &Window, mut out: Sequence) -> Result<Sequence> {
        let alone = [self.alone(self.frames)?];
        let (Known { learnt, .. }, path) = self.learn(&alone)?;
        let place = out.places(std::slice::from_ref(window)).remove(0);
        let errors = self.finish(window, &alone[0], path, &learnt, place)?;
        out.lengths = self.lengths(&[errors], &learnt);
        Ok(out)
    }

    fn learn_from(&self, stretches: &[&[Frame]]) -> Result<Known> {
        let alone: Result<Vec<Vec<Alone>>> =
            stretches.iter().map(|frames| self.alone(frames)).collect();
        Ok(self.learn(&alone?)?.0)
    }

    /// Solves consecutive windows.
    fn solve(&self, windows: &[Window], known: &Known, mut out: Sequence) -> Result<Sequence> {
        let jobs = windows.par_iter().zip(out.places(windows));
        let errors: Result<Vec<Vec<f64>>> =
            jobs.map(|(window, place)| self.window(window, known, place)).collect();
        out.lengths = self.lengths(&errors?, &known.learnt);
        Ok(out)
    }

    /// The bones' lengths, in the unit of the cameras, with the median of the `errors` in each
    /// window.
    fn lengths(&self, errors: &[Vec<f64>], learnt: &Learnt) -> Vec<Length> {
        let mm = self.refiner.unit().millimetres();
        let with_error = |(b, length): (usize, &Length)| {
            let finite = errors.iter().map(|of_window| of_window[b]).filter(|e| e.is_finite());
            match median(finite) {
                error if error.is_finite() => Length { mean: length.mean / mm, sigma: error / mm },
                _ => UNKNOWN,
            }
        };
        learnt.common.lengths.iter().enumerate().map(with_error).collect()
    }

    fn alone(&self, frames: &[Frame]) -> Result<Vec<Alone>> {
        let solve = |frame: &Frame| {
            self.progress.check()?;
            self.refiner.alone(frame)
        };
        frames.par_iter().map(solve).collect()
    }

    fn tracks(&self, stretches: &[&[Alone]], sigma: f64) -> Tracks {
        Tracks::new(stretches, frames_in(BRIDGE, self.fps), sigma)
    }

    fn check(&self) -> impl Fn() -> Result<()> {
        || self.progress.check()
    }

    /// What is common to all windows, from the frames of some of them, and their path. Windows find
    /// theirs with the knowledge before it: where two paths are as good, they take the same.
    fn learn(&self, sample: &[Vec<Alone>]) -> Result<(Known, Path)> {
        let all = || sample.iter().flatten();
        let noise = median(all().map(|f| f.noise).filter(|n| n.is_finite()));
        let noise = if noise.is_finite() { noise } else { 1.0 };
        let weights = all().filter(|f| f.noise.is_finite()).map(|f| f.rays.mean_weight());
        let weight = Some(median(weights)).filter(|w| w.is_finite()).unwrap_or(1.0);
        let spread = median(all().filter_map(|f| BodyExtent::spread(&f.points)));
        let sigma = self.refiner.final_kernels(sample[0][0].points.len(), noise);
        let stretches: Vec<&[Alone]> = sample.iter().map(Vec::as_slice).collect();
        let tracks = self.tracks(&stretches, sigma[0]);
        let variance = vec![noise * noise; tracks.joints];
        let (bones, expected) = (self.refiner.bones().to_vec(), self.refiner.expected());
        let mut common = Common {
            fps: self.fps,
            lengths: learn::lengths(&tracks, &tracks.alone, &bones, expected),
            process_noise: process_noise::learn(&tracks, self.fps, &variance),
            bones,
            weight,
            variance: vec![noise * noise * weight; tracks.joints],
            sigma,
            reach: if spread > LEAST_SPREAD * noise { spread } else { USUAL_SPREAD },
        };
        let mut path = self.path(tracks, &common)?;
        let first = common.clone();
        common.lengths = learn::lengths(&path.tracks, &path.points, &common.bones, expected);
        let mut run =
            WindowSolver::new(&path.tracks, &common, Some(std::mem::take(&mut path.points)));
        run.anneal(SETTLE, &self.check())?;
        run.linearise(1.0);
        let DetectionNoise { variance, memory, share } =
            DetectionNoise::of(&run, &path.tracks, &common);
        let given = self.refiner.config().detection_sigma_px.is_some();
        let variance = if given { common.variance.clone() } else { variance };
        path.steps += run.n_iter;
        path.points = run.points;
        let learnt = Learnt { common: Common { variance, ..common }, memory, share };
        Ok((Known { first, learnt }, path))
    }

    /// The path from wide kernels down to the final ones, and the sides that it shows to be
    /// swapped.
    fn path(&self, mut tracks: Tracks, common: &Common) -> Result<Path> {
        let chains = self.refiner.chains();
        let mut swapped = swaps::exchanged(&tracks, chains, common);
        swaps::exchange(&mut tracks, chains, &swapped);
        tracks.find_cuts(common.fps, &common.usual());
        tracks.process_noise =
            process_noise::local(&tracks, common.fps, &common.bones, &common.process_noise);
        let mut run = WindowSolver::new(&tracks, common, None);
        run.anneal(ANNEAL, &self.check())?;
        let (points, steps) = (run.points, run.n_iter);
        let found = swaps::find(&tracks, chains, &points, common);
        for swap in &found {
            for [l, r] in &chains[swap.chain] {
                tracks.swap(swap.view, swap.frame, *l, *r);
            }
        }
        swapped.extend(found);
        Ok(Path { tracks, swapped, points, steps })
    }

    fn window(&self, window: &Window, known: &Known, place: Place<'_>) -> Result<Vec<f64>> {
        let alone = self.alone(&self.frames[window.all.clone()])?;
        let tracks = self.tracks(&[&alone], known.learnt.common.sigma[0]);
        let path = self.path(tracks, &known.first)?;
        self.finish(window, &alone, path, &known.learnt, place)
    }

    /// Writes the solution along a path, with its error bars, and returns the standard errors of
    /// the bones' lengths, mm; infinite for a bone that is not seen.
    fn finish(
        &self,
        window: &Window,
        alone: &[Alone],
        path: Path,
        learnt: &Learnt,
        mut place: Place<'_>,
    ) -> Result<Vec<f64>> {
        let Path { tracks, swapped, points, steps } = path;
        let mut used: Vec<Vec<usize>> = alone.iter().map(|frame| frame.used_for.clone()).collect();
        for swap in &swapped {
            let of_view = swap.view * tracks.joints..(swap.view + 1) * tracks.joints;
            for pair in &self.refiner.chains()[swap.chain] {
                for joint in &mut used[swap.frame][of_view.clone()] {
                    *joint = other_end(*pair, *joint).unwrap_or(*joint);
                }
            }
        }
        let mut run = WindowSolver::new(&tracks, &learnt.common, Some(points));
        run.anneal(SETTLE, &self.check())?;
        run.linearise(1.0);
        let found = posterior(&run, &tracks, learnt);
        let errors = errors(&run, &found, &tracks, &learnt.common);
        let steps = steps + run.n_iter;
        let state = SolvedWindow::of(&run, &tracks, learnt, &found);
        let mm = self.refiner.unit().millimetres();
        for (own, t) in window.own.clone().enumerate() {
            let k = t - window.all.start;
            let used = std::mem::take(&mut used[k]);
            let (outcome, bars) = state.outcome(k, &alone[k], used, steps);
            let frame = self.refiner.result(&self.frames[t].detections, outcome, &bars);
            place.frames.write(own, &frame);
            place.move_on(own, &found, k, mm);
            self.progress.advance();
        }
        Ok(errors)
    }
}

impl Place<'_> {
    /// Writes the velocities of its frame `own`, in units of `mm`: frame `t` of the solved window.
    fn move_on(&mut self, own: usize, found: &Posterior, t: usize, mm: f64) {
        let n = self.velocity.len() / (3 * self.frames.len());
        let of_frame = || (0..n).map(|j| j * (found.velocities.len() / n) + t);
        let velocities: Vec<_> = of_frame().map(|k| found.velocities[k] / mm).collect();
        let covariances: Vec<_> = of_frame().map(|k| found.of_velocities[k] / (mm * mm)).collect();
        put(&mut self.velocity[3 * n * own..3 * n * (own + 1)], numbers(&velocities));
        put(&mut self.velocity_covariance[9 * n * own..9 * n * (own + 1)], numbers(&covariances));
    }
}

impl Sequence {
    /// Room for the results of these frames.
    fn blank(frames: &[Frame], refiner: &Refiner) -> Result<Self> {
        let bones = refiner.bones();
        let n = frames.iter().map(|frame| frame.detections.n_joints()).sum::<usize>();
        Ok(Self {
            frames: Refinements::room(frames, refiner)?,
            velocity: vec![0.0; 3 * n],
            velocity_covariance: vec![0.0; 9 * n],
            lengths: vec![UNKNOWN; bones.len()],
            bones: bones.to_vec(),
        })
    }

    /// The parts of the windows.
    fn places(&mut self, windows: &[Window]) -> Vec<Place<'_>> {
        let n = self.velocity.len() / (3 * self.frames.len());
        let mut frames = self.frames.part();
        let (mut velocity, mut covariance) =
            (self.velocity.as_mut_slice(), self.velocity_covariance.as_mut_slice());
        let place = |window: &Window| Place {
            frames: frames.take(window.own.len()),
            velocity: first(&mut velocity, 3 * n * window.own.len()),
            velocity_covariance: first(&mut covariance, 9 * n * window.own.len()),
        };
        windows.iter().map(place).collect()
    }
}

/// H, minus the gradient, and the process noise of a step.
pub type Equations = (Vec<f64>, Vec<Vector3<f64>>, Vec<f64>);

/// The equations of one step at `points` `(N, T)` under kernels `wider` than the final ones: H,
/// row-major, and minus the gradient `(N, T)`, joint after joint, and the process noise `(N, T)`.
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
    let mut tracks = Tracks::new(&[&alone?], frames_in(BRIDGE, common.fps), common.sigma[0]);
    common.bones = refiner.bones().to_vec();
    common.process_noise = process_noise::learn(&tracks, common.fps, &common.variance);
    tracks.process_noise =
        process_noise::local(&tracks, common.fps, &common.bones, &common.process_noise);
    let mut run = WindowSolver::new(&tracks, &common, Some(points));
    run.linearise(wider);
    Ok((run.system.dense(), run.system.pulls, tracks.process_noise))
}

//! A recording in windows: what is common to all is learnt from a sample of them, then each is
//! solved.

use std::ops::RangeInclusive;

use nalgebra::Vector3;
use rayon::prelude::*;

use super::learn::{Known, Learnt};
use super::noise::DetectionNoise;
use super::outcome::{Answer, SolvedWindow, errors};
use super::path::{Path, Recording};
use super::posterior::posterior;
use super::process_noise;
use super::scales::{Residuals, TAKEN};
use super::size::body_size;
use super::solver::{Common, SETTLE, WindowSolver};
use super::times::{BRIDGE, frames_in};
use super::tracks::Tracks;
use super::windows::{Window, sample, window_size, windows};
use crate::annealed::Alone;
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
            let own: Vec<Answer> = (0..tracks.joints).map(|j| alone[k].joint(j)).collect();
            let start = alone[k].points.clone();
            let (outcome, bars) = state.outcome(k, &own, start, used, steps);
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

//! A recording in windows: what is common to all is learnt from a sample of them, then each is solved.

use std::ops::{Range, RangeInclusive};

use nalgebra::Vector3;
use rayon::prelude::*;

use super::agility;
use super::learn;
use super::noise::Noise;
use super::outcome::{Learnt, State, errors};
use super::posterior::{Posterior, posterior};
use super::small::{frames_in, median};
use super::solver::{ANNEAL, Common, Run, SETTLE};
use super::swaps::{self, Swap};
use super::tracks::{BRIDGE, Tracks};
use crate::annealed::Alone;
use crate::annealed::posterior::Body;
use crate::batch::Progress;
use crate::bones::Length;
use crate::error::{Error, Result};
use crate::refine::results::{Part, first, numbers, put};
use crate::refine::{Frame, Method, Refinements, Refiner};
use crate::threads;

/// Frames per second that can be computed with.
const RATES: RangeInclusive<f64> = 1e-3..=1e6;
/// Overlap of windows on either side, s, and the least number of frames.
const OVERLAP: f64 = 2.0;
const LEAST_OVERLAP: usize = 30;
/// Length of a window, in overlaps, without them.
const WINDOW: usize = 20;
/// Number of windows from which is learnt.
const SAMPLE: usize = 3;
/// Least spread of a body in multiples of the noise, and the spread where nothing is known, mm.
pub(super) const LEAST_SPREAD: f64 = 2.0;
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

/// Refines the frames of one motion, recorded `fps` times per second, in order and without leaving frames out.
///
/// # Errors
/// [`Error::InvalidInput`] if views or joints do not match, if `fps` is not from 1e-3 to 1e6, or for another method than `annealed`;
/// [`Error::Cancelled`] once cancelled.
pub fn refine_sequence(
    refiner: &Refiner,
    frames: &[Frame],
    fps: f64,
    progress: &Progress,
) -> Result<Sequence> {
    let overlap = frames_in(OVERLAP, fps).max(LEAST_OVERLAP);
    refine_in_windows(refiner, frames, fps, [WINDOW.saturating_mul(overlap), overlap], progress)
}

/// [`refine_sequence`] in windows of at most this length, which overlap by so many frames on either side.
///
/// # Errors
/// As [`refine_sequence`].
pub fn refine_in_windows(
    refiner: &Refiner,
    frames: &[Frame],
    fps: f64,
    [length, overlap]: [usize; 2],
    progress: &Progress,
) -> Result<Sequence> {
    check(refiner, fps, "'annealed' for a sequence")?;
    let windows = windows(frames.len(), length, overlap);
    let recording = Recording { refiner, frames, fps, windows, progress };
    threads::install(refiner.config().n_threads, |_| recording.solve())
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
    windows: Vec<Window>,
    progress: &'a Progress,
}

/// Tracks with their sides corrected, and the path found in them.
struct Path {
    tracks: Tracks,
    swapped: Vec<Swap>,
    points: Vec<Vector3<f64>>,
    steps: usize,
}

/// A window: the frames it answers for, and those it looks at.
#[derive(Debug, Clone)]
struct Window {
    own: Range<usize>,
    all: Range<usize>,
}

/// Where the frames of a window are written.
struct Place<'a> {
    frames: Part<'a>,
    velocity: &'a mut [f64],
    velocity_covariance: &'a mut [f64],
}

impl Recording<'_> {
    fn solve(&self) -> Result<Sequence> {
        let mut out = Sequence::blank(self.frames, self.refiner)?;
        if self.windows.is_empty() {
            return Ok(out);
        }
        let sample = spread_out(&self.windows);
        let alone: Result<Vec<Vec<Alone>>> = sample.iter().map(|range| self.alone(range)).collect();
        let alone = alone?;
        let (learnt, first, path) = self.learn(&alone)?;
        let mut places = out.places(&self.windows);
        let errors: Result<Vec<Vec<f64>>> = match self.windows.as_slice() {
            [window] => {
                let place = places.remove(0);
                self.finish(window, &alone[0], path, &learnt, place).map(|errors| vec![errors])
            }
            windows => {
                drop((alone, path));
                let jobs = windows.par_iter().zip(places);
                jobs.map(|(window, place)| self.window(window, &first, &learnt, place)).collect()
            }
        };
        out.lengths = self.lengths(&errors?, &learnt);
        Ok(out)
    }

    /// The bones' lengths, in the unit of the cameras, with the median of the `errors` in each window.
    fn lengths(&self, errors: &[Vec<f64>], learnt: &Learnt) -> Vec<Length> {
        let mm = self.refiner.unit().millimetres();
        let one = |(b, length): (usize, &Length)| {
            let finite = errors.iter().map(|of_window| of_window[b]).filter(|e| e.is_finite());
            match median(finite.collect()) {
                error if error.is_finite() => Length { mean: length.mean / mm, sigma: error / mm },
                _ => UNKNOWN,
            }
        };
        learnt.common.lengths.iter().enumerate().map(one).collect()
    }

    fn alone(&self, frames: &Range<usize>) -> Result<Vec<Alone>> {
        let one = |frame: &Frame| {
            self.progress.check()?;
            self.refiner.alone(frame)
        };
        self.frames[frames.clone()].par_iter().map(one).collect()
    }

    fn tracks(&self, stretches: &[&[Alone]], sigma: f64) -> Tracks {
        Tracks::new(stretches, frames_in(BRIDGE, self.fps), sigma)
    }

    fn check(&self) -> impl Fn() -> Result<()> {
        || self.progress.check()
    }

    /// What is common to all windows, from the frames of some of them, what was known before their path, and the path. Windows find theirs
    /// with the same knowledge: where two paths are as good, they take the same.
    fn learn(&self, sample: &[Vec<Alone>]) -> Result<(Learnt, Common, Path)> {
        let all = || sample.iter().flatten();
        let noise = median(all().map(|f| f.noise).filter(|n| n.is_finite()).collect());
        let noise = if noise.is_finite() { noise } else { 1.0 };
        let weights = all().filter(|f| f.noise.is_finite()).map(|f| f.rays.mean_weight());
        let weight = Some(median(weights.collect())).filter(|w| w.is_finite()).unwrap_or(1.0);
        let spread = median(all().filter_map(|f| Body::spread(&f.points)).collect());
        let sigma = self.refiner.final_kernels(sample[0][0].points.len(), noise);
        let stretches: Vec<&[Alone]> = sample.iter().map(Vec::as_slice).collect();
        let tracks = self.tracks(&stretches, sigma[0]);
        let variance = vec![noise * noise; tracks.joints];
        let (bones, expected) = (self.refiner.bones().to_vec(), self.refiner.expected());
        let mut common = Common {
            fps: self.fps,
            lengths: learn::lengths(&tracks, &tracks.alone, &bones, expected),
            agility: agility::learn(&tracks, self.fps, &variance),
            bones,
            weight,
            variance: vec![noise * noise * weight; tracks.joints],
            sigma,
            reach: if spread > LEAST_SPREAD * noise { spread } else { USUAL_SPREAD },
        };
        let mut path = self.path(tracks, &common)?;
        let first = common.clone();
        common.lengths = learn::lengths(&path.tracks, &path.points, &common.bones, expected);
        let mut run = Run::new(&path.tracks, &common, Some(std::mem::take(&mut path.points)));
        run.anneal(SETTLE, &self.check())?;
        run.linearise(1.0);
        let Noise { variance, memory } = Noise::of(&run, &path.tracks, &common);
        let given = self.refiner.config().detection_sigma_px.is_some();
        let variance = if given { common.variance.clone() } else { variance };
        path.steps += run.n_iter;
        path.points = run.points;
        Ok((Learnt { common: Common { variance, ..common }, memory }, first, path))
    }

    /// The path from wide kernels down to the final ones, and the sides that it shows to be swapped.
    fn path(&self, mut tracks: Tracks, common: &Common) -> Result<Path> {
        let chains = self.refiner.chains();
        let mut swapped = swaps::exchanged(&tracks, chains, common);
        swaps::exchange(&mut tracks, chains, &swapped);
        tracks.find_cuts(common.fps, &common.usual());
        tracks.agility = agility::local(&tracks, common.fps, &common.bones, &common.agility);
        let mut run = Run::new(&tracks, common, None);
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

    fn window(
        &self,
        window: &Window,
        first: &Common,
        learnt: &Learnt,
        place: Place<'_>,
    ) -> Result<Vec<f64>> {
        let alone = self.alone(&window.all)?;
        let tracks = self.tracks(&[&alone], learnt.common.sigma[0]);
        let path = self.path(tracks, first)?;
        self.finish(window, &alone, path, learnt, place)
    }

    /// Writes the solution along a path, with its error bars, and returns the standard errors of the bones' lengths, mm; infinite for
    /// a bone that is not seen.
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
                exchange(&mut used[swap.frame][of_view.clone()], *pair);
            }
        }
        let mut run = Run::new(&tracks, &learnt.common, Some(points));
        run.anneal(SETTLE, &self.check())?;
        run.linearise(1.0);
        let found = posterior(&run, &tracks, &learnt.common, &learnt.memory);
        let errors = errors(&run, &found, &tracks, &learnt.common);
        let steps = steps + run.n_iter;
        let state = State { run: &run, tracks: &tracks, learnt, posterior: &found };
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

/// Gives the detections of one view that were used for `l` to `r`, and the other way round.
fn exchange(used: &mut [usize], [l, r]: [usize; 2]) {
    for joint in used {
        *joint = match *joint {
            j if j == l => r,
            j if j == r => l,
            j => j,
        };
    }
}

/// H, minus the gradient, and the agility of a step.
pub type Equations = (Vec<f64>, Vec<Vector3<f64>>, Vec<f64>);

/// The equations of one step at `points` `(N, T)` under kernels `wider` than the final ones: H, row-major, and minus the gradient
/// `(N, T)`, joint after joint, and the agility `(N, T)`. `common` is used with the bones of the refiner and the agility of the frames.
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
    common.agility = agility::learn(&tracks, common.fps, &common.variance);
    tracks.agility = agility::local(&tracks, common.fps, &common.bones, &common.agility);
    let mut run = Run::new(&tracks, &common, Some(points));
    run.linearise(wider);
    Ok((run.system.dense(), run.system.pulls, tracks.agility))
}

/// Windows over `n` frames of at most `length`, that overlap by `overlap` on either side.
fn windows(n: usize, length: usize, overlap: usize) -> Vec<Window> {
    let count = n.div_ceil(length);
    let cut = |k: usize| k * n / count;
    let window = |k: usize| {
        let own = cut(k)..cut(k + 1);
        let all = own.start.saturating_sub(overlap)..(own.end + overlap).min(n);
        Window { own, all }
    };
    (0..count).map(window).collect()
}

/// The frames of at most [`SAMPLE`] windows, evenly spread; those that overlap in one.
fn spread_out(windows: &[Window]) -> Vec<Range<usize>> {
    let n = windows.len().min(SAMPLE);
    let mut out: Vec<Range<usize>> = Vec::new();
    for k in 0..n {
        let next = &windows[(2 * k + 1) * windows.len() / (2 * n)].all;
        match out.last_mut() {
            Some(last) if next.start <= last.end => last.end = next.end,
            _ => out.push(next.clone()),
        }
    }
    out
}

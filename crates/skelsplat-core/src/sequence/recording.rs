//! A recording in windows: what is common to all is learnt from a sample of them, then each is solved.

use std::ops::{Range, RangeInclusive};

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::learn;
use super::noise::{Memory, Noise};
use super::posterior::{Posterior, posterior};
use super::small::median;
use super::solver::{ANNEAL, Common, Run, SETTLE, frames_in};
use super::swaps::{self, Swap};
use super::tracks::Tracks;
use crate::annealed::Alone;
use crate::annealed::consensus::REJECTED;
use crate::annealed::depth::determine;
use crate::batch::Progress;
use crate::bones::Length;
use crate::error::{Error, Result};
use crate::outcome::{ErrorBars, JointStatus, Loss, Outcome, Splats, StopReason};
use crate::refine::{Frame, Method, Refinement, Refiner};
use crate::threads;

/// Frames per second that can be computed with.
const RATES: RangeInclusive<f64> = 1e-3..=1e6;
/// Longest gap over which a joint is bridged, s.
pub(super) const BRIDGE: f64 = 1.0;
/// Overlap of windows on either side, s, and the least number of frames.
const OVERLAP: f64 = 2.0;
const LEAST_OVERLAP: usize = 30;
/// Length of a window, in overlaps, without them.
const WINDOW: usize = 20;
/// Number of windows from which is learnt.
const SAMPLE: usize = 3;
/// Largest standard deviation of an inferred joint, as a share of the body's spread.
pub(super) const INFERRED: f64 = 0.25;
/// Least spread of a body in multiples of the noise, and the spread where nothing is known, mm.
pub(super) const LEAST_SPREAD: f64 = 2.0;
pub(super) const USUAL_SPREAD: f64 = 500.0;

/// A refined recording, in the unit of the cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct Sequence {
    /// The frames; `init_pose` is the pose of each frame alone.
    pub frames: Vec<Refinement>,
    /// Velocities `(T, N)`, unit/s; NaN where unknown.
    pub velocity: Vec<Vec<Vector3<f64>>>,
    /// Their covariances `(T, N)`.
    pub velocity_covariance: Vec<Vec<Matrix3<f64>>>,
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
pub(super) fn check(refiner: &Refiner, fps: f64, expected: &str) -> Result<()> {
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

/// What is learnt from the sample.
pub(super) struct Learnt {
    pub(super) common: Common,
    pub(super) memory: Memory,
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

/// A solved window.
struct Solved {
    frames: Vec<SolvedFrame>,
    /// Standard errors of the bones' lengths, mm; infinite for a bone that is not seen.
    errors: Vec<f64>,
}

/// A frame of a solved window.
struct SolvedFrame {
    refinement: Refinement,
    velocity: Vec<Vector3<f64>>,
    velocity_covariance: Vec<Matrix3<f64>>,
}

impl Recording<'_> {
    fn solve(&self) -> Result<Sequence> {
        let bones = self.refiner.bones().to_vec();
        if self.windows.is_empty() {
            return Ok(Sequence::empty(bones));
        }
        let sample = spread_out(&self.windows);
        let alone: Result<Vec<Vec<Alone>>> = sample.iter().map(|range| self.alone(range)).collect();
        let alone = alone?;
        let (learnt, path) = self.learn(&alone)?;
        let solved: Result<Vec<Solved>> = match self.windows.as_slice() {
            [window] => self.finish(window, &alone[0], path, &learnt).map(|solved| vec![solved]),
            _ => self.windows.par_iter().map(|window| self.window(window, &learnt)).collect(),
        };
        Ok(self.joined(solved?, &learnt))
    }

    /// The windows' frames as one sequence.
    fn joined(&self, windows: Vec<Solved>, learnt: &Learnt) -> Sequence {
        let mm = self.refiner.unit().millimetres();
        let mut out = Sequence::empty(learnt.common.bones.clone());
        for (b, length) in learnt.common.lengths.iter().enumerate() {
            let errors = windows.iter().map(|window| window.errors[b]).filter(|e| e.is_finite());
            let error = Some(median(errors.collect())).filter(|e| e.is_finite());
            if let Some(error) = error {
                out.lengths[b] = Length { mean: length.mean / mm, sigma: error / mm };
            }
        }
        for frame in windows.into_iter().flat_map(|window| window.frames) {
            out.frames.push(frame.refinement);
            out.velocity.push(frame.velocity);
            out.velocity_covariance.push(frame.velocity_covariance);
        }
        out
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

    /// What is common to all windows, and the path, from the frames of some of them.
    fn learn(&self, sample: &[Vec<Alone>]) -> Result<(Learnt, Path)> {
        let all = || sample.iter().flatten();
        let noise = median(all().map(|f| f.noise).filter(|n| n.is_finite()).collect());
        let noise = if noise.is_finite() { noise } else { 1.0 };
        let weights = all().filter(|f| f.noise.is_finite()).map(|f| f.rays.mean_weight());
        let weight = Some(median(weights.collect())).filter(|w| w.is_finite()).unwrap_or(1.0);
        let spread = median(all().filter_map(|f| spread(&f.points)).collect());
        let sigma = self.refiner.final_kernels(sample[0][0].points.len(), noise);
        let stretches: Vec<&[Alone]> = sample.iter().map(Vec::as_slice).collect();
        let tracks = self.tracks(&stretches, sigma[0]);
        let bones = self.refiner.bones().to_vec();
        let mut common = Common {
            fps: self.fps,
            lengths: learn::lengths(&tracks, &tracks.alone, &bones),
            agility: learn::agility(&tracks, self.fps, &vec![noise * noise; tracks.joints]),
            bones,
            weight,
            variance: vec![noise * noise * weight; tracks.joints],
            sigma,
            reach: if spread > LEAST_SPREAD * noise { spread } else { USUAL_SPREAD },
        };
        let mut path = self.path(tracks, &common)?;
        common.lengths = learn::lengths(&path.tracks, &path.points, &common.bones);
        let mut run = Run::new(&path.tracks, &common, Some(std::mem::take(&mut path.points)));
        run.anneal(SETTLE, &self.check())?;
        let Noise { variance, memory } = Noise::of(&run, &path.tracks, &common);
        let given = self.refiner.config().detection_sigma_px.is_some();
        let variance = if given { common.variance.clone() } else { variance };
        path.steps += run.n_iter;
        path.points = run.points;
        Ok((Learnt { common: Common { variance, ..common }, memory }, path))
    }

    /// The path from wide kernels down to the final ones, and the sides that it shows to be swapped.
    fn path(&self, mut tracks: Tracks, common: &Common) -> Result<Path> {
        let chains = self.refiner.chains();
        let mut swapped = swaps::exchanged(&tracks, chains, common);
        swaps::exchange(&mut tracks, chains, &swapped);
        tracks.find_cuts(common.fps, &common.agility);
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

    fn window(&self, window: &Window, learnt: &Learnt) -> Result<Solved> {
        let alone = self.alone(&window.all)?;
        let tracks = self.tracks(&[&alone], learnt.common.sigma[0]);
        let path = self.path(tracks, &learnt.common)?;
        self.finish(window, &alone, path, learnt)
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
            for pair in &self.refiner.chains()[swap.chain] {
                exchange(&mut used[swap.frame][of_view.clone()], *pair);
            }
        }
        let mut run = Run::new(&tracks, &learnt.common, Some(points));
        run.anneal(SETTLE, &self.check())?;
        let found = posterior(&run, &tracks, &learnt.common, &learnt.memory);
        let errors = errors(&run, &found, &tracks, &learnt.common);
        let steps = steps + run.n_iter;
        let state = State { run: &run, tracks: &tracks, learnt, posterior: &found };
        let solved = |t: usize| {
            let k = t - window.all.start;
            self.progress.advance();
            self.solved(&state, &self.frames[t], k, &alone[k], std::mem::take(&mut used[k]), steps)
        };
        Ok(Solved { frames: window.own.clone().map(solved).collect(), errors })
    }

    fn solved(
        &self,
        state: &State<'_>,
        frame: &Frame,
        t: usize,
        alone: &Alone,
        used_for: Vec<usize>,
        n_iter: usize,
    ) -> SolvedFrame {
        let mm = self.refiner.unit().millimetres();
        let (outcome, bars) = state.outcome(t, alone, used_for, n_iter);
        let of = |j: usize| j * state.tracks.frames + t;
        let n = 0..alone.points.len();
        SolvedFrame {
            refinement: self.refiner.result(&frame.detections, outcome, &bars),
            velocity: n.clone().map(|j| state.posterior.velocities[of(j)] / mm).collect(),
            velocity_covariance: n
                .map(|j| state.posterior.of_velocities[of(j)] / (mm * mm))
                .collect(),
        }
    }
}

impl Sequence {
    fn empty(bones: Vec<[usize; 2]>) -> Self {
        let nothing = Length { mean: f64::NAN, sigma: f64::INFINITY };
        Self {
            frames: Vec::new(),
            velocity: Vec::new(),
            velocity_covariance: Vec::new(),
            lengths: vec![nothing; bones.len()],
            bones,
        }
    }
}

/// A solved window.
pub(super) struct State<'a> {
    pub(super) run: &'a Run<'a>,
    pub(super) tracks: &'a Tracks,
    pub(super) learnt: &'a Learnt,
    pub(super) posterior: &'a Posterior,
}

/// A joint of a frame.
struct Joint {
    at: Vector3<f64>,
    covariance: Matrix3<f64>,
    /// k of every view; NaN where missing.
    believed: Vec<f64>,
    status: JointStatus,
    loss: f64,
}

impl State<'_> {
    /// Frame `t`, and its error bars.
    pub(super) fn outcome(
        &self,
        t: usize,
        alone: &Alone,
        used_for: Vec<usize>,
        n_iter: usize,
    ) -> (Outcome, ErrorBars) {
        let joints: Vec<Joint> = (0..alone.points.len()).map(|j| self.joint(j, t, alone)).collect();
        let status: Vec<JointStatus> = joints.iter().map(|joint| joint.status).collect();
        let observed = status.iter().any(|s| *s != JointStatus::Unobserved);
        let outcome = Outcome {
            points: joints.iter().map(|joint| joint.at).collect(),
            splats: Splats::Round(self.learnt.common.sigma.clone()),
            init: alone.points.clone(),
            status: status.clone(),
            used_for,
            loss: self.loss(&joints),
            loss_history: Vec::new(),
            n_iter,
            stop_reason: if observed { StopReason::Converged } else { StopReason::NoObservations },
        };
        let variance = median(self.learnt.common.variance.clone());
        let bars = ErrorBars {
            covariances: joints.iter().map(|joint| joint.covariance).collect(),
            believed: joints.iter().flat_map(|joint| joint.believed.iter().copied()).collect(),
            noise: if observed { (variance / self.learnt.common.weight).sqrt() } else { f64::NAN },
            status,
        };
        (outcome, bars)
    }

    fn joint(&self, j: usize, t: usize, alone: &Alone) -> Joint {
        let k = j * self.tracks.frames + t;
        let common = &self.learnt.common;
        let rays = self.tracks.rays(j, t);
        let active = self.tracks.active[k];
        let (at, covariance) = match active {
            true => (self.run.points[k], self.posterior.positions[k] + self.undecided(j, t, alone)),
            false => (alone.points[j], alone.spread[j]),
        };
        let offsets = || rays.iter().map(|ray| ray.is_there().then(|| (ray, ray.offset(&at))));
        let believed: Vec<f64> = offsets()
            .map(|offset| offset.map_or(f64::NAN, |(_, o)| o.weight(common.sigma[j])))
            .collect();
        let agreeing = believed.iter().filter(|k| **k >= REJECTED).count();
        let ranges = offsets().flatten().map(|(ray, o)| o.range.abs() * ray.pixel);
        let pixel = ranges.clone().sum::<f64>() / ranges.count().max(1) as f64;
        let variance = common.variance[j] / (pixel * pixel);
        let fixed = agreeing > 1 && determine(rays, &at, variance, common.weight, |i| believed[i]);
        let widest = covariance.symmetric_eigenvalues().max().sqrt();
        let status = match (active, fixed) {
            (false, _) => alone.status[j],
            (true, true) => JointStatus::Ok,
            (true, false) if widest <= INFERRED * common.reach => JointStatus::Inferred,
            (true, false) => JointStatus::Weak,
        };
        let scale = 2.0 * common.sigma[j].powi(2) / common.variance[j];
        let terms = rays.iter().zip(&believed).filter(|(ray, k)| ray.is_there() && k.is_finite());
        let loss = terms.map(|(ray, k)| ray.weight * scale * (1.0 - k)).sum();
        Joint { at, covariance, believed, status, loss }
    }

    /// What a joint's covariance in its frame alone adds where no frame around shows it to enough views: its bone then allows two
    /// places on the ray, and all frames may have taken the wrong one.
    fn undecided(&self, j: usize, t: usize, alone: &Alone) -> Matrix3<f64> {
        let around = frames_in(BRIDGE, self.learnt.common.fps);
        let (first, last) = (t.saturating_sub(around), (t + around + 1).min(self.tracks.frames));
        let of_joint = j * self.tracks.frames..(j + 1) * self.tracks.frames;
        let shown = self.tracks.sure[of_joint][first..last].iter().any(|sure| *sure);
        let spread = alone.spread[j];
        if shown || !spread[(0, 0)].is_finite() { Matrix3::zeros() } else { spread }
    }

    fn loss(&self, joints: &[Joint]) -> Loss {
        let render = joints.iter().map(|joint| joint.loss).sum();
        Loss { total: render, render, symmetry: 0.0 }
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

/// Standard errors of the bones' lengths, mm: those of a typical frame, since most of an error lasts.
fn errors(run: &Run<'_>, found: &Posterior, tracks: &Tracks, common: &Common) -> Vec<f64> {
    let t = tracks.frames;
    let of_bone = |(b, [head, tail]): (usize, &[usize; 2])| {
        let along = |k: usize| {
            let u = run.system.lengths[b * t + k].along;
            let spread = found.positions[head * t + k] + found.positions[tail * t + k];
            u.dot(&(spread * u)).sqrt()
        };
        let seen = |k: &usize| tracks.sure[head * t + k] && tracks.sure[tail * t + k];
        let all: Vec<f64> = (0..t).filter(seen).map(along).filter(|e| e.is_finite()).collect();
        if all.is_empty() { f64::INFINITY } else { median(all) }
    };
    common.bones.iter().enumerate().map(of_bone).collect()
}

/// Root mean square distance of the joints from their centre; `None` with fewer than three.
pub(super) fn spread(points: &[Vector3<f64>]) -> Option<f64> {
    let known: Vec<&Vector3<f64>> = points.iter().filter(|x| x.x.is_finite()).collect();
    let n = known.len() as f64;
    let middle = known.iter().copied().sum::<Vector3<f64>>() / n;
    let square = known.iter().map(|x| (*x - middle).norm_squared()).sum::<f64>() / n;
    (known.len() > 2).then(|| square.sqrt())
}

/// The equations of one step at `points` `(N, T)` under kernels `wider` than the final ones: H, row-major, and minus the gradient
/// `(N, T)`, joint after joint. `common` is used with the bones of the refiner.
///
/// # Errors
/// [`Error::InvalidInput`] if a frame does not match the refiner.
pub fn equations(
    refiner: &Refiner,
    frames: &[Frame],
    points: Vec<Vector3<f64>>,
    mut common: Common,
    wider: f64,
) -> Result<(Vec<f64>, Vec<Vector3<f64>>)> {
    let alone: Result<Vec<Alone>> = frames.iter().map(|frame| refiner.alone(frame)).collect();
    let tracks = Tracks::new(&[&alone?], frames_in(BRIDGE, common.fps), common.sigma[0]);
    common.bones = refiner.bones().to_vec();
    let mut run = Run::new(&tracks, &common, Some(points));
    run.linearise(wider);
    Ok((run.system.dense(), run.system.pulls))
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

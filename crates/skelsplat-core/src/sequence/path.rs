//! The path of a recording or window, from wide kernels down to the final ones, and what all frames
//! have in common along it.

use nalgebra::Vector3;

use super::lasting::memories;
use super::learn::{self, Known, Learnt};
use super::noise::{DetectionNoise, Kernel};
use super::process_noise;
use super::scales::{Residuals, TAKEN};
use super::size::USUAL_SPREAD;
use super::solver::{Common, NARROW, NARROWEST, SETTLE, WIDE, WindowSolver};
use super::swaps::{self, FrameSwap};
use super::times::{BRIDGE, frames_in};
use super::tracks::Tracks;
use crate::annealed::Alone;
use crate::annealed::posterior::{BodyExtent, LEAST_SPREAD};
use crate::batch::Progress;
use crate::error::Result;
use crate::refine::{Frame, Refiner};
use crate::statistics::median;

/// A recording to be solved.
pub(super) struct Recording<'a> {
    pub(super) refiner: &'a Refiner,
    pub(super) frames: &'a [Frame],
    pub(super) fps: f64,
    pub(super) progress: &'a Progress,
}

/// Tracks with their sides corrected, and the path found in them.
pub(super) struct Path {
    pub(super) tracks: Tracks,
    pub(super) swapped: Vec<FrameSwap>,
    pub(super) points: Vec<Vector3<f64>>,
    pub(super) steps: usize,
}

impl Recording<'_> {
    pub(super) fn tracks(&self, stretches: &[&[Alone]], noise: &DetectionNoise) -> Tracks {
        Tracks::new(stretches, frames_in(BRIDGE, self.fps), noise)
    }

    /// What is common to all windows, from the frames of some of them, and their path.
    pub(super) fn learn(&self, sample: &[Vec<Alone>]) -> Result<(Known, Path)> {
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
    pub(super) fn path(
        &self,
        tracks: Tracks,
        first: Common,
        known: Option<&Known>,
    ) -> Result<(Known, Path)> {
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

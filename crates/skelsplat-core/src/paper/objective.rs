//! L_opt = L_render + λ_sym L_sym of a skeleton, and its gradient in every parameter (paper §3).
//!
//! L_render is, per view, the mean of (render − pseudo)² over the union mask of all its channels,
//! then the mean over the step's views that have any pixel (DESIGN §2). The closed form takes the
//! integral over the plane instead, divided by the area of the targets' ellipses a ≥ 1/255, which
//! the mask has where render and target agree.

use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use rayon::prelude::*;

use super::composite::{self, Composite};
use super::encoding::Encoding;
use super::masked_l2::{self, Moments};
use super::pseudo_gt::HeatMap;
use super::rows::Pixel;
use super::settings::{PaperSettings, Renderer};
use super::splat::{CUT, Splat};
use crate::detections::Detections;
use crate::error::{Result, unless_cancelled};
use crate::gaussian::{Gaussian, GaussianGradient};
use crate::memory;
use crate::outcome::Loss;
use crate::overlap::PlaneGaussian;
use crate::projection::{Projected, View};
use crate::symmetry::{LimbPair, symmetry};

/// Pixels of pseudo ground truth from which distributing one pose's windows over threads is faster.
const PARALLEL_PIXELS: u64 = 5_000;

/// The target of a joint in a view.
#[derive(Debug, Clone)]
enum Target<P> {
    /// A heat map.
    Raster(HeatMap<P>),
    /// A Gaussian, for the closed form.
    ClosedForm(PlaneGaussian),
    /// None of its own: the detection is missing, or a part of the view's shared channel.
    None,
}

/// Value and gradient of one channel, not yet divided by its view's area.
#[derive(Debug, Clone, Copy, Default)]
struct ChannelLoss {
    /// Σ or ∫ of (R−P)².
    squared: f64,
    /// Pixels of the mask, or area of the target's ellipse a ≥ 1/255.
    area: f64,
    d_mean: Vector2<f64>,
    d_cov: Matrix2<f64>,
}

/// One joint in one view.
#[derive(Debug, Clone)]
struct Channel<P> {
    target: Target<P>,
    /// The detection's splat; `None` if it is missing or has no pixel in the image.
    detection: Option<Splat>,
    line: Vec<P>,
    projected: Option<Projected>,
    splat: Option<Splat>,
    loss: ChannelLoss,
}

/// The objective of one pose, with every buffer that an evaluation needs. Once the buffers have
/// their size, evaluations do not allocate.
#[derive(Debug, Clone)]
pub struct Objective<'a, P> {
    views: &'a [View],
    n_joints: usize,
    dilation: f64,
    encoding: Encoding,
    channels: Vec<Channel<P>>,
    composites: Vec<Composite>,
    pairs: Vec<LimbPair>,
    symmetry_weight: f64,
    parallel: bool,
    cancel: &'a AtomicBool,
    covariances: Vec<Matrix3<f64>>,
    gradient: Vec<GaussianGradient>,
}

/// The splat of a detection and the same on the plane, with the `shape` of the joint's Gaussian;
/// `None` without a pixel in the image.
fn detection(
    view: &View,
    pixel: Vector2<f64>,
    (mean, covariance): &(Vector3<f64>, Matrix3<f64>),
    dilation: f64,
) -> Option<(Splat, PlaneGaussian)> {
    let shape = view.project(mean, covariance, dilation)?.covariance;
    let splat = Splat::new(pixel, &shape, view.size)?;
    splat.covered_rows().next()?;
    Some((splat, PlaneGaussian { mean: pixel, covariance: shape }))
}

impl<P: Pixel> Channel<P> {
    fn new(found: Option<(Splat, PlaneGaussian)>, settings: &PaperSettings) -> Self {
        let target = match (&found, settings.encoding, settings.renderer) {
            (None, _, _) | (_, Encoding::Rgb | Encoding::Single, _) => Target::None,
            (Some((splat, _)), _, Renderer::Raster) => Target::Raster(HeatMap::new(splat)),
            (Some((_, gaussian)), _, Renderer::ClosedForm) => Target::ClosedForm(*gaussian),
        };
        Self {
            target,
            detection: found.map(|(splat, _)| splat),
            line: Vec::new(),
            projected: None,
            splat: None,
            loss: ChannelLoss::default(),
        }
    }

    fn is_missing(&self) -> bool {
        self.detection.is_none()
    }

    /// Projects the joint and, if it has its own channel, compares it with its target.
    fn forward(
        &mut self,
        view: &View,
        mean: &Vector3<f64>,
        covariance: &Matrix3<f64>,
        dilation: f64,
    ) {
        if self.is_missing() {
            return;
        }
        self.projected = view.project(mean, covariance, dilation);
        self.splat = self.projected.and_then(|p| Splat::new(p.mean, &p.covariance, view.size));
        match &self.target {
            Target::Raster(heat) => {
                self.loss = ChannelLoss::of_pixels(self.splat.as_ref(), heat, &mut self.line);
            }
            Target::ClosedForm(target) => {
                self.loss = ChannelLoss::of_plane(self.projected.as_ref(), target);
            }
            Target::None => {}
        }
    }
}

impl ChannelLoss {
    fn of_pixels<P: Pixel>(splat: Option<&Splat>, heat: &HeatMap<P>, line: &mut Vec<P>) -> Self {
        let Some(splat) = splat else {
            return Self { squared: heat.energy, area: heat.count.into(), ..Self::default() };
        };
        let sums = masked_l2::channel(splat, heat, line);
        let (d_mean, d_cov) = sums.moments.backward(&splat.conic, 1.0);
        Self { squared: sums.squared, area: sums.mask.into(), d_mean, d_cov }
    }

    fn of_plane(projected: Option<&Projected>, target: &PlaneGaussian) -> Self {
        // The ellipse a ≥ 1/255 has the area 2π ln 255 √|Σ|, the energy is π√|Σ|.
        let area = CUT * target.energy();
        let render = projected.map(|p| PlaneGaussian { mean: p.mean, covariance: p.covariance });
        match render.and_then(|r| r.overlap(target)) {
            None => Self { squared: target.energy(), area, ..Self::default() },
            Some(o) => Self { squared: o.loss, area, d_mean: o.d_mean, d_cov: o.d_covariance },
        }
    }
}

impl<'a, P: Pixel> Objective<'a, P> {
    /// Builds the pseudo ground truth of the `detections`, ideal pixels, in `views`, of which the
    /// means and covariances of the joints' `gaussians` `(N)`, mm, determine the shape. `parallel`
    /// allows the threads of the current pool to work on this pose. Errors:
    /// [`crate::Error::OutOfMemory`] before building it, [`crate::Error::Cancelled`] once `cancel`
    /// is set.
    pub fn new(
        views: &'a [View],
        detections: &Detections,
        gaussians: &[(Vector3<f64>, Matrix3<f64>)],
        settings: &PaperSettings,
        parallel: bool,
        cancel: &'a AtomicBool,
    ) -> Result<Self> {
        let n = gaussians.len();
        let target = |k: usize| {
            let (pixel, _) = detections.get(k / n, k % n)?;
            detection(&views[k / n], pixel, &gaussians[k % n], settings.dilation)
        };
        let found: Vec<_> = (0..views.len() * n).map(target).collect();
        check_memory::<P>(&found, n, settings, parallel)?;
        let channel = |found| unless_cancelled(cancel).map(|()| Channel::new(found, settings));
        let channels: Vec<Channel<P>> = found.into_iter().map(channel).collect::<Result<_>>()?;
        let composite = |view: &[Channel<P>]| {
            let heats: Vec<Splat> = view.iter().filter_map(|c| c.detection).collect();
            Composite::new(&heats, cancel)
        };
        let composites = match settings.encoding {
            Encoding::OneHot => Vec::new(),
            Encoding::Rgb | Encoding::Single => channels.chunks(n).map(composite).collect(),
        };
        let pixels = |c: &Channel<P>| match &c.target {
            Target::Raster(heat) => u64::from(heat.count),
            _ => 0,
        };
        Ok(Self {
            views,
            n_joints: n,
            dilation: settings.dilation,
            encoding: settings.encoding,
            parallel: parallel && channels.iter().map(pixels).sum::<u64>() >= PARALLEL_PIXELS,
            channels,
            composites,
            pairs: Vec::new(),
            symmetry_weight: 0.0,
            cancel,
            covariances: vec![Matrix3::zeros(); n],
            gradient: vec![GaussianGradient::default(); n],
        })
    }

    /// Adds `weight` · L_sym over the `pairs` whose joints are all detected somewhere.
    #[must_use]
    pub fn with_symmetry(mut self, pairs: impl Iterator<Item = LimbPair>, weight: f64) -> Self {
        let seen = |j: &usize| self.usable_views(*j) > 0;
        self.pairs = pairs.filter(|(l, r)| l.iter().chain(r).all(seen)).collect();
        self.symmetry_weight = weight;
        self
    }

    /// Number of views M.
    pub fn n_views(&self) -> usize {
        self.views.len()
    }

    /// Number of views with pseudo ground truth for joint `j`.
    pub fn usable_views(&self, j: usize) -> usize {
        self.of_joint(j).filter(|c| !c.is_missing()).count()
    }

    /// Number of views in which the splat of joint `j` overlapped its pseudo ground truth at the
    /// last evaluation.
    pub fn meeting_views(&self, j: usize) -> usize {
        let meets = |c: &&Channel<P>| match (&c.detection, &c.splat) {
            (Some(detection), Some(splat)) => detection.overlaps(splat),
            _ => false,
        };
        self.of_joint(j).filter(meets).count()
    }

    fn of_joint(&self, j: usize) -> impl Iterator<Item = &Channel<P>> {
        self.channels.iter().skip(j).step_by(self.n_joints.max(1))
    }

    /// The gradient of the last evaluation, `(N)`.
    pub fn gradient(&self) -> &[GaussianGradient] {
        &self.gradient
    }

    /// Loss and gradient of `gaussians` over the `active` views; meaningless once cancelled.
    pub fn evaluate(&mut self, gaussians: &[Gaussian], active: &[bool]) -> Loss {
        self.gradient.fill(GaussianGradient::default());
        for (covariance, g) in self.covariances.iter_mut().zip(gaussians) {
            *covariance = g.covariance();
        }
        self.forward(gaussians, active);
        let render = match self.encoding {
            Encoding::OneHot => self.one_hot_backward(gaussians, active),
            Encoding::Rgb | Encoding::Single => self.composite_backward(gaussians, active),
        };
        let (gradient, weight) = (&mut self.gradient, self.symmetry_weight);
        let add = |j: usize, g| gradient[j].mean += weight * g;
        let symmetry = symmetry(|j| gaussians[j].mean, &self.pairs, add);
        Loss { total: render + self.symmetry_weight * symmetry, render, symmetry }
    }

    fn forward(&mut self, gaussians: &[Gaussian], active: &[bool]) {
        let (views, n, covariances, dilation) =
            (self.views, self.n_joints, &self.covariances, self.dilation);
        let cancel = self.cancel;
        let forward = |(k, channel): (usize, &mut Channel<P>)| {
            if active[k / n] && !cancel.load(Ordering::Relaxed) {
                let (view, j) = (&views[k / n], k % n);
                channel.forward(view, &gaussians[j].mean, &covariances[j], dilation);
            }
        };
        if self.parallel {
            self.channels.par_iter_mut().enumerate().for_each(forward);
        } else {
            self.channels.iter_mut().enumerate().for_each(forward);
        }
    }

    /// Channels of view `i`.
    fn of_view(&self, i: usize) -> std::ops::Range<usize> {
        i * self.n_joints..(i + 1) * self.n_joints
    }

    fn one_hot_backward(&mut self, gaussians: &[Gaussian], active: &[bool]) -> f64 {
        let area = |s: &Self, i: usize| -> f64 {
            let used = s.channels[s.of_view(i)].iter().filter(|c| !c.is_missing());
            used.map(|c| c.loss.area).sum()
        };
        let shown = |s: &Self, i: &usize| active[*i] && area(s, *i) > 0.0;
        let n_shown = (0..self.views.len()).filter(|i| shown(self, i)).count();
        let mut loss = 0.0;
        for i in 0..self.views.len() {
            if !shown(self, &i) {
                continue;
            }
            let scale = 1.0 / (area(self, i) * n_shown as f64);
            for k in self.of_view(i) {
                if !self.channels[k].is_missing() {
                    let channel = self.channels[k].loss;
                    loss += scale * channel.squared;
                    let (d_mean, d_cov) = (scale * channel.d_mean, scale * channel.d_cov);
                    self.channel_backward(gaussians, k, d_mean, d_cov);
                }
            }
        }
        loss
    }

    fn composite_backward(&mut self, gaussians: &[Gaussian], active: &[bool]) -> f64 {
        let (mut losses, mut order) = (Vec::new(), Vec::new());
        for i in (0..self.views.len()).filter(|&i| active[i]) {
            let start = self.of_view(i).start;
            self.nearest_first(i, &mut order);
            let splats: Vec<Splat> =
                order.iter().filter_map(|&j| self.channels[start + j].splat).collect();
            let (squared, mask) = self.composites[i].compare(&splats, self.cancel);
            if mask > 0 {
                let mut moments = vec![Moments::default(); splats.len()];
                self.composites[i].backward(&splats, self.cancel, |at, m| moments[at] = m);
                let scale = 1.0 / f64::from(mask);
                losses.push((scale * squared, scale, start, order.clone(), moments));
            }
        }
        let views = losses.len().max(1) as f64;
        let mut loss = 0.0;
        for (value, scale, start, order, moments) in losses {
            loss += value / views;
            for (j, m) in order.iter().zip(&moments) {
                let Some(splat) = &self.channels[start + j].splat else { continue };
                let (d_mean, d_cov) = m.backward(&splat.conic, scale / views);
                self.channel_backward(gaussians, start + j, d_mean, d_cov);
            }
        }
        loss
    }

    /// Rendered joints of view `i`, by depth; at equal depth the lower index counts as nearer.
    fn nearest_first(&self, i: usize, order: &mut Vec<usize>) {
        let view = &self.channels[self.of_view(i)];
        order.clear();
        order.extend(
            (0..self.n_joints).filter(|&j| !view[j].is_missing() && view[j].splat.is_some()),
        );
        let depth = |j: &usize| view[*j].projected.map_or(f64::INFINITY, |p| p.in_camera.z);
        order.sort_by(|a, b| depth(a).total_cmp(&depth(b)));
    }

    /// Propagates the gradient from the projected mean and covariance of channel `k` to its joint.
    fn channel_backward(
        &mut self,
        gaussians: &[Gaussian],
        k: usize,
        d_mean2d: Vector2<f64>,
        d_cov2d: Matrix2<f64>,
    ) {
        let (i, j) = (k / self.n_joints, k % self.n_joints);
        let Some(projected) = &self.channels[k].projected else { return };
        let (d_mean, d_cov) =
            self.views[i].backward(projected, &self.covariances[j], &d_mean2d, &d_cov2d);
        let (d_log_scales, d_quaternion) = gaussians[j].covariance_backward(&d_cov);
        let out = &mut self.gradient[j];
        out.mean += d_mean;
        out.log_scales += d_log_scales;
        out.quaternion += d_quaternion;
    }
}

/// Rejects windows that do not fit into memory, including those of frames processed concurrently by
/// other threads.
fn check_memory<P>(
    found: &[Option<(Splat, PlaneGaussian)>],
    n_joints: usize,
    settings: &PaperSettings,
    parallel: bool,
) -> Result<()> {
    let splats = |view: &'_ [Option<(Splat, PlaneGaussian)>]| -> Vec<Splat> {
        view.iter().flatten().map(|(splat, _)| *splat).collect()
    };
    let bytes: u128 = match (settings.encoding, settings.renderer) {
        (Encoding::OneHot, Renderer::ClosedForm) => return Ok(()),
        (Encoding::OneHot, Renderer::Raster) => splats(found).iter().map(HeatMap::<P>::bytes).sum(),
        _ => found.chunks(n_joints).map(|view| composite::bytes(splats(view).iter())).sum(),
    };
    let frames = if parallel { None } else { rayon::current_thread_index() };
    let frames = frames.map_or(1, |_| rayon::current_num_threads());
    memory::check(frames as u128 * bytes, || {
        let at_once =
            if frames > 1 { format!(" ({frames} frames at once)") } else { String::new() };
        format!("heat maps: the windows of {} detections{at_once}", found.iter().flatten().count())
    })
}

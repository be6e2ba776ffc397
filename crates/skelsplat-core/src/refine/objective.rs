//! L_opt = L_render + λ_sym L_sym of a skeleton, and its gradient in every parameter (paper §3).
//!
//! L_render is, per view, the mean of (render − pseudo)² over the union mask of all its channels, then the
//! mean over the step's views that have any pixel (DESIGN §2).

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use rayon::prelude::*;

use crate::detections::Detections;
use crate::gaussian::{Gaussian, GaussianGradient};
use crate::projection::{Projected, View};
use crate::raster::composite::Composite;
use crate::raster::encoding::Encoding;
use crate::raster::masked_l2::{self, ChannelSums, Moments};
use crate::raster::pseudo_gt::HeatMap;
use crate::raster::rows::Pixel;
use crate::raster::splat::Splat;
use crate::symmetry::{LimbPair, symmetry};

/// Pixels of pseudo ground truth from which sharing one pose's windows among threads pays.
const PARALLEL_PIXELS: u32 = 5_000;

/// The loss and its terms.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Loss {
    /// L_render + λ_sym L_sym.
    pub total: f64,
    /// L_render.
    pub render: f64,
    /// L_sym, mm², without its weight.
    pub symmetry: f64,
}

/// What the skeleton is matched to: detections, and the Gaussians whose projected covariance shapes their
/// heat maps.
#[derive(Debug, Clone, Copy)]
pub struct Targets<'a> {
    /// Ideal pixels.
    pub detections: &'a Detections,
    /// Mean and covariance per joint `(N)`, mm.
    pub gaussians: &'a [(Vector3<f64>, Matrix3<f64>)],
    /// h, pixels².
    pub dilation: f64,
    /// Joint encoding.
    pub encoding: Encoding,
}

/// One joint in one view.
#[derive(Debug, Clone)]
struct Channel<P> {
    /// The detection's Gaussian; `None` where there is nothing to match.
    target: Option<Splat>,
    /// Its pixels, for the one-hot encoding.
    heat: Option<HeatMap<P>>,
    line: Vec<P>,
    projected: Option<Projected>,
    splat: Option<Splat>,
    sums: ChannelSums,
}

/// The objective of one pose, with every buffer that an evaluation needs. Nothing is allocated from one
/// evaluation to the next once the buffers have their size.
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
    covariances: Vec<Matrix3<f64>>,
    gradient: Vec<GaussianGradient>,
}

impl<P: Pixel> Channel<P> {
    fn new(view: &View, targets: &Targets<'_>, i: usize, j: usize) -> Self {
        let target = targets.detections.get(i, j).and_then(|(pixel, _)| {
            let (mean, covariance) = &targets.gaussians[j];
            let shape = view.project(mean, covariance, targets.dilation)?.covariance;
            Splat::new(pixel, &shape, view.size).filter(|s| s.covered_rows().next().is_some())
        });
        let pixels = target.filter(|_| targets.encoding == Encoding::OneHot);
        Self {
            target,
            heat: pixels.as_ref().map(HeatMap::new),
            line: Vec::new(),
            projected: None,
            splat: None,
            sums: ChannelSums::default(),
        }
    }

    /// Projects the joint; in the one-hot encoding also renders and compares it.
    fn forward(
        &mut self,
        view: &View,
        mean: &Vector3<f64>,
        covariance: &Matrix3<f64>,
        dilation: f64,
    ) {
        if self.target.is_none() {
            return;
        }
        self.projected = view.project(mean, covariance, dilation);
        self.splat = self.projected.and_then(|p| Splat::new(p.mean, &p.covariance, view.size));
        if let Some(heat) = &self.heat {
            self.sums = match &self.splat {
                Some(splat) => masked_l2::channel(splat, heat, &mut self.line),
                None => ChannelSums::unseen(heat),
            };
        }
    }
}

impl<'a, P: Pixel> Objective<'a, P> {
    /// Builds the pseudo ground truth of `targets` in `views`. `parallel` allows threads within the pose.
    #[must_use]
    pub fn new(views: &'a [View], targets: &Targets<'_>, parallel: bool) -> Self {
        let n = targets.gaussians.len();
        let channels: Vec<Channel<P>> = (0..views.len() * n)
            .map(|k| Channel::new(&views[k / n], targets, k / n, k % n))
            .collect();
        let composites = match targets.encoding {
            Encoding::OneHot => Vec::new(),
            Encoding::Rgb | Encoding::Single => channels
                .chunks(n)
                .map(|view| {
                    Composite::new(&view.iter().filter_map(|c| c.target).collect::<Vec<_>>())
                })
                .collect(),
        };
        let pixels: u32 = channels.iter().filter_map(|c| c.heat.as_ref()).map(|h| h.count).sum();
        Self {
            views,
            n_joints: n,
            dilation: targets.dilation,
            encoding: targets.encoding,
            channels,
            composites,
            pairs: Vec::new(),
            symmetry_weight: 0.0,
            parallel: parallel && pixels >= PARALLEL_PIXELS,
            covariances: vec![Matrix3::zeros(); n],
            gradient: vec![GaussianGradient::ZERO; n],
        }
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
    #[must_use]
    pub fn n_views(&self) -> usize {
        self.views.len()
    }

    /// In how many views joint `j` has pseudo ground truth.
    #[must_use]
    pub fn usable_views(&self, j: usize) -> usize {
        self.of_joint(j).filter(|c| c.target.is_some()).count()
    }

    /// In how many views the splat of joint `j` met its pseudo ground truth at the last evaluation.
    #[must_use]
    pub fn meeting_views(&self, j: usize) -> usize {
        let meets = |c: &&Channel<P>| match (&c.target, &c.splat) {
            (Some(target), Some(splat)) => target.overlaps(splat),
            _ => false,
        };
        self.of_joint(j).filter(meets).count()
    }

    fn of_joint(&self, j: usize) -> impl Iterator<Item = &Channel<P>> {
        self.channels.iter().skip(j).step_by(self.n_joints.max(1))
    }

    /// The gradient of the last evaluation, `(N)`.
    #[must_use]
    pub fn gradient(&self) -> &[GaussianGradient] {
        &self.gradient
    }

    /// Loss and gradient of `gaussians` over the `active` views.
    pub fn evaluate(&mut self, gaussians: &[Gaussian], active: &[bool]) -> Loss {
        self.gradient.fill(GaussianGradient::ZERO);
        for (covariance, g) in self.covariances.iter_mut().zip(gaussians) {
            *covariance = g.covariance();
        }
        self.forward(gaussians, active);
        let render = match self.encoding {
            Encoding::OneHot => self.one_hot_backward(gaussians, active),
            Encoding::Rgb | Encoding::Single => self.composite_backward(gaussians, active),
        };
        let symmetry = self.symmetry_backward(gaussians);
        Loss { total: render + self.symmetry_weight * symmetry, render, symmetry }
    }

    fn forward(&mut self, gaussians: &[Gaussian], active: &[bool]) {
        let (views, n, covariances, dilation) =
            (self.views, self.n_joints, &self.covariances, self.dilation);
        let one = |(k, channel): (usize, &mut Channel<P>)| {
            if active[k / n] {
                channel.forward(
                    &views[k / n],
                    &gaussians[k % n].mean,
                    &covariances[k % n],
                    dilation,
                );
            }
        };
        if self.parallel {
            self.channels.par_iter_mut().enumerate().for_each(one);
        } else {
            self.channels.iter_mut().enumerate().for_each(one);
        }
    }

    /// Channels of view `i`.
    fn of_view(&self, i: usize) -> std::ops::Range<usize> {
        i * self.n_joints..(i + 1) * self.n_joints
    }

    fn one_hot_backward(&mut self, gaussians: &[Gaussian], active: &[bool]) -> f64 {
        let used = |c: &&Channel<P>| c.target.is_some();
        let mask = |s: &Self, i: usize| -> u32 {
            s.channels[s.of_view(i)].iter().filter(used).map(|c| c.sums.mask).sum()
        };
        let shown = |s: &Self, i: &usize| active[*i] && mask(s, *i) > 0;
        let n_shown = (0..self.views.len()).filter(|i| shown(self, i)).count();
        let mut loss = 0.0;
        for i in 0..self.views.len() {
            if !shown(self, &i) {
                continue;
            }
            let scale = 1.0 / (f64::from(mask(self, i)) * count(n_shown));
            for k in self.of_view(i) {
                let sums = self.channels[k].sums;
                if self.channels[k].target.is_some() {
                    loss += scale * sums.squared;
                    self.channel_backward(gaussians, k, &sums.moments, scale);
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
            let sums = self.composites[i].compare(&splats);
            if sums.mask > 0 {
                let mut moments = vec![Moments::default(); splats.len()];
                self.composites[i].backward(&splats, |at, m| moments[at] = m);
                let scale = 1.0 / f64::from(sums.mask);
                losses.push((scale * sums.squared, scale, start, order.clone(), moments));
            }
        }
        let views = count(losses.len().max(1));
        let mut loss = 0.0;
        for (value, scale, start, order, moments) in losses {
            loss += value / views;
            for (j, m) in order.iter().zip(&moments) {
                self.channel_backward(gaussians, start + j, m, scale / views);
            }
        }
        loss
    }

    /// Joints of view `i` that are drawn, by depth; of two at one depth the lower index counts as nearer.
    fn nearest_first(&self, i: usize, order: &mut Vec<usize>) {
        let view = &self.channels[self.of_view(i)];
        order.clear();
        order.extend(
            (0..self.n_joints).filter(|&j| view[j].target.is_some() && view[j].splat.is_some()),
        );
        let depth = |j: &usize| view[*j].projected.map_or(f64::INFINITY, |p| p.in_camera.z);
        order.sort_by(|a, b| depth(a).total_cmp(&depth(b)));
    }

    /// Carries the moments of channel `k` back to the parameters of its joint.
    fn channel_backward(
        &mut self,
        gaussians: &[Gaussian],
        k: usize,
        moments: &Moments,
        scale: f64,
    ) {
        let (i, j) = (k / self.n_joints, k % self.n_joints);
        let (Some(projected), Some(splat)) = (&self.channels[k].projected, &self.channels[k].splat)
        else {
            return;
        };
        let (d_mean2d, d_cov2d): (Vector2<f64>, Matrix2<f64>) =
            moments.backward(&splat.conic, scale);
        let (d_mean, d_cov) =
            self.views[i].backward(projected, &self.covariances[j], &d_mean2d, &d_cov2d);
        let (d_log_scales, d_quaternion) = gaussians[j].covariance_backward(&d_cov);
        let out = &mut self.gradient[j];
        out.mean += d_mean;
        out.log_scales += d_log_scales;
        out.quaternion += d_quaternion;
    }

    fn symmetry_backward(&mut self, gaussians: &[Gaussian]) -> f64 {
        let (gradient, weight) = (&mut self.gradient, self.symmetry_weight);
        symmetry(|j| gaussians[j].mean, &self.pairs, |j, g| gradient[j].mean += weight * g)
    }
}

/// A small count as a double.
fn count(n: usize) -> f64 {
    f64::from(u32::try_from(n).unwrap_or(u32::MAX))
}

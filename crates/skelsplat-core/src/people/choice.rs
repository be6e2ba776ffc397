//! Ways to choose one person in a frame without a past: any two figures propose a body, and every view is asked who is there.
//!
//! A body explains a view if the median distance of its joints from those of a figure there is below the view's gate. The
//! more views it explains the better; then the smaller the error, and the larger the figures.

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;

use crate::batch::Progress;
use crate::camera::Camera;
use crate::detections::Detections;
use crate::error::Result;
use crate::threads;
use crate::triangulate::TwoViews;

/// Two equal explanations are told apart by size.
const SIZE_COST: f64 = 1e-3;
/// A pair of figures proposes nothing if their rays miss each other by this many gates, in the median.
const MISSED: f64 = 1.5;

/// What a choice depends on besides figures and cameras.
#[derive(Debug, Clone)]
pub struct Rules {
    /// Per view, the largest median distance, pixels.
    pub gates_px: Vec<f64>,
    /// Detections below it are not used.
    pub min_confidence: f64,
    /// Joints that two figures, or a body and a figure, must have in common.
    pub min_joints: usize,
    /// Place of every joint's mirror image: a figure may have left and right exchanged.
    pub mirror: Vec<usize>,
    /// Choices of a frame that are kept, and by how much they may cost more than the cheapest.
    pub most: usize,
    /// See `most`.
    pub worse: f64,
}

/// A person in a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// Slot of the figure in each view `(M,)`; `None` in a view that is not explained.
    pub slots: Vec<Option<usize>>,
    /// Views that are not explained + the median error as a part of the gate (below 1) + a little for being small.
    pub cost: f64,
    /// Joints from the two figures that proposed it `(N,)`, in the unit of the cameras; NaN where unknown.
    pub pose: Vec<Vector3<f64>>,
}

/// What a view detects in one slot.
struct Figure {
    view: usize,
    slot: usize,
    /// Pixels of the image, of the ideal camera, and confidences; NaN where missing.
    pixels: Vec<Vector2<f64>>,
    ideal: Vec<Vector2<f64>>,
    confidence: Vec<f64>,
    /// Extent as a part of the image's diagonal.
    share: f64,
}

/// The cheapest different choices of every frame, cheapest first.
///
/// `frames` have P slots of one figure per view `(M, N)`, empty ones without detections.
///
/// # Errors
/// [`crate::Error::Cancelled`].
pub fn choices(
    frames: &[Vec<Detections>],
    cameras: &[Camera],
    rules: &Rules,
    progress: &Progress,
) -> Result<Vec<Vec<Choice>>> {
    let pairs = Pairs::of(cameras);
    let one = |slots: &Vec<Detections>| {
        progress.check()?;
        Ok(of_frame(&figures(slots, cameras, rules), cameras, &pairs, rules))
    };
    threads::install(None, |parallel| match parallel {
        true => frames.par_iter().map(one).collect(),
        false => frames.iter().map(one).collect(),
    })
}

/// Two views at a time, prepared for triangulation.
struct Pairs {
    n_views: usize,
    pairs: Vec<TwoViews>,
}

impl Pairs {
    fn of(cameras: &[Camera]) -> Self {
        let n_views = cameras.len();
        let all = (0..n_views * n_views).map(|k| (k / n_views, k % n_views));
        let pairs = all.map(|(i, k)| TwoViews::new(&cameras[i], &cameras[k])).collect();
        Self { n_views, pairs }
    }

    fn get(&self, one: usize, other: usize) -> &TwoViews {
        &self.pairs[one * self.n_views + other]
    }
}

fn figures(slots: &[Detections], cameras: &[Camera], rules: &Rules) -> Vec<Figure> {
    let nowhere = (Vector2::repeat(f64::NAN), 0.0);
    let mut found = Vec::new();
    for (slot, given) in slots.iter().enumerate() {
        let used = given.above(rules.min_confidence);
        let ideal = used.undistorted(cameras);
        let n = used.n_joints();
        for (view, camera) in cameras.iter().enumerate() {
            let all = (0..n).map(|j| used.get(view, j).unwrap_or(nowhere));
            let (pixels, confidence): (Vec<Vector2<f64>>, Vec<f64>) = all.unzip();
            let known = pixels.iter().filter(|p| p.x.is_finite()).count();
            if known < rules.min_joints || known == 0 {
                continue;
            }
            let ideal = (0..n).map(|j| ideal.get(view, j).unwrap_or(nowhere).0).collect();
            let [width, height] = camera.size().map(f64::from);
            let share = extent(&pixels) / width.hypot(height);
            found.push(Figure { view, slot, pixels, ideal, confidence, share });
        }
    }
    found.sort_by_key(|figure| (figure.view, figure.slot));
    found
}

/// Diagonal of the box around the points that are known.
fn extent(points: &[Vector2<f64>]) -> f64 {
    let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(-f64::INFINITY));
    for point in points.iter().filter(|p| p.x.is_finite()) {
        (low, high) = (low.inf(point), high.sup(point));
    }
    (high - low).norm()
}

fn of_frame(figures: &[Figure], cameras: &[Camera], pairs: &Pairs, rules: &Rules) -> Vec<Choice> {
    let mut proposals: Vec<(f64, &Figure, &Figure)> = Vec::new();
    for (k, one) in figures.iter().enumerate() {
        for other in figures[k + 1..].iter().filter(|other| other.view != one.view) {
            let apart = apart(one, other, pairs.get(one.view, other.view), rules);
            proposals.extend(apart.map(|apart| (apart, one, other)));
        }
    }
    proposals.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut kept = Kept { most: rules.most, worse: rules.worse, choices: Vec::new() };
    for (_, one, other) in proposals {
        let pose = triangulated(one, other, pairs.get(one.view, other.view));
        if let Some(choice) = weighed(pose, figures, cameras, rules, kept.limit()) {
            kept.add(choice);
        }
    }
    let limit = kept.limit();
    kept.choices.retain(|choice| choice.cost <= limit);
    kept.choices
}

/// The cheapest different choices so far, cheapest first.
struct Kept {
    most: usize,
    worse: f64,
    choices: Vec<Choice>,
}

impl Kept {
    /// The cost from which a choice is of no interest.
    fn limit(&self) -> f64 {
        let cost = |k: usize| self.choices.get(k).map_or(f64::INFINITY, |choice| choice.cost);
        cost(self.most.saturating_sub(1)).min(cost(0) + self.worse)
    }

    fn add(&mut self, choice: Choice) {
        if let Some(at) = self.choices.iter().position(|other| other.slots == choice.slots) {
            if self.choices[at].cost <= choice.cost {
                return;
            }
            self.choices.remove(at);
        }
        let at = self.choices.partition_point(|other| other.cost <= choice.cost);
        self.choices.insert(at, choice);
        self.choices.truncate(self.most);
    }
}

/// By how many pixels the rays of two figures miss each other; `None` if most are further apart than a body allows.
fn apart(one: &Figure, other: &Figure, pair: &TwoViews, rules: &Rules) -> Option<f64> {
    let limit = MISSED * rules.gates_px[one.view].max(rules.gates_px[other.view]);
    let (mut near, mut far, mut sum) = (0_u32, 0_u32, 0.0);
    for (a, b) in one.ideal.iter().zip(&other.ideal) {
        let apart = pair.apart_px(a, b);
        near += u32::from(apart <= limit);
        far += u32::from(apart > limit);
        sum += if apart > limit { limit } else { apart.max(0.0) };
    }
    (near > 0 && near >= far).then(|| sum / f64::from(near + far))
}

fn triangulated(one: &Figure, other: &Figure, pair: &TwoViews) -> Vec<Vector3<f64>> {
    let joint = |j: usize| {
        pair.point([&one.ideal[j], &other.ideal[j]], [one.confidence[j], other.confidence[j]])
    };
    (0..one.ideal.len()).map(joint).collect()
}

/// The choice that a body makes; `None` if it explains fewer than two views, or costs more than `limit`.
fn weighed(
    pose: Vec<Vector3<f64>>,
    figures: &[Figure],
    cameras: &[Camera],
    rules: &Rules,
    limit: f64,
) -> Option<Choice> {
    let mut unexplained = 0.0;
    let mut best: Vec<(f64, Option<&Figure>)> = vec![(1.0, None); cameras.len()];
    let mirrored = rules.mirror.iter().enumerate().any(|(j, &image)| image != j);
    let (mut distances, mut rest) = (Vec::with_capacity(pose.len()), figures);
    while let Some(view) = rest.first().map(|figure| figure.view) {
        let here;
        (here, rest) = rest.split_at(rest.partition_point(|figure| figure.view == view));
        if unexplained > limit {
            return None;
        }
        let project = |x: &Vector3<f64>| cameras[view].project(x).filter(|p| p.x.is_finite());
        let pixels: Vec<Option<Vector2<f64>>> = pose.iter().map(project).collect();
        let gate = rules.gates_px[view];
        for figure in here {
            let mut distance = |seen: &dyn Fn(usize) -> usize| {
                let pixel = |j: usize| figure.pixels[seen(j)];
                error(&pixels, gate, rules.min_joints, &mut distances, pixel)
            };
            let own = distance(&|j| j);
            let least = if mirrored { own.min(distance(&|j| rules.mirror[j])) } else { own };
            if least < best[view].0 {
                best[view] = (least, Some(figure));
            }
        }
        unexplained += if best[view].1.is_none() { 1.0 } else { 0.0 };
    }
    let explained: Vec<&Figure> = best.iter().filter_map(|(_, figure)| *figure).collect();
    if explained.len() < 2 {
        return None;
    }
    let mut errors: Vec<f64> =
        best.iter().filter(|(_, figure)| figure.is_some()).map(|(error, _)| *error).collect();
    let size = explained.iter().map(|figure| figure.share).sum::<f64>() / explained.len() as f64;
    let views = (cameras.len() - explained.len()) as f64;
    let cost = views + median(&mut errors) + SIZE_COST * (1.0 - size);
    let slots = best.iter().map(|(_, figure)| figure.map(|f| f.slot)).collect();
    Some(Choice { slots, cost, pose })
}

/// Median distance of projected joints from a figure's, as a part of the gate; infinite from 1 on or with too few joints.
fn error(
    pixels: &[Option<Vector2<f64>>],
    gate: f64,
    min_joints: usize,
    distances: &mut Vec<f64>,
    seen: impl Fn(usize) -> Vector2<f64>,
) -> f64 {
    distances.clear();
    let mut below = 0;
    for (j, pixel) in pixels.iter().enumerate() {
        let Some(pixel) = pixel else { continue };
        let square = (seen(j) - pixel).norm_squared();
        if square.is_finite() {
            distances.push(square);
            below += usize::from(square < gate * gate);
        }
    }
    let n = distances.len();
    if n < min_joints.max(1) || below <= (n - 1) / 2 {
        return f64::INFINITY;
    }
    for square in distances.iter_mut() {
        *square = square.sqrt();
    }
    let middle = median(distances) / gate;
    if middle < 1.0 { middle } else { f64::INFINITY }
}

/// The median of at least one finite number.
fn median(values: &mut [f64]) -> f64 {
    let last = values.len() - 1;
    let (lower, high, _) = values.select_nth_unstable_by(last.div_ceil(2), f64::total_cmp);
    let high = *high;
    match last % 2 {
        0 => high,
        _ => (lower.iter().copied().fold(f64::NEG_INFINITY, f64::max) + high) / 2.0,
    }
}

//! The search in a frame.

use nalgebra::Vector3;
use rayon::prelude::*;
use wide::f64x4;

use super::figures::{Figures, LANES};
use super::kept::{Candidate, Kept};
use super::rules::{MISSED, Rules, TRIANGULATION};
use super::weigh::Hypothesis;
use crate::batch::Progress;
use crate::camera::Camera;
use crate::detections::Detections;
use crate::error::Result;
use crate::threads;
use crate::triangulate::TwoViews;

/// A person in a frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// Slot of the figure in each view `(M,)`; `None` in a view that is not explained.
    pub slots: Vec<Option<usize>>,
    /// Views that are not explained + the median error as a part of the gate (below 1) + a little
    /// for being small.
    pub cost: f64,
    /// Joints from the two figures that proposed it `(N,)`, in the unit of the cameras; NaN where
    /// unknown.
    pub pose: Vec<Vector3<f64>>,
}

/// The choices of a frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Choices {
    /// The cheapest different ones, cheapest first.
    pub all: Vec<Choice>,
    /// Whether there was too much to compare for all of it to be compared.
    pub cut: bool,
    /// Work that was done, as [`Rules::most_work`].
    pub work: usize,
}

/// The choices of every frame.
///
/// `frames` have P slots of one figure per view `(M, N)`, empty ones without detections.
/// Errors: [`crate::Error::Cancelled`].
pub fn choices(
    frames: &[Vec<Detections>],
    cameras: &[Camera],
    rules: &Rules,
    progress: &Progress,
) -> Result<Vec<Choices>> {
    let views = Views::new(cameras);
    let search_frame = |search: &mut FrameSearch, slots: &Vec<Detections>| {
        progress.check()?;
        Ok(search.frame(slots, &views, rules))
    };
    threads::install(None, |parallel| match parallel {
        true => frames.par_iter().map_init(FrameSearch::default, search_frame).collect(),
        false => {
            let mut search = FrameSearch::default();
            frames.iter().map(|slots| search_frame(&mut search, slots)).collect()
        }
    })
}

/// The cameras, and any two of them prepared for triangulation.
struct Views<'a> {
    cameras: &'a [Camera],
    pairs: Vec<TwoViews>,
}

impl<'a> Views<'a> {
    fn new(cameras: &'a [Camera]) -> Self {
        let n = cameras.len();
        let all = (0..n * n).map(|k| TwoViews::new(&cameras[k / n], &cameras[k % n]));
        Self { cameras, pairs: all.collect() }
    }

    fn pair(&self, first: usize, second: usize) -> &TwoViews {
        &self.pairs[first * self.cameras.len() + second]
    }
}

/// The search in one frame; its memory serves the next.
#[derive(Debug, Default)]
struct FrameSearch {
    figures: Figures,
    body: Hypothesis,
    proposals: Vec<PairProposal>,
    lines: Vec<[f64x4; 4]>,
    kept: Kept,
}

/// Two figures, and by how much their rays miss each other.
#[derive(Debug, Clone, Copy)]
struct PairProposal {
    apart2: f64,
    pair: [usize; 2],
}

impl FrameSearch {
    fn frame(&mut self, slots: &[Detections], views: &Views<'_>, rules: &Rules) -> Choices {
        let n = views.cameras.len();
        let groups = slots.first().map_or(1, |given| given.n_joints().div_ceil(LANES)).max(1);
        let most = rules.most_work / 4 / groups / (n * n.saturating_sub(1) / 2).max(1);
        self.figures.fill(slots, views.cameras, rules, most.isqrt().max(1));
        self.propose(views, rules);
        self.proposals.sort_by(|a, b| a.apart2.total_cmp(&b.apart2));
        self.kept.clear(rules);
        let mut cut = self.figures.cut;
        for k in 0..self.proposals.len() {
            if self.body.work >= rules.most_work {
                cut = true;
                break;
            }
            self.weigh(self.proposals[k].pair, views, rules);
        }
        let limit = self.kept.limit();
        let kept = std::mem::take(&mut self.kept.all);
        let choice = |kept: &Candidate| Choice {
            slots: kept.figures.iter().map(|k| k.map(|k| self.figures.all[k].slot)).collect(),
            cost: kept.cost,
            pose: self.pose(kept.pair, views, slots),
        };
        let all = kept.iter().filter(|kept| kept.cost <= limit).map(choice).collect();
        self.kept.all = kept;
        Choices { all, cut, work: self.body.work }
    }

    /// Proposes every pair of figures in different views if their rays meet.
    fn propose(&mut self, views: &Views<'_>, rules: &Rules) {
        self.proposals.clear();
        self.body.work = 0;
        for (k, first) in self.figures.all.iter().enumerate() {
            for view in first.view + 1..views.cameras.len() {
                let pair = views.pair(first.view, view);
                self.lines.clear();
                self.lines.extend(self.figures.seen(k).map(|seen| pair.lines(&seen)));
                let limit = MISSED * rules.gates_px[first.view].max(rules.gates_px[view]);
                self.body.work += self.figures.views[view].len() * self.figures.groups;
                for other in self.figures.views[view].clone() {
                    if let Some(apart2) = apart2(pair, &self.lines, &self.figures, other, limit) {
                        self.proposals.push(PairProposal { apart2, pair: [k, other] });
                    }
                }
            }
        }
    }

    /// Judges what two figures propose.
    fn weigh(&mut self, pair: [usize; 2], views: &Views<'_>, rules: &Rules) {
        let [first, second] = pair.map(|k| self.figures.all[k].view);
        self.body.joints.clear();
        let seen = self.figures.seen(pair[0]).zip(self.figures.seen(pair[1]));
        self.body.joints.extend(seen.map(|(a, b)| views.pair(first, second).points(&a, &b)));
        self.body.work += TRIANGULATION * self.figures.groups;
        let (figures, kept) = (&self.figures, &self.kept);
        let cost = self.body.weighed(figures, views.cameras, rules, [first, second], kept);
        if let Some(cost) = cost {
            self.kept.add(cost, pair, &self.body.figures);
        }
    }

    fn pose(&self, pair: [usize; 2], views: &Views<'_>, slots: &[Detections]) -> Vec<Vector3<f64>> {
        let [first, second] = pair.map(|k| self.figures.all[k].view);
        let seen = self.figures.seen(pair[0]).zip(self.figures.seen(pair[1]));
        let groups =
            seen.map(|(a, b)| views.pair(first, second).points(&a, &b).map(f64x4::to_array));
        let n = slots.first().map_or(0, Detections::n_joints);
        let joints = groups.flat_map(|[x, y, z]| {
            (0..LANES).map(move |lane| Vector3::new(x[lane], y[lane], z[lane]))
        });
        joints.take(n).collect()
    }
}

/// By how many pixels the rays of two figures miss each other, squared; `None` if most are further
/// apart than a body allows.
fn apart2(
    pair: &TwoViews,
    lines: &[[f64x4; 4]],
    figures: &Figures,
    other: usize,
    limit: f64,
) -> Option<f64> {
    let limit2 = f64x4::splat(limit * limit);
    let (mut near, mut far, mut sum) = (f64x4::ZERO, f64x4::ZERO, f64x4::ZERO);
    for (lines, seen) in lines.iter().zip(figures.seen(other)) {
        let apart2 = pair.apart2(lines, &seen);
        let is_near = apart2.simd_le(limit2);
        near += is_near & f64x4::ONE;
        far += apart2.simd_gt(limit2) & f64x4::ONE;
        sum += is_near & apart2;
    }
    let [near, far] = [near, far].map(f64x4::reduce_add);
    let all = sum.reduce_add() + far * limit * limit;
    (near > 0.0 && near >= far).then(|| all / (near + far))
}

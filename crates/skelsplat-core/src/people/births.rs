//! Bodies from figures that nobody claimed: pairs of views propose, all views judge.

use nalgebra::Vector3;

use super::body::{Claims, placed, views};
use super::crowd::{Crowd, Figure};
use super::known::BodyModel;
use super::score::{at_body, of_pair};
use crate::annealed::rays::{Ray, meet};
use crate::bones::population::STATURE;

/// Kernel of a proposal, as a share of that of claims: nothing is predicted.
const KERNEL: f64 = 0.7;
/// Minimum score of a figure at a body of known place, and of a pair of figures.
pub const FITS: f64 = 0.35;
/// Joints that two figures must have in common (all, if there are fewer).
pub(super) const COMMON: usize = 4;
/// Number of proposals that are judged.
const PROPOSALS: usize = 200;
/// Most pairs of figures that are compared in a frame.
const MOST_PAIRS: usize = 1_000_000;
/// Most figures that are compared with proposals in a frame.
const MOST_SCORES: usize = 1_000_000;
/// Support lost by each view that should see a body and does not.
const UNSEEN: f64 = 0.3;
/// Least support of a body.
const SUPPORT: f64 = 0.75;
/// Standard deviation of a bone's length from the population's proportions, relative.
const PROPORTION: f64 = 0.3;

/// A body that views agree on.
#[derive(Debug, Clone)]
pub struct Newcomer {
    /// Its figures.
    pub claims: Claims,
    /// Its joints `(N)`, mm; NaN where unknown.
    pub pose: Vec<Vector3<f64>>,
}

/// Which figures are free, by view and slot.
pub type Free = Vec<Vec<bool>>;

struct BodyProposal {
    pair: [(usize, usize); 2],
    pose: Vec<Vector3<f64>>,
    support: f64,
    /// Number of newcomers when it was judged.
    judged: usize,
}

/// The number with the largest value, the first of equal ones.
fn largest(values: impl Iterator<Item = (f64, usize)>) -> Option<usize> {
    values.reduce(|a, b| if b.0 > a.0 { b } else { a }).map(|(_, at)| at)
}

impl BodyModel {
    /// Newcomers among the free figures, which they take; those of the largest support first. And
    /// whether there was too much to compare for all of it to be compared.
    pub fn newcomers(&self, crowd: &Crowd, free: &mut Free) -> (Vec<Newcomer>, bool) {
        let (mut proposals, mut cut) = self.proposals(crowd, free);
        let figures = crowd.views.iter().map(Vec::len).sum::<usize>().max(1);
        let mut left = (MOST_SCORES / figures).max(PROPOSALS) - proposals.len();
        let mut found: Vec<Newcomer> = Vec::new();
        let best = |all: &[BodyProposal]| {
            largest(all.iter().enumerate().map(|(at, proposal)| (proposal.support, at)))
        };
        while let Some(at) = best(&proposals) {
            if left == 0 {
                cut = true;
                break;
            }
            left -= 1;
            // What was accepted since may have taken figures that supported this one.
            if proposals[at].judged < found.len() {
                let support = self.support(crowd, free, &proposals[at].pose);
                (proposals[at].support, proposals[at].judged) = (support, found.len());
                continue;
            }
            let proposal = proposals.swap_remove(at);
            if proposal.support < SUPPORT {
                break;
            }
            if let Some(newcomer) = self.grown(crowd, free, &proposal) {
                for (i, claim) in newcomer.claims.iter().enumerate() {
                    claim.iter().flatten().for_each(|slot| free[i][*slot] = false);
                }
                found.push(newcomer);
                proposals.retain(|p| p.pair.iter().all(|(i, slot)| free[*i][*slot]));
            }
        }
        (found, cut)
    }

    /// Pairs of figures with their bodies, those that agree best; and whether figures were left
    /// out.
    fn proposals(&self, crowd: &Crowd, free: &Free) -> (Vec<BodyProposal>, bool) {
        let sigma = KERNEL * self.sigma;
        let least = COMMON.min(crowd.n_joints);
        let n = crowd.views.len();
        let most = (MOST_PAIRS / (n * n.saturating_sub(1) / 2).max(1)).isqrt();
        let mut pairs = Vec::new();
        let figures = |i: usize| -> Vec<(usize, &Figure)> {
            let all = crowd.views[i].iter().enumerate();
            all.filter(|(slot, figure)| free[i][*slot] && figure.joints >= least).collect()
        };
        let mut figures: Vec<Vec<(usize, &Figure)>> = (0..n).map(figures).collect();
        let cut = figures.iter().any(|view| view.len() > most);
        for view in figures.iter_mut().filter(|view| view.len() > most) {
            let whole = |figure: &Figure| figure.confidence * figure.joints as f64;
            view.sort_by(|a, b| whole(b.1).total_cmp(&whole(a.1)));
            view.truncate(most);
        }
        for i in 0..n {
            for k in i + 1..n {
                for &(p, a) in &figures[i] {
                    for &(q, b) in &figures[k] {
                        let (score, common) = of_pair(a, b, sigma);
                        if score >= FITS && common >= least {
                            pairs.push((score, [(i, p), (k, q)]));
                        }
                    }
                }
            }
        }
        pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        pairs.truncate(PROPOSALS);
        let propose = |(_, pair): (f64, [(usize, usize); 2])| {
            let [a, b] = pair.map(|(i, slot)| &crowd.views[i][slot]);
            let pose = met(a, b);
            let support = self.support(crowd, free, &pose);
            BodyProposal { pair, pose, support, judged: 0 }
        };
        (pairs.into_iter().map(propose).collect(), cut)
    }

    /// Scores of all views at a body, less a penalty for those that should see it, times how human
    /// it is.
    pub fn support(&self, crowd: &Crowd, free: &Free, pose: &[Vector3<f64>]) -> f64 {
        let sigma = KERNEL * self.sigma;
        let view = |(i, figures): (usize, &Vec<Figure>)| {
            let (mut best, mut taken) = (0.0, 0.0);
            for (slot, figure) in figures.iter().enumerate().filter(|(_, f)| f.joints > 0) {
                let score = at_body(figure, pose, sigma, &self.mirror);
                let kind = if free[i][slot] { &mut best } else { &mut taken };
                *kind = f64::max(*kind, score);
            }
            match best {
                best if best >= FITS => best,
                _ if taken >= FITS || !self.sees(i, pose) => 0.0,
                _ => -UNSEEN,
            }
        };
        crowd.views.iter().enumerate().map(view).sum::<f64>() * self.human(pose)
    }

    /// Whether camera `i` has most of a body inside its image.
    pub(super) fn sees(&self, i: usize, pose: &[Vector3<f64>]) -> bool {
        let camera = &self.cameras[i];
        let [width, height] = camera.size().map(f64::from);
        let inside = |x: &&Vector3<f64>| {
            camera
                .project(&(*x / self.scale))
                .is_some_and(|p| (0.0..width).contains(&p.x) && (0.0..height).contains(&p.y))
        };
        let known = pose.iter().filter(|x| !x.x.is_nan());
        let n = known.clone().count();
        n > 0 && 2 * known.filter(inside).count() >= n
    }

    /// Mean weight of the bones, compared with the proportions of people of the stature that suits
    /// them best; 1 if none is known.
    fn human(&self, pose: &[Vector3<f64>]) -> f64 {
        let known = self.proportions.iter().map(|bone| bone.stature(pose));
        let known: Vec<f64> = known.filter(|s| s.is_finite() && *s > 0.0).collect();
        if known.len() < 3 {
            return 1.0;
        }
        let at = |s: f64| {
            let fits = |other: &f64| (-0.5 * ((other / s).ln() / PROPORTION).powi(2)).exp();
            let [mean, sigma] = STATURE;
            let usual = (-0.125 * ((s - mean) / sigma).powi(2)).exp();
            usual.max(0.01) * known.iter().map(fits).sum::<f64>() / known.len() as f64
        };
        known.iter().map(|s| at(*s)).fold(0.0, f64::max)
    }

    /// A proposal with the figures of all views that fit it, placed by all of them; `None` if less
    /// than two remain or no support.
    fn grown(&self, crowd: &Crowd, free: &Free, proposal: &BodyProposal) -> Option<Newcomer> {
        let sigma = KERNEL * self.sigma;
        let mut pose = proposal.pose.clone();
        let mut claims: Claims = Vec::new();
        for _ in 0..2 {
            let best = |(figures, free): (&Vec<Figure>, &Vec<bool>)| {
                let usable = figures.iter().enumerate().filter(|(k, f)| free[*k] && f.joints > 0);
                let scored = usable.map(|(k, f)| (at_body(f, &pose, sigma, &self.mirror), k));
                [largest(scored.filter(|(score, _)| *score >= FITS)), None]
            };
            claims = crowd.views.iter().zip(free).map(best).collect();
            if views(&claims) < 2 {
                return None;
            }
            pose = placed(crowd, &claims, &pose, sigma);
        }
        let known = pose.iter().filter(|x| !x.x.is_nan()).count();
        let enough = known >= COMMON.min(pose.len()) && self.support(crowd, free, &pose) >= SUPPORT;
        enough.then_some(Newcomer { claims, pose })
    }
}

/// The body between two figures.
pub(super) fn met(a: &Figure, b: &Figure) -> Vec<Vector3<f64>> {
    let joint = |(p, q): (&Ray, &Ray)| {
        let both = p.is_there() && q.is_there();
        both.then(|| meet(p, q)).flatten().map_or(Vector3::repeat(f64::NAN), |(x, _)| x)
    };
    a.rays.iter().zip(&b.rays).map(joint).collect()
}

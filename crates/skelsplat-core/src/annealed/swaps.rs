//! Left and right swapped in a view: found by testing hypotheses.
//!
//! A detector that mistakes the left arm for the right one swaps all joints of the arm. In units of
//! detections, view i explains Σ c k of a chain of joints; with the chain swapped, each detection
//! is compared with the other side's joint. A view is considered swapped where that explains
//! clearly more. Where no assignment explains the chain at its present position, which may then be
//! a mixture of both sides, any two views whose rays meet (with equal or opposite assignments)
//! propose another position, at which all views are evaluated.

use nalgebra::Vector3;

use super::across::FourRays;
use super::lanes::Four;
use super::rays::{self, Meeting, Rays};
use crate::layout::Layout;

/// Detections of mean weight by which a swap has to explain more, also in a recording; by less,
/// limbs that overlap differ as well. As many may a view fail to explain before it is against the
/// chain's position.
pub(crate) const GAIN: f64 = 1.0;
/// Minimum number of views: of two that contradict each other, it is impossible to tell which is
/// swapped.
const LEAST_VIEWS: usize = 3;
/// Number of views that propose positions in pairs: those with the most detections, then those that
/// explain the most.
const MOST_PROPOSERS: usize = 6;

/// (left, right) joints that a detector swaps together, from the trunk outwards: arms, legs, face.
pub type Chain = Vec<[usize; 2]>;

/// The left–right pairs of a layout, grouped by its limbs. Limbs that connect two groups (shoulder
/// to hip) are ignored.
pub fn chains(layout: &Layout) -> Vec<Chain> {
    let pairs = &layout.left_right;
    let of_joint = |j: usize| pairs.iter().position(|pair| pair[0] == j);
    let mut group: Vec<usize> = (0..pairs.len()).collect();
    let symmetric = layout.symmetric.iter().filter(|p| p.tier <= 2).map(|p| p.left);
    for [a, b] in symmetric.chain(layout.limbs.iter().copied()) {
        let (Some(a), Some(b)) = (of_joint(a), of_joint(b)) else { continue };
        let (kept, gone) = (group[a].min(group[b]), group[a].max(group[b]));
        let size = |g: usize| group.iter().filter(|other| **other == g).count();
        if kept != gone && (size(kept) == 1 || size(gone) == 1) {
            group.iter_mut().filter(|g| **g == gone).for_each(|g| *g = kept);
        }
    }
    let members = |g: usize| -> Chain {
        let mut chain: Chain =
            (0..pairs.len()).filter(|k| group[*k] == g).map(|k| pairs[k]).collect();
        let at_trunk = |pair: &[usize; 2]| {
            let limbs = layout.symmetric.iter().filter(|p| p.tier == 2);
            limbs.clone().all(|p| p.left[0] != pair[0])
        };
        chain.sort_by_key(at_trunk);
        chain
    };
    (0..pairs.len()).map(members).filter(|chain| !chain.is_empty()).collect()
}

/// A chain with swapped sides in a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Swap {
    /// The view.
    pub view: usize,
    /// The chain.
    pub chain: usize,
}

/// Both assignments of a chain in one view, in Σ c k, and the total weight to explain.
#[derive(Debug, Clone, Copy, Default)]
struct Ways {
    own: f64,
    exchanged: f64,
    all: f64,
}

/// A position of a chain, (left, right) per pair, and its score in every view.
struct Proposal {
    at: Vec<[Vector3<f64>; 2]>,
    ways: Vec<Ways>,
}

/// A frame to search for swaps.
struct Judge<'a> {
    rays: &'a Rays,
    /// Kernel of each joint.
    sigma: &'a [f64],
    /// Mean weight of a detection.
    unit: f64,
}

/// The chains that are swapped, with their views, where the joints are at `points`; `sigma` are
/// their kernels `(N)`, at most the configured ones: swapped sides can look like noise and widen
/// them.
pub fn find(rays: &Rays, chains: &[Chain], points: &[Vector3<f64>], sigma: &[f64]) -> Vec<Swap> {
    let judge = Judge { rays, sigma, unit: rays.mean_weight() };
    let mut found = Vec::new();
    for (c, chain) in chains.iter().enumerate() {
        let others = chains.iter().enumerate().filter(|(o, _)| *o != c).map(|(_, o)| o[0]);
        let across = others.map(|[l, r]| points[l] - points[r]);
        let sideways = across.filter(|v| v.x.is_finite()).sum();
        let views = judge.views(chain, points, &sideways).into_iter();
        found.extend(views.map(|view| Swap { view, chain: c }));
    }
    found
}

impl Judge<'_> {
    /// Both assignments of `chain` in view `i` with its joints at `at`: (left, right) per pair.
    fn ways(&self, i: usize, chain: &Chain, at: &[[Vector3<f64>; 2]]) -> Ways {
        let mut ways = Ways::default();
        for (pair, x) in chain.iter().zip(at) {
            let rays = pair.map(|j| &self.rays.of_joint(j)[i]);
            // The rays of left and right at their own places, then at each other's.
            let of_rays = |[l, r]: [f64; 2]| Four::new([l, r, l, r]);
            let of_places = |[l, r]: [f64; 2]| Four::new([l, r, r, l]);
            let four = FourRays {
                direction: std::array::from_fn(|a| of_rays(rays.map(|ray| ray.direction[a]))),
                weight: of_rays(rays.map(|ray| ray.weight)),
            };
            let sigma = of_places(pair.map(|j| self.sigma[j]));
            let at = std::array::from_fn(|a| of_places([x[0][a], x[1][a]]));
            let centre: [f64; 3] = rays[usize::from(!rays[0].is_there())].centre.into();
            let k = four
                .across(&at, &centre.map(Four::splat))
                .trust(Four::splat(-0.25) / (sigma * sigma));
            let [own_l, own_r, other_l, other_r] = (four.weight * k).to_array();
            ways.all += rays[0].weight + rays[1].weight;
            ways.own += own_l + own_r;
            ways.exchanged += other_l + other_r;
        }
        ways
    }

    fn all_ways(&self, chain: &Chain, at: &[[Vector3<f64>; 2]]) -> Vec<Ways> {
        (0..self.rays.n_views()).map(|i| self.ways(i, chain, at)).collect()
    }

    /// Views in which the chain is swapped; `sideways` is the sum of the other chains'
    /// right-to-left vectors at the trunk.
    fn views(&self, chain: &Chain, points: &[Vector3<f64>], sideways: &Vector3<f64>) -> Vec<usize> {
        let at: Vec<[Vector3<f64>; 2]> = chain.iter().map(|p| p.map(|j| points[j])).collect();
        let ways = self.all_ways(chain, &at);
        let seeing = ways.iter().filter(|w| w.all > 0.0).count();
        if seeing < LEAST_VIEWS {
            return Vec::new();
        }
        let explained = best_ways(&ways);
        let against = |w: &&Ways| w.all - w.own.max(w.exchanged) > GAIN * self.unit;
        let doubtful = 2 * ways.iter().filter(against).count() >= seeing;
        let better = |p: &Proposal| best_ways(&p.ways) >= explained + GAIN * self.unit;
        let proposal = if doubtful { self.best_proposal(chain, &ways) } else { None };
        if let Some(proposal) = proposal.filter(better) {
            return self.right_way_round(&proposal, sideways);
        }
        let gains = |w: &Ways| w.exchanged - w.own >= GAIN * self.unit;
        (0..ways.len()).filter(|i| gains(&ways[*i])).collect()
    }

    /// The position of the chain, proposed by two views, that explains most when every view chooses
    /// its assignment.
    fn best_proposal(&self, chain: &Chain, ways: &[Ways]) -> Option<Proposal> {
        let proposers = proposers(ways);
        let pairs = proposers.iter().enumerate();
        let pairs = pairs.flat_map(|(k, a)| proposers[k + 1..].iter().map(move |b| (*a, *b)));
        let proposals = pairs.filter_map(|(a, b)| {
            let at = self.settled(chain, &self.proposal(chain, a, b)?);
            Some(Proposal { ways: self.all_ways(chain, &at), at })
        });
        let better = |a: &Proposal, b: &Proposal| best_ways(&a.ways) > best_ways(&b.ways);
        proposals.reduce(|best, other| if better(&other, &best) { other } else { best })
    }

    /// Where the rays of views `a` and `b` meet with opposite assignments; `None` if most do not.
    fn proposal(&self, chain: &Chain, a: usize, b: usize) -> Option<Vec<[Vector3<f64>; 2]>> {
        let (mut seen, mut met) = (0, 0);
        let mut meet = |pair: &[usize; 2], side: usize| {
            let first = &self.rays.of_joint(pair[side])[a];
            let second = &self.rays.of_joint(pair[1 - side])[b];
            let both = first.is_there() && second.is_there();
            seen += usize::from(both);
            let found = if both { rays::meet(first, second) } else { None };
            let reach = 2.0 * self.sigma[pair[side]];
            met += usize::from(found.is_some_and(|(_, apart)| apart <= reach));
            found.map_or_else(|| Vector3::repeat(f64::NAN), |(x, _)| x)
        };
        let at = chain.iter().map(|pair| [meet(pair, 0), meet(pair, 1)]).collect();
        (2 * met >= seen && met > 0).then_some(at)
    }

    /// One weighted step of the chain's joints, with the better assignment in every view.
    fn settled(&self, chain: &Chain, at: &[[Vector3<f64>; 2]]) -> Vec<[Vector3<f64>; 2]> {
        let ways = self.all_ways(chain, at);
        let step = |pair: &[usize; 2], side: usize, x: &Vector3<f64>| {
            let sigma = self.sigma[pair[side]];
            let mut sums = Meeting::default();
            for (i, way) in ways.iter().enumerate() {
                let exchanged = way.exchanged > way.own;
                let ray = &self.rays.of_joint(pair[if exchanged { 1 - side } else { side }])[i];
                sums.add(ray, ray.weight * ray.offset(x).weight(sigma));
            }
            sums.point().unwrap_or(*x)
        };
        let both = |(pair, x): (&[usize; 2], &[Vector3<f64>; 2])| {
            [step(pair, 0, &x[0]), step(pair, 1, &x[1])]
        };
        chain.iter().zip(at).map(both).collect()
    }

    /// Swapped views of a proposal, which may itself be swapped as a whole: the assignment with
    /// fewer swapped views, else the one in which left is on the same side as for the rest of the
    /// body.
    fn right_way_round(&self, proposal: &Proposal, sideways: &Vector3<f64>) -> Vec<usize> {
        let Proposal { at, ways } = proposal;
        let least = GAIN * self.unit;
        let exchanged = |i: &usize| ways[*i].exchanged - ways[*i].own > least;
        let own = |i: &usize| ways[*i].own - ways[*i].exchanged > least;
        let swapped: Vec<usize> = (0..ways.len()).filter(exchanged).collect();
        let other: Vec<usize> = (0..ways.len()).filter(own).collect();
        let across = at.iter().map(|[l, r]| l - r).find(|v| v.x.is_finite()).unwrap_or_default();
        let tie_goes_to_other = across.dot(sideways) < 0.0;
        if swapped.len() > other.len() || (swapped.len() == other.len() && tie_goes_to_other) {
            return other;
        }
        swapped
    }
}

/// The views that propose, in an order that depends on their detections and not on their numbers.
fn proposers(ways: &[Ways]) -> Vec<usize> {
    let mut views: Vec<usize> = (0..ways.len()).filter(|i| ways[*i].all > 0.0).collect();
    let best = |i: usize| ways[i].own.max(ways[i].exchanged);
    views.sort_by(|a, b| ways[*b].all.total_cmp(&ways[*a].all).then(best(*b).total_cmp(&best(*a))));
    views.truncate(MOST_PROPOSERS);
    views
}

fn best_ways(ways: &[Ways]) -> f64 {
    ways.iter().map(|w| w.own.max(w.exchanged)).sum()
}

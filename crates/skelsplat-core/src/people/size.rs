//! How large bodies are, where nothing says in which unit they are given, or of what kind.

use super::births::{COMMON, met};
use super::crowd::{Crowd, Figure};
use super::known::BodyModel;
use crate::annealed::rays::meet;
use crate::sequence::shown_sizes;
use crate::statistics::median;

/// Most figures of a view that are compared, those with the most joints.
const MOST_FIGURES: usize = 8;

impl BodyModel {
    /// The factor by which the world has to be scaled so that bodies are as large as people; 1 if
    /// there is no body. A frame is judged by the body whose rays meet best for its size.
    ///
    /// It is a power of two, since a few frames show no size more exactly, and all parts of a
    /// recording must have the same. For people it is rounded towards 1: a child or a reflection
    /// is not another unit.
    pub(super) fn scale_of(&self, crowds: &[Crowd]) -> f64 {
        let size = median(crowds.iter().filter_map(|crowd| self.size_of_best(crowd)));
        let doublings = -size.log2();
        let human = !self.proportions.is_empty();
        let scale = if human { doublings.trunc() } else { doublings.round() }.exp2();
        if scale > 0.0 && scale.is_finite() { scale } else { 1.0 }
    }

    /// Size of the body in a frame that two figures agree on best.
    fn size_of_best(&self, crowd: &Crowd) -> Option<f64> {
        let least = COMMON.min(crowd.n_joints);
        let views: Vec<Vec<&Figure>> =
            crowd.views.iter().map(|view| most_joints(view, least)).collect();
        let mut best: Option<(f64, f64)> = None;
        for (i, a) in views.iter().enumerate().flat_map(|(i, v)| v.iter().map(move |a| (i, a))) {
            for b in views[i + 1..].iter().flatten() {
                let size = median(shown_sizes(&self.proportions, &met(a, b)));
                let rays = a.rays.iter().zip(&b.rays).filter(|(p, q)| p.is_there() && q.is_there());
                let apart: Vec<f64> =
                    rays.map(|(p, q)| meet(p, q).map_or(f64::INFINITY, |(_, d)| d)).collect();
                if apart.len() < least {
                    continue;
                }
                let missed = median(apart) / size;
                if best.is_none_or(|(least, _)| missed < least) && missed.is_finite() {
                    best = Some((missed, size));
                }
            }
        }
        best.map(|(_, size)| size)
    }
}

/// Figures of a view with enough joints, those with the most.
fn most_joints(view: &[Figure], least: usize) -> Vec<&Figure> {
    let mut figures: Vec<&Figure> = view.iter().filter(|figure| figure.joints >= least).collect();
    figures.sort_by_key(|figure| std::cmp::Reverse(figure.joints));
    figures.truncate(MOST_FIGURES);
    figures
}

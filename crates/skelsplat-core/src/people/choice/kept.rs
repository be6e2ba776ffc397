//! The choices that are kept.

use super::rules::Rules;

/// The cheapest different choices so far, cheapest first.
#[derive(Debug, Default)]
pub(super) struct Kept {
    most: usize,
    worse: f64,
    pub(super) all: Vec<Candidate>,
    spare: Vec<Candidate>,
}

#[derive(Debug, Default)]
pub(super) struct Candidate {
    pub(super) cost: f64,
    /// The figures that proposed it.
    pub(super) pair: [usize; 2],
    /// The figure of each view.
    pub(super) figures: Vec<Option<usize>>,
}

impl Kept {
    pub(super) fn clear(&mut self, rules: &Rules) {
        (self.most, self.worse) = (rules.most, rules.worse);
        self.spare.append(&mut self.all);
    }

    /// The cost from which a choice is of no interest.
    pub(super) fn limit(&self) -> f64 {
        let cost = |k: usize| self.all.get(k).map_or(f64::INFINITY, |choice| choice.cost);
        cost(self.most.saturating_sub(1)).min(cost(0) + self.worse)
    }

    /// That of the choice of these figures; infinite if it is not kept.
    pub(super) fn cost(&self, figures: &[Option<usize>]) -> f64 {
        let kept = self.all.iter().find(|other| other.figures == figures);
        kept.map_or(f64::INFINITY, |other| other.cost)
    }

    pub(super) fn add(&mut self, cost: f64, pair: [usize; 2], figures: &[Option<usize>]) {
        if let Some(at) = self.all.iter().position(|other| other.figures == figures) {
            if self.all[at].cost <= cost {
                return;
            }
            self.spare.push(self.all.remove(at));
        }
        let mut new = self.spare.pop().unwrap_or_default();
        (new.cost, new.pair) = (cost, pair);
        new.figures.clear();
        new.figures.extend_from_slice(figures);
        let at = self.all.partition_point(|other| other.cost <= cost);
        self.all.insert(at, new);
        self.spare.extend(self.all.drain(self.most.min(self.all.len())..));
    }
}

//! A person's figures and joints over the frames of a recording.

use nalgebra::Vector3;

use super::body::{Claims, views};

/// A person's figures and joints in every frame of a range.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Track {
    /// The first frame.
    pub(super) first: usize,
    /// Figures and joints `(N)` of every frame, mm; no joints in a frame that is a gap.
    pub(super) frames: Vec<(Claims, Vec<Vector3<f64>>)>,
}

impl Track {
    /// Nothing yet, from frame `first`.
    pub(super) fn new(first: usize) -> Self {
        Self { first, frames: Vec::new() }
    }

    /// The frame after the last.
    pub(super) fn end(&self) -> usize {
        self.first + self.frames.len()
    }

    /// Adds frame `t`, after a gap if others lie between.
    pub(super) fn push(&mut self, t: usize, claims: Claims, pose: Vec<Vector3<f64>>) {
        self.frames.resize(t - self.first, (vec![[None, None]; claims.len()], Vec::new()));
        self.frames.push((claims, pose));
    }

    /// Goes on as `other`, which begins later; the frames between are filled on straight lines.
    pub(super) fn append(&mut self, other: Self) {
        self.frames.truncate(other.first.min(self.end()) - self.first);
        for (k, (claims, pose)) in other.frames.into_iter().enumerate() {
            self.push(other.first + k, claims, pose);
        }
        self.fill();
    }

    /// Joints in frame `t`.
    pub(super) fn pose(&self, t: usize) -> Option<&[Vector3<f64>]> {
        let (_, pose) = self.frames.get(t.checked_sub(self.first)?)?;
        (!pose.is_empty()).then_some(pose)
    }

    /// Figures in frame `t`.
    pub(super) fn claim(&self, t: usize) -> Option<&Claims> {
        self.frames.get(t.checked_sub(self.first)?).map(|(claims, _)| claims)
    }

    /// Slots of the figures `(F, M)`; of part 1, of further ones.
    pub(super) fn slots(&self, part: usize) -> Vec<Option<usize>> {
        self.frames.iter().flat_map(|(claims, _)| claims).map(|claim| claim[part]).collect()
    }

    /// Number of figures.
    pub(super) fn figures(&self) -> usize {
        self.frames.iter().map(|(claims, _)| views(claims)).sum()
    }

    /// From the first to the last frame that two views see; `None` if those are nowhere `least` of
    /// twice as many frames.
    #[must_use]
    pub(super) fn trimmed(mut self, least: usize) -> Option<Self> {
        let two = |(claims, _): &(Claims, _)| views(claims) >= 2;
        let seen: Vec<bool> = self.frames.iter().map(two).collect();
        let long_enough = |frames: &[bool]| frames.iter().filter(|seen| **seen).count() >= least;
        if !seen.windows((2 * least).clamp(1, seen.len().max(1))).any(long_enough) {
            return None;
        }
        let last = self.frames.iter().rposition(two)?;
        let first = self.frames.iter().position(two)?;
        self.frames.truncate(last + 1);
        self.frames.drain(..first);
        self.first += first;
        Some(self)
    }

    fn fill(&mut self) {
        let known = (0..self.frames.len()).filter(|k| !self.frames[*k].1.is_empty());
        let known: Vec<usize> = known.collect();
        for pair in known.windows(2) {
            for k in pair[0] + 1..pair[1] {
                let share = (k - pair[0]) as f64 / (pair[1] - pair[0]) as f64;
                let ends = self.frames[pair[0]].1.iter().zip(&self.frames[pair[1]].1);
                self.frames[k].1 = ends.map(|(a, b)| a.lerp(b, share)).collect();
            }
        }
    }

    /// Gaps filled on straight lines, then means over `reach` frames on either side.
    #[must_use]
    pub(super) fn smooth(mut self, reach: usize) -> Self {
        self.fill();
        let n = self.frames.len();
        let joints = self.frames.first().map_or(0, |(_, pose)| pose.len());
        let mean = |k: usize, j: usize| {
            // The same reach on both sides: a mean over more of one side would lag.
            let reach = reach.min(k).min(n - 1 - k);
            let all = self.frames[k - reach..=k + reach].iter().map(|(_, pose)| pose[j]);
            let (sum, n) = all
                .filter(|x| !x.x.is_nan())
                .fold((Vector3::zeros(), 0.0), |(sum, n), x| (sum + x, n + 1.0));
            sum / n
        };
        let poses: Vec<Vec<_>> =
            (0..n).map(|k| (0..joints).map(|j| mean(k, j)).collect()).collect();
        self.frames.iter_mut().zip(poses).for_each(|((_, pose), smooth)| *pose = smooth);
        self
    }
}

//! A person's figures and joints over the frames of a recording.

use nalgebra::Vector3;

use super::body::{Claims, views};

/// A person's figures and joints in every frame of a range.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Track {
    /// The first frame.
    pub(super) first: usize,
    /// Figures of every frame.
    pub(super) claims: Vec<Claims>,
    /// Joints `(N)` of every frame, mm; none in a frame that is a gap.
    pub(super) poses: Vec<Vec<Vector3<f64>>>,
}

impl Track {
    /// Nothing yet, from frame `first`.
    pub(super) fn new(first: usize) -> Self {
        Self { first, claims: Vec::new(), poses: Vec::new() }
    }

    /// The frame after the last.
    pub(super) fn end(&self) -> usize {
        self.first + self.claims.len()
    }

    /// Adds frame `t`, after a gap if others lie between.
    pub(super) fn push(&mut self, t: usize, claims: Claims, pose: Vec<Vector3<f64>>) {
        self.claims.resize(t - self.first, vec![[None, None]; claims.len()]);
        self.poses.resize(t - self.first, Vec::new());
        self.claims.push(claims);
        self.poses.push(pose);
    }

    /// Goes on as `other`, which begins later; the frames between are filled on straight lines.
    pub(super) fn append(&mut self, other: Self) {
        let own = other.first.min(self.end()) - self.first;
        self.claims.truncate(own);
        self.poses.truncate(own);
        for (k, (claims, pose)) in other.claims.into_iter().zip(other.poses).enumerate() {
            self.push(other.first + k, claims, pose);
        }
        self.fill();
    }

    /// Joints in frame `t`.
    pub(super) fn pose(&self, t: usize) -> Option<&[Vector3<f64>]> {
        let k = t.checked_sub(self.first)?;
        self.poses.get(k).filter(|pose| !pose.is_empty()).map(Vec::as_slice)
    }

    /// Figures in frame `t`.
    pub(super) fn claim(&self, t: usize) -> Option<&Claims> {
        self.claims.get(t.checked_sub(self.first)?)
    }

    /// Slots of the figures `(F, M)`; of part 1, of further ones.
    pub(super) fn slots(&self, part: usize) -> Vec<Option<usize>> {
        self.claims.iter().flatten().map(|claim| claim[part]).collect()
    }

    /// Number of figures.
    pub(super) fn figures(&self) -> usize {
        self.claims.iter().flatten().filter(|claim| claim[0].is_some()).count()
    }

    /// From the first to the last frame that two views see; `None` if those are nowhere `least` of
    /// twice as many frames.
    #[must_use]
    pub(super) fn trimmed(mut self, least: usize) -> Option<Self> {
        let two = |claims: &Claims| views(claims) >= 2;
        let seen: Vec<bool> = self.claims.iter().map(two).collect();
        let long_enough = |frames: &[bool]| frames.iter().filter(|seen| **seen).count() >= least;
        if !seen.windows((2 * least).clamp(1, seen.len().max(1))).any(long_enough) {
            return None;
        }
        let last = self.claims.iter().rposition(two)?;
        let first = self.claims.iter().position(two)?;
        self.claims.truncate(last + 1);
        self.poses.truncate(last + 1);
        self.claims.drain(..first);
        self.poses.drain(..first);
        self.first += first;
        Some(self)
    }

    fn fill(&mut self) {
        let known: Vec<usize> =
            (0..self.poses.len()).filter(|k| !self.poses[*k].is_empty()).collect();
        for pair in known.windows(2) {
            for k in pair[0] + 1..pair[1] {
                let share = (k - pair[0]) as f64 / (pair[1] - pair[0]) as f64;
                let ends = self.poses[pair[0]].iter().zip(&self.poses[pair[1]]);
                self.poses[k] = ends.map(|(a, b)| a.lerp(b, share)).collect();
            }
        }
    }

    /// Gaps filled on straight lines, then means over `reach` frames on either side.
    #[must_use]
    pub(super) fn smooth(mut self, reach: usize) -> Self {
        self.fill();
        let n = self.poses.len();
        let joints = self.poses.first().map_or(0, Vec::len);
        let mean = |k: usize, j: usize| {
            // The same reach on both sides: a mean over more of one side would lag.
            let reach = reach.min(k).min(n - 1 - k);
            let all = self.poses[k - reach..=k + reach].iter().map(|pose| pose[j]);
            let (sum, n) = all
                .filter(|x| !x.x.is_nan())
                .fold((Vector3::zeros(), 0.0), |(sum, n), x| (sum + x, n + 1.0));
            sum / n
        };
        self.poses = (0..n).map(|k| (0..joints).map(|j| mean(k, j)).collect()).collect();
        self
    }
}

//! One person over the frames: the choices of consecutive frames are linked.

use nalgebra::Vector3;

use super::rules::Rules;
use super::search::{Choices, choices};
use super::weigh::median;
use crate::batch::Progress;
use crate::camera::Camera;
use crate::detections::Detections;
use crate::error::Result;

/// How many frames' choices are in memory at a time.
const CHUNK: usize = 1024;

/// What going over to someone else costs.
#[derive(Debug, Clone, Copy)]
pub struct Linking {
    /// At most, in unexplained views.
    pub cost: f64,
    /// A step from frame to frame of this length counts as someone else, in the unit of the
    /// cameras.
    pub step: f64,
}

/// One person in all frames.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Chosen {
    /// Slot of the figure in each frame and view `(T, M)`.
    pub slots: Vec<Option<usize>>,
    /// See [`Choices::cut`], `(T)`.
    pub cut: Vec<bool>,
}

/// The cheapest sequence in all of one choice per frame, by dynamic programming.
pub fn choose(
    frames: &[Vec<Detections>],
    cameras: &[Camera],
    rules: &Rules,
    linking: Linking,
    progress: &Progress,
) -> Result<Chosen> {
    let (mut path, mut cut) = (Path { linking, frames: Vec::new(), last: Vec::new() }, Vec::new());
    for chunk in frames.chunks(CHUNK) {
        for found in choices(chunk, cameras, rules, progress)? {
            cut.push(found.cut);
            path.add(found);
        }
    }
    Ok(Chosen { slots: path.slots(cameras.len()), cut })
}

struct Path {
    linking: Linking,
    /// Of each frame and choice its slots, and the choice before it.
    frames: Vec<Vec<(Vec<Option<usize>>, usize)>>,
    /// Joints and cost, with all before them, of the choices of the last frame that has any.
    last: Vec<(Vec<Vector3<f64>>, f64)>,
}

impl Path {
    fn add(&mut self, found: Choices) {
        let (mut links, mut now) = (Vec::new(), Vec::new());
        for choice in found.all {
            let (mut least, mut from) = (f64::INFINITY, 0);
            for (k, (pose, total)) in self.last.iter().enumerate() {
                // What already costs more need not be compared.
                if *total < least {
                    let way = total + self.switch(pose, &choice.pose);
                    (least, from) = if way < least { (way, k) } else { (least, from) };
                }
            }
            links.push((choice.slots, from));
            now.push((choice.pose, choice.cost + if self.last.is_empty() { 0.0 } else { least }));
        }
        self.frames.push(links);
        if !now.is_empty() {
            self.last = now;
        }
    }

    fn switch(&self, before: &[Vector3<f64>], now: &[Vector3<f64>]) -> f64 {
        let steps = before.iter().zip(now).map(|(a, b)| (a - b).norm());
        let mut steps: Vec<f64> = steps.filter(|step| step.is_finite()).collect();
        let moved = if steps.is_empty() { self.linking.step } else { median(&mut steps) };
        self.linking.cost * (moved / self.linking.step).min(1.0).powi(2)
    }

    /// Slots `(T, M)` of the cheapest sequence.
    fn slots(&self, n_views: usize) -> Vec<Option<usize>> {
        let cost = |k: &usize| self.last[*k].1;
        let cheapest = (0..self.last.len()).min_by(|a, b| cost(a).total_cmp(&cost(b)));
        let mut slots = vec![None; self.frames.len() * n_views];
        let mut at = cheapest.unwrap_or(0);
        for (links, slots) in self.frames.iter().zip(slots.chunks_mut(n_views)).rev() {
            if let Some((chosen, before)) = links.get(at) {
                slots.copy_from_slice(chosen);
                at = *before;
            }
        }
        slots
    }
}

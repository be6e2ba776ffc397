//! One frame's people as rays.

use crate::annealed::rays::{Ray, there};
use crate::detections::Detections;
use crate::error::{Error, Result};
use crate::refine::Refiner;

/// What a detector takes for one person in one view.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Figure {
    /// Rays `(N)`; a missing one where a joint is not detected.
    pub rays: Vec<Ray>,
    /// Number of detected joints.
    pub joints: usize,
    /// Mean confidence of the detected joints.
    pub confidence: f64,
}

/// The figures of all views; an empty slot is a figure without joints.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Crowd {
    /// By view and slot.
    pub views: Vec<Vec<Figure>>,
    /// N.
    pub n_joints: usize,
}

impl Figure {
    fn new(rays: Vec<Ray>) -> Self {
        let joints = there(&rays).count();
        let weight: f64 = rays.iter().map(|ray| ray.weight).sum();
        Self { rays, joints, confidence: weight / joints.max(1) as f64 }
    }
}

impl Crowd {
    /// The rays of one frame's `slots`, each with one figure per view.
    /// Errors: [`Error::InvalidInput`] if views or joints do not match the refiner's or each other.
    pub fn new(refiner: &Refiner, slots: &[Detections]) -> Result<Self> {
        let n_joints = slots.first().map_or(0, Detections::n_joints);
        let mut views = vec![Vec::with_capacity(slots.len()); refiner.cameras.len()];
        for slot in slots {
            if slot.n_joints() != n_joints {
                let expected = format!("{n_joints} joints, as the other people");
                return Err(Error::invalid("people", expected, slot.n_joints().to_string()));
            }
            let rays = refiner.rays(slot).map_err(|error| error.of_argument("people"))?;
            for (i, view) in views.iter_mut().enumerate() {
                view.push(Figure::new((0..n_joints).map(|j| rays.of_joint(j)[i]).collect()));
            }
        }
        Ok(Self { views, n_joints })
    }

    /// Figures with joints, by view and slot.
    pub fn free(&self) -> Vec<Vec<bool>> {
        let view = |figures: &Vec<Figure>| figures.iter().map(|f| f.joints > 0).collect();
        self.views.iter().map(view).collect()
    }

    /// The same in a world that is `scale` times as large.
    #[must_use]
    pub fn scaled(mut self, scale: f64) -> Self {
        for ray in self.views.iter_mut().flatten().flat_map(|figure| &mut figure.rays) {
            ray.centre *= scale;
        }
        self
    }
}

//! What all bodies of a recording have in common.

use nalgebra::Vector3;

use super::crowd::Figure;
use super::score::at_body;
use crate::bones::population::{Proportion, proportions};
use crate::camera::Camera;
use crate::layout::Layout;
use crate::refine::{RefineConfig, Refiner};

/// Kernel of claims in multiples of the splats' σ: 90 mm with the usual settings, the size of a
/// part of the body.
const KERNEL: f64 = 3.0;

/// The same where nothing is known of the cameras' calibration or unit: 120 mm for a person.
const DOUBTFUL_KERNEL: f64 = 4.0;

/// What bodies have in common.
#[derive(Debug, Clone)]
pub struct BodyModel {
    /// In mm.
    pub cameras: Vec<Camera>,
    /// Joints at both ends of every bone.
    pub limbs: Vec<[usize; 2]>,
    /// Lengths of bones in the population; none for one's own layouts.
    pub proportions: Vec<Proportion>,
    /// Mirror image of each joint; empty if there are no left–right pairs.
    pub mirror: Vec<usize>,
    /// Kernel of claims, mm.
    pub sigma: f64,
    /// By how much the world is larger in which bodies are compared.
    pub scale: f64,
}

impl BodyModel {
    /// As the refiner has it.
    pub fn new(refiner: &Refiner, layout: &Layout) -> Self {
        Self {
            cameras: refiner.cameras.clone(),
            limbs: layout.limbs.clone(),
            proportions: proportions(layout),
            mirror: mirror_images(layout),
            sigma: KERNEL * refiner.config().sigma_mm(),
            scale: 1.0,
        }
    }

    /// The score of a figure at a body.
    pub(super) fn fit(&self, figure: &Figure, pose: &[Vector3<f64>]) -> f64 {
        at_body(figure, pose, self.sigma, &self.mirror)
    }

    /// Of bodies of a person's size in a world that is `scale` times as large.
    #[must_use]
    pub fn scaled(mut self, scale: f64) -> Self {
        self.sigma = DOUBTFUL_KERNEL * RefineConfig::default().sigma_mm();
        self.scale = scale;
        self
    }
}

/// The mirror image of each joint; empty if there are no left–right pairs.
fn mirror_images(layout: &Layout) -> Vec<usize> {
    if layout.left_right.is_empty() {
        return Vec::new();
    }
    let mut mirror: Vec<usize> = (0..layout.n_joints()).collect();
    for [a, b] in &layout.left_right {
        mirror.swap(*a, *b);
    }
    mirror
}

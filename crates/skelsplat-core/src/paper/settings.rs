//! The settings of the published method, with the paper's values (DESIGN §2).

use super::encoding::Encoding;
use crate::error::{Error, Result};
use crate::names::named;
use crate::settings::{Domain, Kind, Parameter, Value, parameter, settings};

settings! {
    /// Settings of the published method.
    PaperSettings {
        // The paper's log-scale of 3 (mm): σ₀ = e³ ≈ 20.09 mm.
        sigma_mm: f64 = 3f64.exp(), Domain::Positive, "mm",
            "Initial standard deviation σ₀ of every joint's splat.";
        max_steps: usize = 125, Domain::Any, "",
            "Maximum number of steps.";
        renderer: Renderer = Renderer::Raster, Domain::Any, "",
            "How splats are compared with detections: `raster` on pixels, as in the paper, or \
             `closed_form` with the exact integral of the same loss over the plane (one-hot \
             encoding only).";
        dilation: f64 = 0.3, Domain::Positive, "px²",
            "h, added to the projected variances.";
        encoding: Encoding = Encoding::OneHot, Domain::Any, "",
            "Joint encoding; `rgb` and `single`, which share channels among joints, are for \
             ablations.";
        symmetry_weight: f64 = 1e-5, Domain::NotNegative, "mm⁻²",
            "λ_sym, the weight of the symmetry loss.";
        views_per_step: Option<usize> = None, Domain::Within(1, usize::MAX), "",
            "Number of views accumulated into the gradient of a step; None: all.";
        position_lr_mm: PositionLearningRate = PositionLearningRate::Millimetres(3.0),
            Domain::Rate, "mm",
            "Initial learning rate of the means; \"camera_extent\": 5e-4 · 1.1 · the largest \
             distance of a camera centre from their mean.";
        position_lr_factor: f64 = 1.0, Domain::Positive, "",
            "Factor on `position_lr_mm`; for its dome rigs the paper used 10 times the formula.";
        log_scale_lr: f64 = 0.005, Domain::Rate, "",
            "Learning rate of the log-scales.";
        rotation_lr: f64 = 0.001, Domain::Rate, "",
            "Learning rate of the quaternions.";
        lr_decay: f64 = 0.01, Domain::Positive, "",
            "Factor applied to the position learning rate over `lr_decay_steps`.";
        lr_decay_steps: f64 = 1000.0, Domain::Positive, "steps",
            "Number of steps after which the position learning rate has been multiplied by \
             `lr_decay`.";
        adam_betas: [f64; 2] = [0.9, 0.999], Domain::BelowOne, "",
            "Adam's β₁ and β₂.";
        adam_epsilon: f64 = 1e-15, Domain::Positive, "",
            "Adam's ε.";
        stop_tolerance: f64 = 1e-6, Domain::NotNegative, "",
            "Stop when the minimum loss of a window changes by less than this.";
        stop_window: Option<usize> = None, Domain::Within(1, usize::MAX), "",
            "Steps per window of the stopping rule; None: the number of views.";
        resolution: f64 = 1.0, Domain::Positive, "",
            "Rendering resolution relative to that of the cameras.";
        loss_history: bool = false, Domain::Any, "",
            "Record the loss of every step.";
    }
}

impl PaperSettings {
    /// Whether the settings fit each other.
    pub(crate) fn check_combinations(&self) -> Result<()> {
        if self.renderer == Renderer::ClosedForm && self.encoding != Encoding::OneHot {
            let expected = "'one_hot' with renderer 'closed_form'";
            return Err(Error::invalid("config.encoding", expected, self.encoding.name()));
        }
        Ok(())
    }
}

/// How splats are compared with detections.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Renderer {
    /// On pixels, as in the paper.
    Raster,
    /// The integral of the same loss over the plane, exact and without pixels; one-hot encoding
    /// only.
    ClosedForm,
}

named!(setting Renderer { Raster: "raster", ClosedForm: "closed_form" });

/// The position's initial learning rate, per step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PositionLearningRate {
    /// A fixed number of millimetres.
    Millimetres(f64),
    /// 5e-4 × 1.1 × the largest distance of a camera centre from their mean: the released formula.
    CameraExtent,
}

/// The name of the released formula for the learning rate.
const CAMERA_EXTENT: &str = "camera_extent";

parameter!(PositionLearningRate, Kind::NumberOrName(CAMERA_EXTENT),
    rate => match rate {
        PositionLearningRate::Millimetres(mm) => Value::Number(*mm),
        PositionLearningRate::CameraExtent => Value::Name(CAMERA_EXTENT),
    },
    Value::Number(mm) => Some(Self::Millimetres(*mm)),
    Value::Name(CAMERA_EXTENT) => Some(Self::CameraExtent));

//! Every setting of `refine`, with the paper's values (DESIGN §2). Defaults live here and nowhere else.

use crate::annealed::Annealing;
use crate::error::{Error, Result};
use crate::raster::encoding::Encoding;

/// What draws the splats and compares them with the detections.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Renderer {
    /// Pixels, as the paper.
    Raster,
    /// The integral of the same loss over the plane, exact and without pixels; one-hot encoding only.
    ClosedForm,
}

impl Renderer {
    /// The renderer called `"raster"` or `"closed_form"`.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for any other name.
    pub fn by_name(name: &str) -> Result<Self> {
        match name {
            "raster" => Ok(Self::Raster),
            "closed_form" => Ok(Self::ClosedForm),
            _ => Err(Error::UnknownName {
                argument: "renderer",
                name: name.to_owned(),
                known: ["raster", "closed_form"].map(str::to_owned).to_vec(),
            }),
        }
    }

    /// `"raster"` or `"closed_form"`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Raster => "raster",
            Self::ClosedForm => "closed_form",
        }
    }
}

/// What moves the parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Optimizer {
    /// Adam, as the paper.
    Adam,
    /// Re-weighted Gauss–Newton on the closed form, with a kernel that narrows.
    GaussNewton,
}

impl Optimizer {
    /// The optimiser called `"adam"` or `"gauss_newton"`.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for any other name.
    pub fn by_name(name: &str) -> Result<Self> {
        match name {
            "adam" => Ok(Self::Adam),
            "gauss_newton" => Ok(Self::GaussNewton),
            _ => Err(Error::UnknownName {
                argument: "optimizer",
                name: name.to_owned(),
                known: ["adam", "gauss_newton"].map(str::to_owned).to_vec(),
            }),
        }
    }

    /// `"adam"` or `"gauss_newton"`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Adam => "adam",
            Self::GaussNewton => "gauss_newton",
        }
    }
}

/// The position's initial learning rate, mm per step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PositionLearningRate {
    /// A fixed number of millimetres.
    Millimetres(f64),
    /// 5e-4 × 1.1 × the largest distance of a camera centre from their mean: the released formula.
    CameraExtent,
}

/// Settings of `refine`. Lengths are millimetres whatever the unit of the cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct RefineConfig {
    /// Renderer of the loss.
    pub renderer: Renderer,
    /// Optimiser of the loss.
    pub optimizer: Optimizer,
    /// Standard deviation of every joint's splat: the initial σ₀ for Adam, the widest final one for Gauss–Newton.
    pub sigma: f64,
    /// Initial standard deviation of occlusion-prone joints (elbows, wrists, ankles); `None`: `sigma`.
    pub occlusion_sigma: Option<f64>,
    /// A standard deviation for each joint, instead of the two above.
    pub joint_sigmas: Option<Vec<f64>>,
    /// Gauss–Newton: σ the kernel starts from.
    pub sigma_start: f64,
    /// Gauss–Newton: factor on σ from one step to the next.
    pub sigma_decay: f64,
    /// Gauss–Newton: σ ends at this multiple of the detections' noise, also above `sigma` where the frame is more likely so;
    /// `None`: it ends at `sigma`.
    pub sigma_per_noise: Option<f64>,
    /// Gauss–Newton: standard deviation of the detections' noise, pixels; `None`: estimated in every frame.
    pub detection_sigma: Option<f64>,
    /// How much each view counts.
    pub view_weights: Option<Vec<f64>>,
    /// h, added to the projected variances, pixels².
    pub dilation: f64,
    /// Joint encoding; the shared ones are ablations.
    pub encoding: Encoding,
    /// Symmetric limb pairs up to this tier; 0 switches the symmetry loss off.
    pub symmetry_tier: u8,
    /// λ_sym, mm⁻².
    pub symmetry_weight: f64,
    /// Gauss–Newton: standard deviation of the difference between symmetric limbs.
    pub symmetry_sigma: f64,
    /// Gauss–Newton: look for exchanged left and right.
    pub find_swaps: bool,
    /// Gauss–Newton: least step, in multiples of the detections' noise, at which it goes on.
    pub step_tolerance: f64,
    /// Largest number of optimisation steps.
    pub max_steps: usize,
    /// Views whose gradients are accumulated before a step; `None`: all of them.
    pub views_per_step: Option<usize>,
    /// Initial learning rate of the means.
    pub position_lr: PositionLearningRate,
    /// Multiplies `position_lr` (the paper's dome rigs ran with 10 × the formula).
    pub position_lr_factor: f64,
    /// Learning rate of the log-scales.
    pub log_scale_lr: f64,
    /// Learning rate of the quaternions.
    pub rotation_lr: f64,
    /// Factor by which the position's learning rate falls over `lr_decay_steps`.
    pub lr_decay: f64,
    /// Steps over which `lr_decay` is reached.
    pub lr_decay_steps: f64,
    /// Adam's β₁ and β₂.
    pub adam_betas: [f64; 2],
    /// Adam's ε.
    pub adam_epsilon: f64,
    /// Early stopping: least change of the window minimum.
    pub stop_tolerance: f64,
    /// Early stopping: steps per window; `None`: the number of views M.
    pub stop_window: Option<usize>,
    /// Undistort detections once before anything else; off mirrors numbers published without it.
    pub undistort: bool,
    /// Detections of a lower confidence count as missing.
    pub min_confidence: f64,
    /// Resolution at which the images are rendered, as a factor of the cameras' size.
    pub resolution: f64,
    /// Keep the loss of every step.
    pub loss_history: bool,
    /// Threads for a batch; `None`: all cores.
    pub n_threads: Option<usize>,
}

/// The paper's log-scale of 3 (mm): σ₀ = e³ ≈ 20.09 mm.
const PAPER_LOG_SCALE: f64 = 3.0;

impl RefineConfig {
    /// The published method.
    #[must_use]
    pub fn paper() -> Self {
        Self {
            renderer: Renderer::Raster,
            optimizer: Optimizer::Adam,
            sigma: PAPER_LOG_SCALE.exp(),
            occlusion_sigma: None,
            joint_sigmas: None,
            sigma_start: Annealing::START,
            sigma_decay: Annealing::FACTOR,
            sigma_per_noise: None,
            detection_sigma: None,
            view_weights: None,
            dilation: 0.3,
            encoding: Encoding::OneHot,
            symmetry_tier: 1,
            symmetry_weight: 1e-5,
            symmetry_sigma: Annealing::SYMMETRY_SIGMA,
            find_swaps: false,
            step_tolerance: Annealing::TOLERANCE,
            max_steps: 125,
            views_per_step: None,
            position_lr: PositionLearningRate::Millimetres(3.0),
            position_lr_factor: 1.0,
            log_scale_lr: 0.005,
            rotation_lr: 0.001,
            lr_decay: 0.01,
            lr_decay_steps: 1000.0,
            adam_betas: [0.9, 0.999],
            adam_epsilon: 1e-15,
            stop_tolerance: 1e-6,
            stop_window: None,
            undistort: true,
            min_confidence: 0.0,
            resolution: 1.0,
            loss_history: false,
            n_threads: None,
        }
    }

    /// σ of occlusion-prone joints by the paper's factor f, which multiplies the *log*-scale:
    /// σ = σ₀^f (e^{3f} at the paper's σ₀; f = 1.25 → 42.5 mm).
    #[must_use]
    pub fn occlusion_sigma_of_factor(&self, factor: f64) -> f64 {
        self.sigma.powf(factor)
    }

    /// Whether every field lies in its domain.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] naming the first field that does not.
    pub fn validate(&self) -> Result<()> {
        self.validate_lengths()?;
        positive("dilation", self.dilation)?;
        not_negative("symmetry_weight", self.symmetry_weight)?;
        rate("log_scale_lr", self.log_scale_lr)?;
        rate("rotation_lr", self.rotation_lr)?;
        positive("position_lr_factor", self.position_lr_factor)?;
        positive("lr_decay", self.lr_decay)?;
        positive("lr_decay_steps", self.lr_decay_steps)?;
        positive("adam_epsilon", self.adam_epsilon)?;
        not_negative("stop_tolerance", self.stop_tolerance)?;
        positive("step_tolerance", self.step_tolerance)?;
        positive("resolution", self.resolution)?;
        self.validate_counts()?;
        if self.renderer == Renderer::ClosedForm && self.encoding != Encoding::OneHot {
            let expected = "'one_hot' with renderer 'closed_form'";
            return Err(bad("encoding", expected, self.encoding.name()));
        }
        self.validate_optimizer()?;
        if !(0.0..=1.0).contains(&self.min_confidence) {
            return Err(bad("min_confidence", "a value in [0, 1]", self.min_confidence));
        }
        match self.adam_betas.iter().find(|b| !(0.0..1.0).contains(*b)) {
            Some(beta) => Err(bad("adam_betas", "values in [0, 1)", *beta)),
            None => Ok(()),
        }
    }

    fn validate_lengths(&self) -> Result<()> {
        positive("sigma", self.sigma)?;
        positive("sigma_start", self.sigma_start)?;
        positive("symmetry_sigma", self.symmetry_sigma)?;
        for (field, value) in
            [("sigma_per_noise", self.sigma_per_noise), ("detection_sigma", self.detection_sigma)]
        {
            if let Some(value) = value {
                positive(field, value)?;
            }
        }
        for (j, sigma) in self.joint_sigmas.iter().flatten().enumerate() {
            positive(&format!("joint_sigmas[{j}]"), *sigma)?;
        }
        for (i, weight) in self.view_weights.iter().flatten().enumerate() {
            not_negative(&format!("view_weights[{i}]"), *weight)?;
        }
        if let Some(sigma) = self.occlusion_sigma {
            positive("occlusion_sigma", sigma)?;
        }
        if let PositionLearningRate::Millimetres(mm) = self.position_lr {
            rate("position_lr", mm)?;
        }
        Ok(())
    }

    fn validate_optimizer(&self) -> Result<()> {
        if !(self.sigma_decay > 0.0 && self.sigma_decay < 1.0) {
            return Err(bad("sigma_decay", "a number between 0 and 1", self.sigma_decay));
        }
        match self.optimizer {
            Optimizer::GaussNewton if self.renderer != Renderer::ClosedForm => {
                let expected = "'closed_form' with optimizer 'gauss_newton'";
                Err(bad("renderer", expected, self.renderer.name()))
            }
            Optimizer::Adam if self.view_weights.is_some() => {
                Err(bad("view_weights", "None with optimizer 'adam'", "weights"))
            }
            _ => Ok(()),
        }
    }

    fn validate_counts(&self) -> Result<()> {
        let counts = [
            ("views_per_step", self.views_per_step),
            ("stop_window", self.stop_window),
            ("n_threads", self.n_threads),
        ];
        if let Some((name, _)) = counts.iter().find(|(_, count)| *count == Some(0)) {
            return Err(bad(name, "at least 1", 0));
        }
        if let Some(n) = self.n_threads.filter(|n| *n > MOST_THREADS) {
            return Err(bad("n_threads", &format!("at most {MOST_THREADS}"), n));
        }
        if self.symmetry_tier > 3 {
            return Err(bad("symmetry_tier", "0, 1, 2 or 3", self.symmetry_tier));
        }
        Ok(())
    }
}

impl Default for RefineConfig {
    /// The closed form, annealed, by Gauss–Newton: any start, and error bars.
    fn default() -> Self {
        Self {
            renderer: Renderer::ClosedForm,
            optimizer: Optimizer::GaussNewton,
            sigma: Annealing::END,
            sigma_per_noise: Some(Annealing::PER_NOISE),
            find_swaps: true,
            max_steps: Annealing::MAX_STEPS,
            ..Self::paper()
        }
    }
}

fn bad(field: &str, expected: &str, actual: impl std::fmt::Display) -> Error {
    Error::invalid(format!("config.{field}"), expected, actual.to_string())
}

/// Largest number of a setting, whatever its unit, and smallest of one that is positive: squares and products of a few
/// of them stay far from the ends of a double.
const MOST: f64 = 1e9;
const LEAST: f64 = 1e-15;
/// More threads than any machine has cores.
const MOST_THREADS: usize = 4096;

fn positive(field: &str, value: f64) -> Result<()> {
    if !(value > 0.0 && value.is_finite()) {
        return Err(bad(field, "a positive finite number", value));
    }
    if !(LEAST..=MOST).contains(&value) {
        let expected = format!("a number from {LEAST:e} to {MOST:e}");
        return Err(bad(field, &expected, format!("{value:e}")));
    }
    Ok(())
}

fn not_negative(field: &str, value: f64) -> Result<()> {
    rate(field, value)?;
    if value > MOST {
        return Err(bad(field, &format!("a number of at most {MOST:e}"), format!("{value:e}")));
    }
    Ok(())
}

/// A learning rate. One that is too large diverges, which is an outcome.
fn rate(field: &str, value: f64) -> Result<()> {
    if value >= 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(bad(field, "a finite number that is not negative", value))
}

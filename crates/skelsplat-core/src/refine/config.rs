//! Every setting of `refine`: those shared by all methods, and the method with its own. These
//! tables (here, `annealed/settings.rs` and `paper/settings.rs`) are the only definition of the
//! defaults.

use std::fmt::Display;

use super::bias::JointBias;
use crate::annealed::{AnnealedSettings, Annealing};
use crate::error::{Error, Result};
use crate::paper::{PaperSettings, Renderer};
use crate::settings::{Domain, Kind, Setting, Value, settings};

/// How a pose is refined.
#[derive(Debug, Clone, PartialEq)]
pub enum Method {
    /// Annealed splatting, the default: the closed-form loss under a kernel that narrows to the
    /// noise, from any start.
    Annealed(AnnealedSettings),
    /// The published method: the rendering loss, minimised by Adam.
    Paper(PaperSettings),
}

/// Upper limit of `n_threads`: as many as the largest machines have cores. To start many takes
/// long: 4096 on two cores a minute.
const MOST_THREADS: usize = 1024;

/// Smallest `detection_sigma_px`: a tenth of the noise of the best calibrated cameras with
/// coordinates in focal lengths instead of pixels. Below a tenth of this, the weights of ordinary
/// detections are so small that error bars are lost to rounding.
const LEAST_NOISE_PX: f64 = 1e-4;

settings! {
    /// Settings of `refine`. Lengths are millimetres whatever the unit of the cameras.
    RefineConfig {
        occlusion_sigma_mm: Option<f64> = None, Domain::Positive, "mm",
            "`sigma_mm` of occlusion-prone joints (elbows, wrists, ankles); None: same as \
             `sigma_mm`.";
        joint_sigmas_mm: Option<Vec<f64>> = None, Domain::Positive, "mm",
            "`sigma_mm` per joint, N values; replaces `sigma_mm` and `occlusion_sigma_mm`.";
        symmetry_tier: u8 = 1, Domain::Within(0, 3), "",
            "Tier up to which symmetric limbs are kept equal in length: 0 off, 1 lower limbs, 2 \
             also upper limbs, 3 also the trunk.";
        symmetry_sigma_mm: f64 = Annealing::SYMMETRY_SIGMA, Domain::Positive, "mm",
            "Standard deviation of the length difference between symmetric limbs; `paper` uses it \
             only for error bars.";
        detection_sigma_px: Option<f64> = None, Domain::From(LEAST_NOISE_PX), "px",
            "Standard deviation of the detection noise per axis; `paper` uses it only for error \
             bars; None: estimated in every frame.";
        joint_bias_mm: JointBias = JointBias::OfLayout, Domain::NotNegative, "mm",
            "Standard deviation per axis of the detector's joints from anatomical ones, the same \
             in all views and frames, for all joints or N values; part of the error bar, not of \
             the scatter; None: figures from motion capture for human layouts, 0 for others.";
        undistort: bool = true, Domain::Any, "",
            "Remove lens distortion from the detections first; False reproduces results published \
             without undistortion.";
        min_confidence: f64 = 0.0, Domain::Share, "",
            "Detections with a lower confidence are treated as missing.";
        n_threads: Option<usize> = None, Domain::Within(1, MOST_THREADS), "",
            "Number of threads that share the frames; does not affect the result; None: all cores.";
    }
    also {
        /// The method with its own settings.
        method: Method = Method::Annealed(AnnealedSettings::default());
    }
}

impl Method {
    /// The names of all methods.
    pub const NAMES: [&'static str; 2] = ["annealed", "paper"];

    /// The method of this name with its defaults.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for any other name.
    pub fn by_name(name: &str) -> Result<Self> {
        let found = Self::all().into_iter().find(|method| method.name() == name);
        found.ok_or_else(|| Error::unknown("method", name, Self::NAMES))
    }

    /// Every method with its defaults.
    fn all() -> [Self; 2] {
        let annealed = Self::Annealed(AnnealedSettings::default());
        [annealed, Self::Paper(PaperSettings::default())]
    }

    /// `"annealed"` or `"paper"`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Annealed(_) => "annealed",
            Self::Paper(_) => "paper",
        }
    }

    /// The table of the method's own settings.
    pub fn settings(&self) -> &'static [Setting] {
        match self {
            Self::Annealed(_) => AnnealedSettings::SETTINGS,
            Self::Paper(_) => PaperSettings::SETTINGS,
        }
    }
}

impl From<AnnealedSettings> for RefineConfig {
    fn from(settings: AnnealedSettings) -> Self {
        Self { method: Method::Annealed(settings), ..Self::default() }
    }
}

impl From<PaperSettings> for RefineConfig {
    fn from(settings: PaperSettings) -> Self {
        Self { method: Method::Paper(settings), ..Self::default() }
    }
}

/// An argument that is converted to `occlusion_sigma_mm`, not a field.
pub const OCCLUSION_FACTOR: Setting = Setting {
    name: "occlusion_factor",
    kind: Kind::Number,
    domain: Domain::Any,
    unit: "",
    sentence: "The paper's f, an alternative to `occlusion_sigma_mm`: multiplies the \
               *logarithm* of `sigma_mm`, giving σ^f; for `paper` 42.5 mm with 1.25, 90 mm with \
               1.5 and 403 mm with 2. Converted, not stored.",
};

/// Former names and their replacements, which include the unit.
const RENAMED: [(&str, &str); 8] = [
    ("sigma", "sigma_mm"),
    ("occlusion_sigma", "occlusion_sigma_mm"),
    ("joint_sigmas", "joint_sigmas_mm"),
    ("sigma_start", "sigma_start_mm"),
    ("symmetry_sigma", "symmetry_sigma_mm"),
    ("position_lr", "position_lr_mm"),
    ("detection_sigma", "detection_sigma_px"),
    ("optimizer", "method"),
];

impl RefineConfig {
    /// The published method.
    pub fn paper() -> Self {
        PaperSettings::default().into()
    }

    /// Every setting of this configuration: the method's own first, then the shared ones.
    pub fn settings(&self) -> impl Iterator<Item = &'static Setting> {
        self.method.settings().iter().chain(Self::SETTINGS)
    }

    /// The value of a setting.
    ///
    /// # Errors
    /// [`Error::UnknownName`], or [`Error::InvalidInput`] if it belongs to the other method.
    pub fn get(&self, name: &str) -> Result<Value> {
        let own = match &self.method {
            Method::Annealed(settings) => settings.value(name),
            Method::Paper(settings) => settings.value(name),
        };
        own.or_else(|| self.value(name)).ok_or_else(|| self.unknown(name, &name))
    }

    /// Sets a setting; [`Self::validate`] checks whether the value lies in its domain.
    ///
    /// # Errors
    /// [`Error::UnknownName`], or [`Error::InvalidInput`] if it belongs to the other method or the
    /// value has the wrong kind.
    pub fn set(&mut self, name: &str, value: &Value) -> Result<()> {
        let setting = self.setting(name, value)?;
        let own = match &mut self.method {
            Method::Annealed(settings) => settings.set_value(name, value),
            Method::Paper(settings) => settings.set_value(name, value),
        };
        if own || self.set_value(name, value) {
            return Ok(());
        }
        let field = format!("config.{name}");
        Err(Error::invalid(field, setting.kind.expected(), value.to_string()))
    }

    /// The table row of a setting of this configuration; `given`, the value to be set, appears in
    /// errors.
    ///
    /// # Errors
    /// [`Error::UnknownName`], or [`Error::InvalidInput`] if it belongs to the other method.
    pub fn setting(&self, name: &str, given: &dyn Display) -> Result<&'static Setting> {
        let mut known = self.settings();
        known.find(|setting| setting.name == name).ok_or_else(|| self.unknown(name, given))
    }

    fn unknown(&self, name: &str, given: &dyn Display) -> Error {
        let field = format!("config.{name}");
        let has = |method: &Method| method.settings().iter().any(|setting| setting.name == name);
        if let Some(other) = Method::all().iter().find(|method| has(method)) {
            let expected = format!("a setting of the method '{}'", self.method.name());
            let constructor = match other {
                Method::Annealed(_) => "RefineConfig",
                Method::Paper(_) => "RefineConfig.paper",
            };
            let actual = format!("a setting of '{}' (use {constructor})", other.name());
            return Error::invalid(field, expected, actual);
        }
        match RENAMED.iter().find(|(old, _)| *old == name) {
            Some((_, "method")) => {
                let expected = "RefineConfig() for 'annealed' or RefineConfig.paper() for 'paper'";
                Error::invalid(field, expected, given.to_string())
            }
            Some((_, new)) => Error::invalid(
                field,
                format!("the name '{new}', which includes the unit"),
                format!("'{name}'"),
            ),
            None => Error::unknown("config", name, self.settings().map(|setting| setting.name)),
        }
    }

    /// `sigma_mm` of the method.
    pub fn sigma_mm(&self) -> f64 {
        match &self.method {
            Method::Annealed(settings) => settings.sigma_mm,
            Method::Paper(settings) => settings.sigma_mm,
        }
    }

    /// Sets σ of occlusion-prone joints from the paper's factor f, which multiplies the
    /// *log*-scale: σ = σ₀^f (e^{3f} at the paper's σ₀; f = 1.25 → 42.5 mm).
    pub fn set_occlusion_factor(&mut self, factor: f64) {
        self.occlusion_sigma_mm = Some(self.sigma_mm().powf(factor));
    }

    /// Whether the method renders pixels, which threads can share.
    pub fn draws_pixels(&self) -> bool {
        matches!(&self.method, Method::Paper(settings) if settings.renderer == Renderer::Raster)
    }

    /// Whether every setting lies in its domain.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] naming the first setting outside its domain.
    pub fn validate(&self) -> Result<()> {
        match &self.method {
            Method::Annealed(settings) => settings.check_domains()?,
            Method::Paper(settings) => {
                settings.check_domains().and_then(|()| settings.check_combinations())?;
            }
        }
        self.check_domains()
    }
}

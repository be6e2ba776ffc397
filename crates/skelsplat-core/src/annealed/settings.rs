//! The settings of annealed splatting; docs/decisions.md has the measurements behind the defaults.

use super::noise::NoiseModel;
use super::problem::Annealing;
use crate::names::named;
use crate::settings::{Domain, Kind, Parameter, Value, settings};

settings! {
    /// Settings of annealed splatting, the default method.
    AnnealedSettings {
        sigma_mm: f64 = Annealing::END, Domain::Positive, "mm",
            "Largest final σ of a joint's kernel, unless the noise turns out to be larger.";
        max_steps: usize = 50, Domain::Any, "",
            "Maximum number of steps.";
        sigma_start_mm: f64 = Annealing::START, Domain::Positive, "mm",
            "Initial σ of the kernels; a joint with all rays nearer than this starts at the \
             distance of its farthest ray.";
        sigma_decay: f64 = 0.5, Domain::Between, "",
            "Factor applied to the kernel's σ at each step.";
        sigma_per_noise: Option<f64> = Some(Annealing::PER_NOISE), Domain::Positive, "",
            "Final σ of the kernel as a multiple of the detection noise, if that is less than \
             `sigma_mm`; it exceeds `sigma_mm` only where large noise explains the frame better \
             than many wrong detections. None: always `sigma_mm`.";
        view_weights: Option<Vec<f64>> = None, Domain::NotNegative, "",
            "Weight of each of the M views, multiplied by the confidence; 0 ignores a view; None: \
             1 for all.";
        find_swaps: bool = true, Domain::Any, "",
            "Find and correct detections with left and right swapped.";
        bones: Bones = Bones::Population, Domain::Any, "",
            "Lengths of bones for joints on which neither three views agree nor all that see \
             them: `population`, with the proportions of people (human layouts only) and a stature \
             found in the frame, or `free`, none.";
        bone_lengths_mm: Option<Vec<f64>> = None, Domain::Positive, "mm",
            "Known length of each of the layout's limbs, for any layout; replaces the \
             population's. None: not known.";
        bone_sigmas_mm: Option<Vec<f64>> = None, Domain::Positive, "mm",
            "Standard deviation of each of these lengths; one that is not less than the length \
             marks it as unknown. None: 20 for all.";
        step_tolerance: f64 = Annealing::TOLERANCE, Domain::Positive, "",
            "Converged when the kernels have reached their final width and no joint moves by more \
             than this fraction of its standard deviation.";
    }
}

/// What is known of the lengths of bones in a single frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bones {
    /// The population's proportions.
    Population,
    /// Nothing.
    Free,
}

named!(setting Bones { Population: "population", Free: "free" });

impl AnnealedSettings {
    /// The annealing schedule of one frame: final kernel widths `sigmas` `(N)`, mm; standard
    /// deviation `symmetry_sigma` of the length difference between symmetric limbs, mm; detection
    /// noise `detection_sigma`, pixels (`None`: estimated).
    pub fn annealing(
        &self,
        sigmas: Vec<f64>,
        symmetry_sigma: f64,
        detection_sigma: Option<f64>,
    ) -> Annealing {
        Annealing {
            start: self.sigma_start_mm,
            end: sigmas,
            per_noise: self.sigma_per_noise.unwrap_or(f64::INFINITY),
            base: self.sigma_mm,
            factor: self.sigma_decay,
            symmetry_sigma,
            max_steps: self.max_steps,
            tolerance: self.step_tolerance,
            noise: detection_sigma.map_or(NoiseModel::Estimated, NoiseModel::Pixels),
        }
    }
}

impl Annealing {
    /// The defaults for `n` joints.
    pub fn of_joints(n: usize) -> Self {
        AnnealedSettings::default().annealing(vec![Self::END; n], Self::SYMMETRY_SIGMA, None)
    }
}

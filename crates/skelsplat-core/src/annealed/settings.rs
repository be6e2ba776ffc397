//! The settings of annealed splatting, with defaults as measured (docs/decisions.md).

use super::noise::NoiseModel;
use super::solver::Annealing;
use crate::settings::{Domain, settings};

settings! {
    /// Settings of annealed splatting, the default method.
    AnnealedSettings {
        sigma_mm: f64 = Annealing::END, Domain::Positive, "mm",
            "Widest σ at which a joint's kernel ends, unless the noise turns out to be larger.";
        max_steps: usize = 50, Domain::Any, "",
            "Largest number of steps.";
        sigma_start_mm: f64 = 320.0, Domain::Positive, "mm",
            "σ of the widest kernel; a joint whose farthest ray is nearer begins there.";
        sigma_decay: f64 = 0.5, Domain::Between, "",
            "Factor on the kernel's σ from one step to the next.";
        sigma_per_noise: Option<f64> = Some(Annealing::PER_NOISE), Domain::Positive, "",
            "The kernel ends at this multiple of the detections' noise if that is less than `sigma_mm`; larger noise is \
             followed where it explains the frame better than many wrong detections do. None: it ends at `sigma_mm`.";
        view_weights: Option<Vec<f64>> = None, Domain::NotNegative, "",
            "How much each of the M views counts, on top of the confidence, 0 to leave it out; None: 1 for all.";
        find_swaps: bool = true, Domain::Any, "",
            "Look for detections with left and right exchanged.";
        step_tolerance: f64 = 0.01, Domain::Positive, "",
            "Converged once the kernels are narrow and no joint moves by more than this part of the noise.";
    }
}

impl AnnealedSettings {
    /// How the kernels of one frame narrow: to `sigmas` `(N)`, mm, with limbs as alike as `symmetry_sigma`, mm, and
    /// noise of `detection_sigma` pixels (`None`: estimated).
    #[must_use]
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
    #[must_use]
    pub fn of_joints(n: usize) -> Self {
        AnnealedSettings::default().annealing(vec![Self::END; n], Self::SYMMETRY_SIGMA, None)
    }
}

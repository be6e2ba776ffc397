//! What is known of the lengths of bones before any frame: lengths given by the user, else the
//! population's proportions.

use super::population::{Proportion, STATURE, proportions};
use super::{Bone, Length};
use crate::error::{Error, Result};
use crate::layout::Layout;
use crate::statistics::weighted_median;

/// Least standard deviation of a bone's length in the population, mm, and that of a given length by
/// default: detectors, tables and rulers mean different points.
pub const LEAST_SPREAD: f64 = 20.0;

/// Lengths of bones that are expected; none: bones are free.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Expected {
    /// Bones of given length.
    pub given: Vec<Bone>,
    /// The population's proportions of the other bones.
    pub proportions: Vec<Proportion>,
}

/// A bone that frames show.
#[derive(Debug, Clone, Copy)]
pub struct Shown {
    /// Its proportion in the population.
    pub proportion: Proportion,
    /// Its length, mm.
    pub length: f64,
    /// The variance of this length, mm².
    pub variance: f64,
}

impl Expected {
    /// The population's proportions for a human `layout`, replaced where the user gives `lengths`
    /// of the layout's limbs, mm, with standard deviations `sigmas`, or else the layout knows them.
    /// A length with a σ of its own size or more is unknown.
    /// Errors: [`Error::InvalidInput`] if there is not one length, and one σ, for each limb.
    pub fn new(
        layout: Option<&Layout>,
        lengths: Option<&[f64]>,
        sigmas: Option<&[f64]>,
    ) -> Result<Self> {
        let limbs = layout.map(|layout| layout.limbs.as_slice()).unwrap_or_default();
        let fields = [("bone_lengths_mm", lengths), ("bone_sigmas_mm", sigmas)];
        for (name, values) in fields {
            if let Some(values) = values.filter(|v| v.len() != limbs.len() || limbs.is_empty()) {
                let expected = match limbs.len() {
                    0 => "a layout with limbs".to_owned(),
                    n => format!("one value for each of the layout's {n} limbs"),
                };
                let actual = if limbs.is_empty() { "none" } else { &values.len().to_string() };
                return Err(Error::invalid(format!("config.{name}"), expected, actual));
            }
        }
        if sigmas.is_some() && lengths.is_none() {
            return Err(Error::invalid("config.bone_sigmas_mm", "bone_lengths_mm as well", "None"));
        }
        let bone =
            |b: usize, mean, sigma| Bone { joints: limbs[b], length: Length { mean, sigma } };
        let sigma = |b: usize| sigmas.map_or(LEAST_SPREAD, |sigmas| sigmas[b]);
        let mut given: Vec<Bone> = match (lengths, layout) {
            (Some(all), _) => (0..all.len()).map(|b| bone(b, all[b], sigma(b))).collect(),
            (None, Some(layout)) => {
                layout.lengths.iter().map(|l| bone(l.limb, l.mean_mm, l.sigma_mm)).collect()
            }
            (None, None) => Vec::new(),
        };
        given.retain(|bone| bone.length.sigma < bone.length.mean);
        let mut proportions = layout.map(proportions).unwrap_or_default();
        proportions.retain(|p| given.iter().all(|bone| bone.joints != p.joints));
        Ok(Self { given, proportions })
    }

    /// The given length of a bone between these joints.
    pub fn given(&self, joints: [usize; 2]) -> Option<Length> {
        self.given.iter().find(|bone| bone.joints == joints).map(|bone| bone.length)
    }

    /// The bones of a person of this stature, mm, known with this standard error.
    pub fn bones(&self, stature: [f64; 2]) -> impl Iterator<Item = Bone> + '_ {
        let of_population = move |p: &Proportion| Bone { joints: p.joints, length: p.at(stature) };
        self.given.iter().copied().chain(self.proportions.iter().map(of_population))
    }
}

impl Proportion {
    /// l and σ of the bone at this stature and its standard error, mm.
    pub fn at(&self, [stature, error]: [f64; 2]) -> Length {
        let mean = self.ratio * stature;
        let square = (self.spread * mean).powi(2)
            + (self.ratio * error).powi(2)
            + LEAST_SPREAD * LEAST_SPREAD;
        Length { mean, sigma: square.sqrt() }
    }
}

/// The stature that these bones show, with the population's as a prior, and its standard error, mm:
/// a weighted median, since some bones may be wrong.
pub fn stature(bones: impl Iterator<Item = Shown>) -> [f64; 2] {
    let weighed = |Shown { proportion: p, length, variance }: Shown| {
        let s = length / p.ratio;
        let variance = (variance + LEAST_SPREAD * LEAST_SPREAD) / (p.ratio * p.ratio);
        (s, 1.0 / (variance + (p.spread * s).powi(2)))
    };
    let mut all: Vec<(f64, f64)> = bones.map(weighed).collect();
    all.push((STATURE[0], STATURE[1].powi(-2)));
    let middle = weighted_median(&mut all, |shown| *shown);
    let total: f64 = all.iter().map(|(_, w)| w).sum();
    [if middle.is_nan() { STATURE[0] } else { middle }, (1.5 / total).sqrt()]
}

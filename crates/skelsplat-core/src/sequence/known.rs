//! What a sample of a recording shows about all of it: the same for every window.

use super::noise::Memory;
use super::process_noise::ProcessNoise;
use super::serialise::Serialiser;
use super::solver::Common;
use crate::bones::Length;
use crate::error::{Error, Result};
use crate::refine::Refiner;

/// What is known of a recording from a sample of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Known {
    /// Before the path of the sample was found: windows look for their path with the same
    /// knowledge.
    pub(super) first: Common,
    /// Along the path.
    pub(super) learnt: Learnt,
}

/// What is learnt along the path of a sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Learnt {
    /// What all frames have in common.
    pub common: Common,
    /// How long the detections' errors last.
    pub memory: Memory,
    /// Share of the residuals' variance that is noise; the rest are wrong detections that the
    /// kernel lets through.
    pub share: f64,
}

impl Known {
    /// It as numbers, for [`Self::restored`].
    pub fn numbers(&self) -> Vec<f64> {
        let mut serialiser = Serialiser::empty();
        self.clone().serialise(&mut serialiser);
        serialiser.numbers()
    }

    /// What [`Self::numbers`] returned, learnt with the same refiner.
    /// Errors: [`Error::InvalidInput`] if it is not that.
    pub fn restored(refiner: &Refiner, numbers: Vec<f64>) -> Result<Self> {
        let (n, mut serialiser) = (numbers.len(), Serialiser::of(numbers));
        let blank = || Common { bones: refiner.bones().to_vec(), ..Common::default() };
        let memory = Memory { constant: 0.0, rest: Vec::new() };
        let learnt = Learnt { common: blank(), memory, share: 0.0 };
        let mut known = Self { first: blank(), learnt };
        known.serialise(&mut serialiser);
        let whole = |c: &Common| {
            let of_joints = [c.process_noise.len(), c.variance.len(), c.sigma.len()];
            c.lengths.len() == c.bones.len() && of_joints == [known.n_joints(); 3]
        };
        match serialiser.is_read() && whole(&known.first) && whole(&known.learnt.common) {
            true => Ok(known),
            false => {
                let expected = "what was learnt with the same cameras, layout and settings";
                Err(Error::invalid("known", expected, format!("{n} numbers")))
            }
        }
    }

    /// Number of joints.
    pub(super) fn n_joints(&self) -> usize {
        self.first.sigma.len()
    }

    fn serialise(&mut self, serialiser: &mut Serialiser) {
        self.first.serialise(serialiser);
        self.learnt.common.serialise(serialiser);
        serialiser.number(&mut self.learnt.share);
        serialiser.number(&mut self.learnt.memory.constant);
        serialiser.list(&mut self.learnt.memory.rest, 0.0, |v, serialiser| serialiser.number(v));
    }
}

impl Common {
    /// All but the bones.
    fn serialise(&mut self, serialiser: &mut Serialiser) {
        [&mut self.fps, &mut self.weight, &mut self.reach]
            .into_iter()
            .for_each(|v| serialiser.number(v));
        serialiser.list(
            &mut self.lengths,
            Length { mean: 0.0, sigma: 0.0 },
            |length, serialiser| {
                serialiser.number(&mut length.mean);
                serialiser.number(&mut length.sigma);
            },
        );
        serialiser.list(
            &mut self.process_noise,
            ProcessNoise::steady(0.0),
            ProcessNoise::serialise,
        );
        serialiser.list(&mut self.variance, 0.0, |v, serialiser| serialiser.number(v));
        serialiser.list(&mut self.sigma, 0.0, |v, serialiser| serialiser.number(v));
    }
}

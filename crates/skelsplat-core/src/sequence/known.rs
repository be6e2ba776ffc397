//! What a sample of a recording shows about all of it: the same for every window.

use super::lasting::Memory;
use super::process_noise::ProcessNoise;
use super::serialise::Serialiser;
use super::solver::Common;
use crate::bones::Length;
use crate::error::{Error, Result};
use crate::refine::Refiner;

/// What is known of a recording from a sample of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Known {
    /// The body's size in multiples of a person's.
    pub(super) size: f64,
    /// Before the path of the sample was found: windows look for their path with the same
    /// knowledge.
    pub(super) first: Common,
    /// Along the path under wide kernels.
    pub(super) wide: Common,
    /// Along the path.
    pub(super) learnt: Learnt,
}

/// What is learnt along the path of a sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Learnt {
    /// What all frames have in common.
    pub common: Common,
    /// How long the errors of each joint's detections last.
    pub memory: Vec<Memory>,
    /// How much of the leverage in its frame alone the positions of each joint take up.
    pub taken: Vec<f64>,
    /// Whether the sample shows each bone, as 1 or 0.
    pub shown: Vec<f64>,
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
        let learnt =
            Learnt { common: blank(), memory: Vec::new(), taken: Vec::new(), shown: Vec::new() };
        let mut known = Self { size: 1.0, first: blank(), wide: blank(), learnt };
        known.serialise(&mut serialiser);
        let whole = |c: &Common| {
            let of_joints = [c.process_noise.len(), c.noise.kernel.sigma.len()];
            c.lengths.len() == c.bones.len()
                && known.learnt.shown.len() == c.bones.len()
                && of_joints == [known.n_joints(); 2]
        };
        let commons = [&known.first, &known.wide, &known.learnt.common];
        match serialiser.is_read() && commons.into_iter().all(whole) {
            true => Ok(known),
            false => {
                let expected = "what was learnt with the same cameras, layout and settings";
                Err(Error::invalid("known", expected, format!("{n} numbers")))
            }
        }
    }

    /// Number of joints.
    pub(super) fn n_joints(&self) -> usize {
        self.first.noise.kernel.sigma.len()
    }

    fn serialise(&mut self, serialiser: &mut Serialiser) {
        serialiser.number(&mut self.size);
        self.first.serialise(serialiser);
        self.wide.serialise(serialiser);
        self.learnt.common.serialise(serialiser);
        for list in [&mut self.learnt.taken, &mut self.learnt.shown] {
            serialiser.list(list, 0.0, |v, serialiser| serialiser.number(v));
        }
        let blank = Memory { constant: 0.0, rest: Vec::new() };
        serialiser.list(&mut self.learnt.memory, blank, |memory, serialiser| {
            serialiser.number(&mut memory.constant);
            serialiser.list(&mut memory.rest, 0.0, |v, serialiser| serialiser.number(v));
        });
    }
}

impl Common {
    /// All but the bones.
    fn serialise(&mut self, serialiser: &mut Serialiser) {
        [&mut self.fps, &mut self.reach].into_iter().for_each(|v| serialiser.number(v));
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
        self.noise.serialise(serialiser);
    }
}

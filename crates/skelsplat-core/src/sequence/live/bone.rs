//! Lengths of bones, learnt as the frames arrive.

use nalgebra::{Matrix3, Vector3};

use super::filter::LARGEST;
use crate::bones::{Length, Pull};
use crate::matrix3::times;
use crate::sequence::learn::{LEAST, LEAST_SPREAD};
use crate::sequence::outcome::Answer;

/// The length of a bone, from the frames that see both ends.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct RunningLength {
    /// mm.
    mean: f64,
    /// Mean square of the deviations, and their mean variance by the error bars, mm².
    square: f64,
    noise: f64,
    /// Frames.
    count: f64,
}

impl RunningLength {
    pub(super) fn learn(&mut self, a: &Answer, b: &Answer) {
        let d = a.at - b.at;
        let (length, u) = (d.norm(), d.normalize());
        let variance = u.dot(&times(&(a.covariance + b.covariance), &u));
        if !(variance.is_finite() && length > 0.0) {
            return;
        }
        self.count += 1.0;
        if self.count == 1.0 {
            (self.mean, self.square, self.noise) = (length, variance, variance);
            return;
        }
        let share = 1.0 / self.count;
        let off = length - self.mean;
        let most = (LARGEST * self.square.max(self.noise)).sqrt();
        self.mean += share * off.clamp(-most, most);
        self.square += share * ((off * off).min(most * most) - self.square);
        self.noise += share * (variance - self.noise);
    }

    /// `None` before enough frames have shown it.
    pub(super) fn length(&self) -> Option<Length> {
        let own = (self.square - self.noise).max(0.0).sqrt();
        let sigma = own.max(LEAST_SPREAD);
        (self.count >= LEAST as f64).then_some(Length { mean: self.mean, sigma })
    }
}

/// A bone to a joint of the frame that is known already.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Tie {
    pub(super) to: Answer,
    pub(super) length: Length,
    /// Whether bones lead on to a joint that its views determine: joints of which the past alone
    /// tells the depth have the same error, and do not confirm each other.
    pub(super) is_held: bool,
}

impl Tie {
    /// Its information about a joint at `x`, and minus its gradient.
    pub(super) fn pull(&self, x: &Vector3<f64>) -> (Matrix3<f64>, Vector3<f64>) {
        let u = (x - self.to.at).normalize();
        let variance = self.length.sigma.powi(2) + u.dot(&times(&self.to.covariance, &u));
        let length = Length { mean: self.length.mean, sigma: variance.sqrt() };
        let pull = Pull::new(x, &self.to.at, length);
        (pull.block(), -pull.gradient())
    }
}

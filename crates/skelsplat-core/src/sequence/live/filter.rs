//! The causal estimate of one joint: a constant-velocity Kalman state, and its process noise.
//!
//! Position x and velocity v have the covariance blocks P_xx, P_xv and P_vv. White acceleration of
//! the spectral density q adds q dt³/3, q dt²/2 and q dt to them over dt. A frame that moves the
//! position to x⁺ with the covariance S moves the velocity along,
//!
//! ```text
//! G = P_vx P_xx⁻¹     v⁺ = v + G (x⁺ − x)     P_xv⁺ = S Gᵀ     P_vv⁺ = P_vv − G (P_xx − S) Gᵀ
//! ```
//!
//! S is the posterior of the frame with P_xx as its prior, so that the prior counts once.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector3};

use crate::matrix3::{inverse, product, symmetrised, times};
use crate::sequence::learn::LEAST;
use crate::sequence::process_noise::{
    SHARE, SPAN, USUAL_PROCESS_NOISE, bounded, density, of_span, white_part,
};
use crate::sequence::times::{OVERLAP, frames_in};

/// Standard deviation of an unknown velocity, mm/s per axis, and the speed of somebody unseen.
pub(crate) const ANY_SPEED: f64 = 2000.0;
/// The largest square of a deviation that counts, in multiples of the mean.
pub(super) const LARGEST: f64 = 6.0;
/// Longest span, frames.
const LONGEST: usize = 128;

/// Position and velocity of a joint, mm and mm/s.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct KalmanState {
    /// x.
    pub at: Vector3<f64>,
    /// v.
    pub velocity: Vector3<f64>,
    /// P_xx.
    pub position: Matrix3<f64>,
    /// P_xv.
    pub cross: Matrix3<f64>,
    /// P_vv.
    pub speed: Matrix3<f64>,
}

impl KalmanState {
    /// At rest, as far as is known.
    pub fn new(at: Vector3<f64>, position: Matrix3<f64>) -> Self {
        let speed = Matrix3::from_diagonal_element(ANY_SPEED * ANY_SPEED);
        Self { at, position, speed, ..Self::default() }
    }

    /// The state after `dt` seconds, with acceleration of density `q`, mm²/s³.
    pub fn predict(&mut self, dt: f64, q: f64) {
        self.at += self.velocity * dt;
        let both = self.cross + self.cross.transpose();
        self.position += both * dt + self.speed * (dt * dt);
        self.cross += self.speed * dt;
        let identity = Matrix3::identity();
        self.position += identity * (q * dt.powi(3) / 3.0);
        self.cross += identity * (q * dt * dt / 2.0);
        self.speed += identity * (q * dt);
    }

    /// Moves to `at` with the covariance `position`, which contain the prediction.
    pub fn update(&mut self, at: Vector3<f64>, position: Matrix3<f64>) {
        let gain = product(&self.cross.transpose(), &inverse(&self.position));
        self.velocity += times(&gain, &(at - self.at));
        let gained = product(&product(&gain, &(self.position - position)), &gain.transpose());
        self.speed = symmetrised(&(self.speed - gained));
        self.cross = product(&position, &gain.transpose());
        (self.at, self.position) = (at, position);
    }
}

/// What shows a joint's process noise: running means of its second differences over 1, 2, 4, …
/// frames, see [`crate::sequence::process_noise`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MotionStatistics {
    /// The last positions that a frame alone determined, NaN for other frames; the newest first.
    past: VecDeque<Vector3<f64>>,
    /// Mean square of the second difference per axis over each span, mm².
    squares: Vec<f64>,
    /// Variance of a frame's position, mm².
    variance: f64,
    /// Frames that contributed.
    count: f64,
}

impl MotionStatistics {
    /// Takes in the position of a frame and its variance per axis; NaN if the frame does not
    /// determine it.
    pub fn learn(&mut self, at: Vector3<f64>, variance: f64, fps: f64) {
        let longest = longest(fps);
        self.past.push_front(at);
        self.past.truncate(2 * longest + 1);
        if at.x.is_nan() {
            return;
        }
        if self.squares.is_empty() {
            self.variance = variance;
            let usual = |h| of_span(h, USUAL_PROCESS_NOISE, variance, fps);
            self.squares = spans(longest).map(usual).collect();
            self.count = LEAST as f64;
        }
        self.count = (self.count + 1.0).min(OVERLAP * fps).max(LEAST as f64);
        let share = 1.0 / self.count;
        self.variance += share * (variance - self.variance);
        for (mean, h) in self.squares.iter_mut().zip(spans(longest)) {
            let (Some(middle), Some(last)) = (self.past.get(h), self.past.get(2 * h)) else {
                break;
            };
            let square = (at - 2.0 * middle + last).norm_squared() / 3.0;
            if square.is_finite() {
                *mean += share * (square.min(LARGEST * *mean) - *mean);
            }
        }
    }

    /// The spectral density q of its acceleration, mm²/s³.
    pub fn process_noise(&self, fps: f64) -> f64 {
        let Some(first) = self.squares.first() else { return USUAL_PROCESS_NOISE };
        let white = white_part(*first, self.variance);
        let spans = spans(longest(fps)).zip(&self.squares);
        let q = density(spans.map(|(h, square)| (h, *square)), white, fps);
        bounded(SHARE * q, white, self.variance, fps)
    }

    /// Variance per axis by which the joint leaves a straight path within so many frames, mm²: that
    /// of the second differences over the time, of which the longer ones are extrapolated with its
    /// third power. A swinging arm leaves it by more than white acceleration does.
    pub fn leaves(&self, frames: f64) -> f64 {
        let longest = 1 << self.squares.len().saturating_sub(1);
        let at = spans(longest).position(|h| h as f64 >= frames);
        let k = at.unwrap_or(self.squares.len().saturating_sub(1));
        let (h, square) = (f64::from(1_u32 << k), self.squares.get(k).copied().unwrap_or(0.0));
        square * (frames / h).powi(3)
    }
}

/// The longest span, frames.
fn longest(fps: f64) -> usize {
    frames_in(SPAN, fps).min(LONGEST)
}

/// 1, 2, 4, … up to `longest` frames.
fn spans(longest: usize) -> impl Iterator<Item = usize> {
    std::iter::successors(Some(1), |h| Some(2 * h)).take_while(move |h| *h <= longest)
}

//! One joint between frames: prediction, gate, update and error bar.

use nalgebra::{Matrix3, Vector3};

use super::bone::Tie;
use super::filter::{KalmanState, MotionStatistics};
use crate::annealed::consensus::REJECTED;
use crate::annealed::depth::DISTINCT;
use crate::annealed::posterior::INFERRED;
use crate::annealed::rays::{Ray, there};
use crate::matrix3::{inverse, symmetrised, times};
use crate::outcome::JointStatus;
use crate::sequence::lasting::Memory;
use crate::sequence::outcome::Answer;
use crate::sequence::solver::UNSURE_REACH;
use crate::sequence::times::{AROUND, INDEPENDENT};

/// Frames for which the state before a jump is kept.
const ASIDE: f64 = 3.0;
/// Steps for a joint with rays weighted by their distance from it.
pub(super) const STEPS: usize = 4;
/// Steps for one that its views determine.
const FEW_STEPS: usize = 2;

/// What is known of a joint between frames.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct LiveJoint {
    /// `None` before it is seen and after it has been lost.
    state: Option<KalmanState>,
    /// The state before a jump.
    aside: Option<KalmanState>,
    /// Frames since the jump.
    since: f64,
    /// Time since a detection was believed, s.
    unseen: f64,
    /// The last position at which it was seen; NaN if never.
    last: Vector3<f64>,
    motion: MotionStatistics,
    /// Mean of R⁻¹.
    information: Matrix3<f64>,
    /// C − S.
    excess: Matrix3<f64>,
    /// Mean weight of every view's detections.
    trust: Vec<f64>,
}

/// What a frame alone shows of a joint.
pub(super) struct Observation<'a> {
    pub(super) rays: &'a [Ray],
    pub(super) alone: Answer,
    /// Final kernel, mm.
    pub(super) sigma: f64,
    /// Noise variance of a detection of weight 1, mm², and of one of mean weight.
    pub(super) variance: f64,
    pub(super) mean_variance: f64,
    /// The body's spread, mm.
    pub(super) reach: f64,
    pub(super) fps: f64,
    pub(super) memory: &'a Memory,
    /// Its bones to joints that are known already.
    pub(super) ties: Vec<Tie>,
}

impl Observation<'_> {
    /// Whether three views, or both of two, agree on the position.
    pub(super) fn is_sure(&self) -> bool {
        let near = |ray: &&Ray| ray.offset(&self.alone.at).weight(self.sigma) >= REJECTED;
        let agree = there(self.rays).filter(near).count();
        self.alone.status == JointStatus::Ok && (agree > 2 || there(self.rays).count() == 2)
    }

    /// The joint after so many steps from `at`, and its covariance, by the prediction, its bones
    /// and the information and pull that the frame `adds` at a position.
    fn settled(
        &self,
        state: &KalmanState,
        mut at: Vector3<f64>,
        steps: usize,
        adds: impl Fn(&Vector3<f64>, &mut Matrix3<f64>, &mut Vector3<f64>),
    ) -> (Vector3<f64>, Matrix3<f64>) {
        let prior = inverse(&state.position);
        let mut known = prior;
        for _ in 0..steps {
            let (mut shape, mut pull) = (Matrix3::zeros(), times(&prior, &(state.at - at)));
            known = prior;
            adds(&at, &mut known, &mut pull);
            for tie in &self.ties {
                let (block, b) = tie.pull(&at);
                *(if tie.is_held { &mut known } else { &mut shape }) += block;
                pull += b;
            }
            at += times(&inverse(&(known + shape)), &pull);
        }
        (at, symmetrised(&inverse(&known)))
    }
}

impl LiveJoint {
    pub(super) fn new(views: usize) -> Self {
        Self { last: Vector3::repeat(f64::NAN), trust: vec![1.0; views], ..Self::default() }
    }

    /// The spectral density of its acceleration, mm²/s³.
    pub(super) fn process_noise(&self, fps: f64) -> f64 {
        self.motion.process_noise(fps)
    }

    pub(super) fn predict(&mut self, fps: f64) {
        let (dt, q) = (1.0 / fps, self.process_noise(fps));
        self.state.iter_mut().chain(&mut self.aside).for_each(|state| state.predict(dt, q));
        self.since += 1.0;
        if self.since > ASIDE {
            self.aside = None;
        }
    }

    /// Where it should be: at the prediction, or else where it was seen last.
    pub(super) fn expected(&self) -> Vector3<f64> {
        self.state.as_ref().map_or(self.last, |state| state.at)
    }

    /// The joint in the frame.
    pub(super) fn step(&mut self, seen: &Observation<'_>) -> Answer {
        let sure = seen.alone.status == JointStatus::Ok;
        let at = if sure { seen.alone.at } else { Vector3::repeat(f64::NAN) };
        self.motion.learn(at, seen.mean_variance, seen.fps);
        let answer = match (sure, self.state.take()) {
            (true, state) => self.follow(state, seen),
            (false, Some(state)) => self.bridge(state, seen),
            (false, None) => seen.alone,
        };
        if answer.status != JointStatus::Unobserved && self.unseen == 0.0 {
            self.last = answer.at;
        }
        let share = (1.0 / (INDEPENDENT * seen.fps)).min(1.0);
        for (ray, trust) in seen.rays.iter().zip(&mut self.trust) {
            if ray.is_there() && answer.at.x.is_finite() {
                *trust += share * (ray.offset(&answer.at).weight(seen.sigma) - *trust);
            }
        }
        answer
    }

    /// δ² of the frame's position from a prediction, with the error bar of the latter.
    fn distance(&self, state: &KalmanState, alone: &Answer) -> f64 {
        let off = alone.at - state.at;
        let total = alone.covariance + state.position + self.excess;
        off.dot(&times(&inverse(&total), &off))
    }

    /// The state that a position continues, `None` after a jump.
    fn gate(&mut self, state: Option<KalmanState>, alone: &Answer) -> Option<KalmanState> {
        let kept = self.aside.take();
        let fits = |state: &KalmanState| self.distance(state, alone) <= DISTINCT;
        let (state, aside) = match (state, kept) {
            (Some(state), aside) if fits(&state) => (Some(state), aside),
            (_, Some(aside)) if fits(&aside) => (Some(aside), None),
            (state, _) => {
                self.since = 0.0;
                (None, state)
            }
        };
        self.aside = aside;
        state
    }

    /// Where the views determine a position.
    fn follow(&mut self, state: Option<KalmanState>, seen: &Observation<'_>) -> Answer {
        self.unseen = 0.0;
        let alone = &seen.alone;
        let state = self.gate(state, alone);
        let of_frame = inverse(&alone.covariance);
        let first = self.information.trace() <= 0.0;
        let share = if first { 1.0 } else { 1.0 / (AROUND * seen.fps).max(1.0) };
        self.information += (of_frame - self.information) * share;
        let Some(mut state) = state else {
            self.excess = Matrix3::zeros();
            self.state = Some(KalmanState::new(alone.at, alone.covariance));
            return *alone;
        };
        state.position *= 1.0 + self.distance(&state, alone) / (UNSURE_REACH * UNSURE_REACH);
        let (at, spread) = seen.settled(&state, alone.at, FEW_STEPS, |at, information, pull| {
            *information += of_frame;
            *pull += times(&of_frame, &(alone.at - at));
        });
        state.update(at, spread);
        let memory = seen.memory;
        let covariance = spread * memory.widens(&spread, &of_frame)
            + inverse(&self.information) * memory.constant;
        let excess = covariance - spread;
        self.excess = if excess.cholesky().is_some() { excess } else { Matrix3::zeros() };
        self.state = Some(state);
        Answer { at, covariance, status: JointStatus::Ok }
    }

    /// Where they do not.
    fn bridge(&mut self, mut state: KalmanState, seen: &Observation<'_>) -> Answer {
        let trusted = || seen.rays.iter().zip(&self.trust).filter(|(ray, _)| ray.is_there());
        let (at, spread) = seen.settled(&state, state.at, STEPS, |at, information, pull| {
            for (ray, trust) in trusted() {
                let offset = ray.offset(at);
                let w = ray.weight * offset.weight(seen.sigma) * trust / seen.variance;
                *information += ray.information() * w;
                *pull -= offset.across * w;
            }
        });
        let kernel = |ray: &Ray| ray.offset(&at).weight(seen.sigma);
        let kept: Vec<f64> = there(seen.rays).map(kernel).collect();
        let (n, weight) = (kept.len() as f64, kept.iter().sum());
        state.update(at, spread);
        let is_seen = kept.iter().any(|k| *k >= REJECTED);
        self.unseen = if is_seen { 0.0 } else { self.unseen + 1.0 / seen.fps };
        if self.unseen > AROUND {
            return seen.alone;
        }
        let rejected = n / f64::max(weight, REJECTED);
        let away = Matrix3::from_diagonal_element(self.motion.leaves(self.unseen * seen.fps));
        let covariance = (spread + self.excess) * f64::max(rejected, 1.0) + away;
        let widest = covariance.symmetric_eigenvalues().max().sqrt();
        let is_known = n == 0.0 || widest <= INFERRED * seen.reach;
        if !is_known && seen.alone.covariance.trace() < covariance.trace() {
            return seen.alone; // the past knows less than the frame
        }
        self.state = Some(state);
        let status = if is_known { JointStatus::Inferred } else { JointStatus::Weak };
        Answer { at, covariance, status }
    }
}

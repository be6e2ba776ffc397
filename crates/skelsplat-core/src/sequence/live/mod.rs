//! Frame by frame as they arrive: the past predicts, the detections decide.
//!
//! Every joint has a [`filter::KalmanState`], moved on to the next frame. The frame is solved alone
//! first. Where its views determine a position y with the covariance R, it is compared with the
//! prediction x of covariance P by the Mahalanobis distance δ of the two,
//!
//! ```text
//! δ² = (y − x)ᵀ (R + P)⁻¹ (y − x)
//! ```
//!
//! Up to δ = 5 the prediction is the prior of the position, with P times 1 + δ²/9 (a Cauchy
//! kernel); beyond it the joint has jumped: no prior, and the state starts again at y. The state
//! before is kept aside for three frames, in case the views agreed by chance. Where the views
//! determine no position, the rays near the prediction count, and the prediction gives the rest;
//! without any ray it bridges up to half a second. Bones of learnt lengths tie a joint to others of
//! the same frame; those that lead to no joint seen by its views keep the body's shape, no more.
//!
//! Errors of detections last, and a filter averages over frames: the error bar is C = (1 − c) f(n)
//! S + c R̄, with the posterior S, the memory (c, f) that errors usually have ([`Memory::usual`]),
//! n = 3/tr(S R⁻¹) and the mean R̄⁻¹ of R⁻¹ over half a second, as in [`super::posterior`]. C − S
//! stays where a later frame determines no position; there C grows with the share of the rays that
//! the position contradicts.
//!
//! With a lag of n frames the last of these are solved once more, like a recording (`window.rs`).

use std::sync::Arc;

mod bone;
pub mod filter;
mod joint;
mod window;

use self::bone::{RunningLength, Tie};
use self::joint::{LiveJoint, Observation, STEPS};
use self::window::LagWindow;
use super::lasting::Memory;
use super::learn::Learnt;
use super::noise::{DetectionNoise, Kernel};
use super::outcome::{Answer, SolvedJoint, together};
use super::process_noise::ProcessNoise;
use super::recording::check;
use super::size::{USUAL_SPREAD, body_size};
use super::solver::Common;
use crate::annealed::Alone;
use crate::annealed::posterior::{BodyExtent, LEAST_SPREAD};
use crate::batch::Progress;
use crate::bones::{Length, other_end};
use crate::detections::Detections;
use crate::error::{Error, Result};
use crate::outcome::JointStatus;
use crate::refine::{Frame, Refinement, Refiner};
use crate::sequence::times::AROUND;

/// The state of all joints between frames.
#[derive(Debug, Clone)]
pub struct Live {
    fps: f64,
    memory: Memory,
    joints: Vec<LiveJoint>,
    /// Lengths of the layout's limbs.
    bones: Vec<RunningLength>,
    /// Logarithm of the mean noise variance of a detection of weight 1, mm²; NaN before the first
    /// detection.
    noise: f64,
    /// Mean spread of the body, mm; NaN before it is known.
    reach: f64,
    /// The body's size in multiples of a person's; NaN before it is known.
    size: f64,
    /// The refiner of bodies of this size, unless it is a person's.
    scaled: Option<Arc<Refiner>>,
    /// The last frames, where the answer lags behind.
    window: Option<LagWindow>,
}

/// Every step solves all frames of the lag again, and beyond a second they hardly change.
const MOST_LAG: usize = 10_000;

impl Live {
    /// Nothing is known yet, of frames at this rate. The answer is the frame `lag` frames before
    /// the last.
    ///
    /// # Errors
    /// [`Error::InvalidInput`] if `fps` is not a positive number, `lag` is too large, or for
    /// another method than `annealed`.
    pub fn new(refiner: &Refiner, fps: f64, lag: usize) -> Result<Self> {
        check(refiner, fps, "'annealed' where fps is given")?;
        if lag > MOST_LAG {
            return Err(Error::invalid(
                "lag",
                format!("at most {MOST_LAG} frames"),
                lag.to_string(),
            ));
        }
        let window = (lag > 0).then(|| LagWindow::new(lag, fps));
        Ok(Self {
            fps,
            memory: Memory::usual(fps),
            joints: Vec::new(),
            bones: Vec::new(),
            noise: f64::NAN,
            reach: f64::NAN,
            size: f64::NAN,
            scaled: None,
            window,
        })
    }

    /// Forgets all frames.
    pub fn reset(&mut self) {
        self.joints.clear();
        self.bones.clear();
        (self.noise, self.reach, self.size) = (f64::NAN, f64::NAN, f64::NAN);
        self.window.iter_mut().for_each(LagWindow::clear);
    }

    /// The next frame; with a lag, the pose of the frame that lies so many before it, NaN if there
    /// is none.
    ///
    /// # Errors
    /// As [`Refiner::refine`], and [`Error::InvalidInput`] if the number of joints differs from the
    /// frames before.
    pub fn step(
        &mut self,
        refiner: &Refiner,
        detections: Detections,
        progress: &Progress,
    ) -> Result<Refinement> {
        progress.check()?;
        let (m, n) = (detections.n_views(), detections.n_joints());
        if !self.joints.is_empty() && self.joints.len() != n {
            let before = self.joints.len();
            let expected =
                format!("{before} joints, as in the previous frames (or call reset() first)");
            return Err(Error::invalid("detections", expected, n.to_string()));
        }
        let mut frame = Frame::from(detections);
        refiner.check(&frame)?;
        let scaled = self.scaled(refiner, &frame)?;
        let refiner = scaled.as_deref().unwrap_or(refiner);
        self.joints.resize_with(n, || LiveJoint::new(m));
        self.joints.iter_mut().for_each(|joint| joint.predict(self.fps));
        let mm = refiner.millimetres();
        frame.init_pose = Some(self.joints.iter().map(|joint| joint.expected() / mm).collect());
        let alone = refiner.alone(&frame)?;
        self.learn(&alone);
        let answers = self.answers(refiner, &alone);
        match self.window.take() {
            None => Ok(self.refinement(refiner, &frame.detections, alone, &answers)),
            Some(mut window) => {
                window.push(alone, frame.detections, answers);
                let learnt = self.learnt(refiner, window.last());
                let lagging = window.answer(&learnt, refiner);
                self.window = Some(window);
                Ok(lagging)
            }
        }
    }

    /// The refiner of bodies of this size, which the first frames show; `None`: a person's.
    fn scaled(&mut self, refiner: &Refiner, frame: &Frame) -> Result<Option<Arc<Refiner>>> {
        if self.size.is_nan() {
            self.size = body_size(refiner, &[std::slice::from_ref(frame)])?;
            let is_other = self.size.is_finite() && self.size != 1.0;
            self.scaled = is_other.then(|| Arc::new(refiner.at_size(self.size)));
        }
        Ok(self.scaled.clone())
    }

    /// The noise and the body's spread.
    fn learn(&mut self, alone: &Alone) {
        let share = 1.0 / (AROUND * self.fps).max(1.0);
        let follow = |mean: &mut f64, now: f64| {
            if mean.is_nan() {
                *mean = now;
            } else if now.is_finite() {
                *mean += share * (now - *mean);
            }
        };
        follow(&mut self.noise, (alone.bars.noise.powi(2) * alone.rays.mean_weight()).ln());
        let least = LEAST_SPREAD * alone.bars.noise;
        let seen = BodyExtent::spread(&alone.points).filter(|s| *s > least).unwrap_or(f64::NAN);
        follow(&mut self.reach, seen);
    }

    /// Noise variance of a detection of weight 1, mm².
    fn variance(&self) -> f64 {
        self.noise.exp()
    }

    fn reach(&self) -> f64 {
        if self.reach.is_nan() { USUAL_SPREAD } else { self.reach }
    }

    /// Final kernels, mm.
    fn kernels(&self, refiner: &Refiner, alone: &Alone) -> Vec<f64> {
        let noise = (self.variance() / alone.rays.mean_weight()).sqrt();
        Kernel::of(refiner, alone.points.len()).of_noise(noise)
    }

    /// What a frame alone shows of every joint, without its bones.
    fn seen<'a>(
        &self,
        refiner: &Refiner,
        alone: &'a Alone,
        memory: &'a Memory,
    ) -> Vec<Observation<'a>> {
        let (sigma, mean_weight) = (self.kernels(refiner, alone), alone.rays.mean_weight());
        let of_joint = |j: usize| Observation {
            rays: alone.rays.of_joint(j),
            alone: alone.joint(j),
            sigma: sigma[j],
            variance: self.variance(),
            mean_variance: self.variance() / mean_weight,
            reach: self.reach(),
            fps: self.fps,
            memory,
            ties: Vec::new(),
        };
        (0..alone.points.len()).map(of_joint).collect()
    }

    /// The joints: those that their views determine, the surest first, then the others, those next
    /// to known ones first.
    fn answers(&mut self, refiner: &Refiner, alone: &Alone) -> Vec<Answer> {
        let (n, memory) = (alone.points.len(), self.memory.clone());
        let mut seen = self.seen(refiner, alone, &memory);
        let bones = refiner.bones();
        self.bones.resize_with(bones.len(), RunningLength::default);
        let is_sure: Vec<bool> = seen.iter().map(Observation::is_sure).collect();
        for (bone, [a, b]) in self.bones.iter_mut().zip(bones) {
            if is_sure[*a] && is_sure[*b] {
                bone.learn(&seen[*a].alone, &seen[*b].alone);
            }
        }
        let is_determined = |j: &usize| alone.bars.status[*j] == JointStatus::Ok;
        let (mut left, unsure): (Vec<usize>, Vec<usize>) = (0..n).partition(is_determined);
        let trace = |j: &usize| alone.bars.covariances[*j].trace();
        left.sort_by(|a, b| trace(a).total_cmp(&trace(b)));
        let mut determined = left.len();
        left.extend(unsure);
        let mut answers = vec![None; n];
        while !left.is_empty() {
            let tied = |j: &usize| self.ties(*j, &answers, refiner).next().is_some();
            let next = if determined > 0 { None } else { left.iter().position(tied) };
            let j = left.remove(next.unwrap_or(0));
            seen[j].ties = self.ties(j, &answers, refiner).collect();
            let is_held = determined > 0 || seen[j].ties.iter().any(|tie| tie.is_held);
            determined = determined.saturating_sub(1);
            answers[j] = Some((self.joints[j].step(&seen[j]), is_held));
        }
        answers.into_iter().flatten().map(|(answer, _)| answer).collect()
    }

    /// The bones of joint `j` to joints that are known, and whether these are held.
    fn ties(
        &self,
        j: usize,
        answers: &[Option<(Answer, bool)>],
        refiner: &Refiner,
    ) -> impl Iterator<Item = Tie> {
        let tie = move |(length, bone): (Option<Length>, &[usize; 2])| {
            let (to, is_held) = answers[other_end(*bone, j)?]?;
            let length = length?;
            let known = to.at.x.is_finite() && to.covariance.trace().is_finite();
            known.then_some(Tie { to, length, is_held })
        };
        self.lengths(refiner).zip(refiner.bones()).filter_map(tie)
    }

    /// The length of every bone, as far as it is known: that which the user gives counts until
    /// frames have shown the bone.
    fn lengths(&self, refiner: &Refiner) -> impl Iterator<Item = Option<Length>> {
        let given = |ends: &[usize; 2]| refiner.expected.given(*ends);
        let bones = self.bones.iter().zip(refiner.bones());
        bones.map(move |(bone, ends)| bone.length().or_else(|| given(ends)))
    }

    /// What the frames so far tell a recording.
    fn learnt(&self, refiner: &Refiner, last: &Alone) -> Learnt {
        let unknown = Length { mean: 0.0, sigma: f64::INFINITY };
        let steady = |joint: &LiveJoint| ProcessNoise::steady(joint.process_noise(self.fps));
        let common = Common {
            fps: self.fps,
            bones: refiner.bones().to_vec(),
            lengths: self.lengths(refiner).map(|length| length.unwrap_or(unknown)).collect(),
            process_noise: self.joints.iter().map(steady).collect(),
            noise: DetectionNoise::uniform(
                vec![last.rays.mean_weight(); last.rays.n_views()],
                self.variance() / last.rays.mean_weight(),
                Kernel::of(refiner, self.joints.len()),
            ),
            reach: self.reach(),
        };
        Learnt { common, memory: vec![self.memory.clone(); self.joints.len()], shown: Vec::new() }
    }

    fn refinement(
        &self,
        refiner: &Refiner,
        detections: &Detections,
        alone: Alone,
        answers: &[Answer],
    ) -> Refinement {
        let sigma = self.kernels(refiner, &alone);
        let joint = |(j, answer): (usize, &Answer)| {
            let scale = 2.0 * sigma[j].powi(2) / self.variance();
            let (mut believed, mut loss) = (Vec::new(), 0.0);
            for ray in alone.rays.of_joint(j) {
                let k = ray.trust(&answer.at, sigma[j]).unwrap_or(f64::NAN);
                believed.push(k);
                loss += if k.is_finite() { ray.weight * scale * (1.0 - k) } else { 0.0 };
            }
            SolvedJoint { answer: *answer, believed, loss }
        };
        let joints: Vec<SolvedJoint> = answers.iter().enumerate().map(joint).collect();
        let Alone { used_for, points, bars, .. } = alone;
        let (outcome, bars) = together(&joints, sigma, bars.noise, points, used_for, STEPS);
        refiner.result(detections, outcome, &bars)
    }
}

//! The last frames once more, like a recording: a frame is known better once the frames after it
//! are known.

use nalgebra::{Matrix3, Vector3};

use crate::annealed::Alone;
use crate::batch::Progress;
use crate::detections::Detections;
use crate::outcome::{JointStatus, as_given};
use crate::refine::{Refinement, Refiner};
use crate::sequence::learn::Learnt;
use crate::sequence::noise::Kernel;
use crate::sequence::outcome::{Answer, SolvedJoint, SolvedWindow, together};
use crate::sequence::posterior::posterior;
use crate::sequence::solver::{Schedule, WindowSolver};
use crate::sequence::times::{BRIDGE, frames_in};
use crate::sequence::tracks::Tracks;

/// Most frames before the answered one that are solved along: those over which joints are bridged.
const MOST_BEFORE: usize = 120;
/// Every frame starts where the frame before left it.
const SETTLE: &Schedule = &[(1.0, 3)];

/// The last frames.
#[derive(Debug, Clone)]
pub(super) struct LagWindow {
    lag: usize,
    longest: usize,
    /// The oldest first.
    alone: Vec<Alone>,
    rest: Vec<Rest>,
}

/// A frame's detections, its causal answer, and the last solution of the window.
#[derive(Debug, Clone)]
struct Rest {
    detections: Detections,
    /// As the filter answers.
    answers: Vec<Answer>,
    /// As the last window left them, mm.
    points: Vec<Vector3<f64>>,
}

impl LagWindow {
    pub(super) fn new(lag: usize, fps: f64) -> Self {
        let longest = lag.saturating_add(frames_in(BRIDGE, fps).min(MOST_BEFORE) + 1);
        Self { lag, longest, alone: Vec::new(), rest: Vec::new() }
    }

    pub(super) fn clear(&mut self) {
        self.alone.clear();
        self.rest.clear();
    }

    pub(super) fn push(&mut self, alone: Alone, detections: Detections, answers: Vec<Answer>) {
        if self.alone.len() == self.longest {
            self.alone.remove(0);
            self.rest.remove(0);
        }
        self.alone.push(alone);
        let points = answers.iter().map(|answer| answer.at).collect();
        self.rest.push(Rest { detections, answers, points });
    }

    /// The last frame.
    pub(super) fn last(&self) -> &Alone {
        &self.alone[self.alone.len() - 1]
    }

    /// The frame `lag` frames before the last.
    pub(super) fn answer(&mut self, learnt: &Learnt, refiner: &Refiner) -> Refinement {
        let Some(t) = self.alone.len().checked_sub(self.lag + 1) else {
            return self.nothing(refiner);
        };
        let common = &learnt.common;
        let (n, frames) = (self.alone[0].points.len(), self.alone.len());
        let mut tracks = Tracks::new(&[&self.alone], frames_in(BRIDGE, common.fps), &common.noise);
        tracks.find_cuts(common.fps, &common.usual());
        let at = |k: usize| self.rest[k % frames].points[k / frames];
        let known = |k: usize| if at(k).x.is_finite() { at(k) } else { Vector3::zeros() };
        let start = (0..n * frames).map(known).collect();
        let mut run = WindowSolver::new(&tracks, common, Some(start));
        let _ = run.anneal(SETTLE, &Progress::default());
        run.linearise(1.0);
        for (k, x) in run.points.iter().enumerate().filter(|(k, _)| tracks.active[*k]) {
            self.rest[k % frames].points[k / frames] = *x;
        }
        let found = posterior(&run, learnt);
        let state = SolvedWindow::of(&run, &found);
        let (alone, rest) = (&self.alone[t], &self.rest[t]);
        let (init, used_for) = (alone.points.clone(), alone.used_for.clone());
        let (outcome, bars) = state.outcome(t, &rest.answers, init, used_for, run.n_iter);
        refiner.result(&rest.detections, outcome, &bars)
    }

    /// The answer before there is one.
    fn nothing(&self, refiner: &Refiner) -> Refinement {
        let detections = self.rest[self.rest.len() - 1].detections.map(|_, _| None);
        let (m, n) = (detections.n_views(), detections.n_joints());
        let (at, covariance) = (Vector3::repeat(f64::NAN), Matrix3::repeat(f64::NAN));
        let answer = Answer { at, covariance, status: JointStatus::Unobserved };
        let unknown = SolvedJoint { answer, believed: vec![f64::NAN; m], loss: 0.0 };
        let sigma = Kernel::of(refiner, n).of_noise(0.0);
        let (joints, start) = (vec![unknown; n], vec![at; n]);
        let (outcome, bars) = together(&joints, sigma, f64::NAN, start, as_given(m, n), 0);
        refiner.result(&detections, outcome, &bars)
    }
}

//! The last frames once more, like a recording: a frame is known better once the frames after it
//! are known.

use nalgebra::{Matrix3, Vector3};

use super::super::serialise::Serialiser;
use super::joint::Answer;
use crate::annealed::Alone;
use crate::annealed::rays::{Ray, Rays};
use crate::detections::Detections;
use crate::outcome::{ErrorBars, JointStatus, Loss, Outcome, Splats, StopReason, as_given};
use crate::refine::{Refinement, Refiner};
use crate::sequence::known::Learnt;
use crate::sequence::outcome::SolvedWindow;
use crate::sequence::posterior::posterior;
use crate::sequence::solver::{Schedule, WindowSolver};
use crate::sequence::tracks::{BRIDGE, Tracks};
use crate::sequence::windows::frames_in;

/// Time before the answered frame that is solved along, s.
const BEFORE: f64 = 1.0;
/// Most frames that this may be.
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
        let longest = lag.saturating_add(frames_in(BEFORE, fps).min(MOST_BEFORE) + 1);
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
        let (n, frames) = (common.sigma.len(), self.alone.len());
        let mut tracks =
            Tracks::new(&[&self.alone], frames_in(BRIDGE, common.fps), common.sigma[0]);
        tracks.find_cuts(common.fps, &common.usual());
        let at = |k: usize| self.rest[k % frames].points[k / frames];
        let known = |k: usize| if at(k).x.is_finite() { at(k) } else { Vector3::zeros() };
        let start = (0..n * frames).map(known).collect();
        let mut run = WindowSolver::new(&tracks, common, Some(start));
        let _ = run.anneal(SETTLE, &|| Ok(()));
        run.linearise(1.0);
        for (k, x) in run.points.iter().enumerate().filter(|(k, _)| tracks.active[*k]) {
            self.rest[k % frames].points[k / frames] = *x;
        }
        let found = posterior(&run, &tracks, learnt);
        let state = SolvedWindow::of(&run, &tracks, learnt, &found);
        let (alone, rest) = (&self.alone[t], &self.rest[t]);
        let filtered = Alone {
            points: rest.answers.iter().map(|answer| answer.at).collect(),
            spread: rest.answers.iter().map(|answer| answer.covariance).collect(),
            status: rest.answers.iter().map(|answer| answer.status).collect(),
            ..alone.clone()
        };
        let (mut outcome, bars) = state.outcome(t, &filtered, alone.used_for.clone(), run.n_iter);
        outcome.init.clone_from(&alone.points);
        refiner.result(&rest.detections, outcome, &bars)
    }

    /// The answer before there is one.
    fn nothing(&self, refiner: &Refiner) -> Refinement {
        let detections = self.rest[self.rest.len() - 1].detections.map(|_, _| None);
        let (m, n) = (detections.n_views(), detections.n_joints());
        let unknown = vec![Vector3::repeat(f64::NAN); n];
        let status = vec![JointStatus::Unobserved; n];
        let outcome = Outcome {
            points: unknown.clone(),
            splats: Splats::Round(refiner.final_kernels(n, 0.0)),
            init: unknown,
            status: status.clone(),
            used_for: as_given(m, n),
            loss: Loss::default(),
            loss_history: Vec::new(),
            n_iter: 0,
            stop_reason: StopReason::NoObservations,
        };
        let bars = ErrorBars {
            covariances: vec![Matrix3::repeat(f64::NAN); n],
            believed: vec![f64::NAN; m * n],
            noise: f64::NAN,
            status,
        };
        refiner.result(&detections, outcome, &bars)
    }

    pub(super) fn serialise(&mut self, serialiser: &mut Serialiser) {
        let empty = Alone {
            rays: Rays::of(Vec::new(), 1),
            used_for: Vec::new(),
            points: Vec::new(),
            spread: Vec::new(),
            status: Vec::new(),
            noise: f64::NAN,
        };
        serialiser.list(&mut self.alone, empty, serialise_alone);
        let rest =
            Rest { detections: Detections::default(), answers: Vec::new(), points: Vec::new() };
        serialiser.list(&mut self.rest, rest, Rest::serialise);
    }
}

impl Rest {
    fn serialise(&mut self, serialiser: &mut Serialiser) {
        serialiser.detections(&mut self.detections);
        let unknown = Answer {
            at: Vector3::zeros(),
            covariance: Matrix3::zeros(),
            status: JointStatus::Unobserved,
        };
        serialiser.list(&mut self.answers, unknown, |answer, serialiser| {
            serialiser.vector(&mut answer.at);
            serialiser.matrix(&mut answer.covariance);
            serialiser.status(&mut answer.status);
        });
        serialiser.list(&mut self.points, Vector3::zeros(), |x, serialiser| serialiser.vector(x));
    }
}

fn serialise_alone(alone: &mut Alone, serialiser: &mut Serialiser) {
    let mut views = alone.rays.n_views();
    serialiser.count(&mut views);
    let joints = if alone.points.is_empty() { 0 } else { alone.rays.n_joints() };
    let mut rays: Vec<Ray> = (0..joints).flat_map(|j| alone.rays.of_joint(j)).copied().collect();
    serialiser.list(&mut rays, Ray::NONE, |ray, serialiser| {
        serialiser.vector(&mut ray.centre);
        serialiser.vector(&mut ray.direction);
        serialiser.number(&mut ray.weight);
        serialiser.number(&mut ray.pixel);
    });
    alone.rays = Rays::of(rays, views);
    serialiser.list(&mut alone.used_for, 0, |j, serialiser| serialiser.count(j));
    serialiser.list(&mut alone.points, Vector3::zeros(), |x, serialiser| serialiser.vector(x));
    serialiser.list(&mut alone.spread, Matrix3::zeros(), |c, serialiser| serialiser.matrix(c));
    serialiser
        .list(&mut alone.status, JointStatus::Unobserved, |s, serialiser| serialiser.status(s));
    serialiser.number(&mut alone.noise);
}

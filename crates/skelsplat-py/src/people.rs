//! `track` and `Tracker`: several people.

use std::sync::{Arc, Mutex};

use pyo3::Borrowed;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use skelsplat_core::study::people::choice::{
    Choice, Choices, Chosen, Linking, MOST_WORK, Rules, choices, choose,
};
use skelsplat_core::study::people::known::BodyModel;
use skelsplat_core::study::people::score::{at_body, of_pair};
use skelsplat_core::study::people::{Crowd, Everybody, Figure};
use skelsplat_core::{Detections, Person, Progress, Tracker, track};

use crate::args::{Array, Out, Poses, place};
use crate::camera::Cameras;
use crate::detections::{Frames, check_scores, split};
use crate::errors::{Failure, Result, refuse};
use crate::layout::Layout;
use crate::refine::{PyRefiner, over_time, results};
use crate::watch;

/// People (T, M, P, N, 2|3) with confidences in [0, 1]; NaN where a slot is empty.
pub(crate) struct People {
    pixels: Vec<f64>,
    scores: Vec<f64>,
    /// T, M, P, N.
    shape: [usize; 4],
}

impl<'py> FromPyObject<'_, 'py> for People {
    type Error = Failure;

    fn extract(value: Borrowed<'_, 'py, PyAny>) -> Result<Self> {
        let array = Array::read("people", &value)?;
        let [t, m, p, n, 2 | 3] = *array.shape.as_slice() else {
            return Err(array.misshapen("(T, M, P, N, 2) or (T, M, P, N, 3)"));
        };
        let array = array.bounded(", or NaN where missing")?;
        let shape = array.shape.clone();
        let (pixels, mut scores) = split(array);
        let place = |k| place("people", &shape[..4], k, ", 2");
        check_scores(value.py(), "people", &mut scores, &pixels, place)?;
        Ok(Self { pixels, scores, shape: [t, m, p, n] })
    }
}

/// Slots as numbers; −1 for none.
fn numbers(slots: impl IntoIterator<Item = Option<usize>>) -> Vec<i64> {
    slots.into_iter().map(|slot| slot.map_or(-1, |s| s as i64)).collect()
}

impl People {
    /// The slots of every frame: P times one figure per view (M, N).
    fn slots(&self) -> Result<Vec<Vec<Detections>>> {
        let [t, m, p, n] = self.shape;
        let slot = |t: usize, slot: usize| -> Result<Detections> {
            let rows = (0..m).map(|i| ((t * m + i) * p + slot) * n);
            let pixels: Vec<f64> =
                rows.clone().flat_map(|at| &self.pixels[2 * at..2 * (at + n)]).copied().collect();
            let scores: Option<Vec<f64>> = (!self.scores.is_empty())
                .then(|| rows.flat_map(|at| &self.scores[at..at + n]).copied().collect());
            Ok(Detections::new(m, n, &pixels, scores.as_deref())?)
        };
        (0..t).map(|t| (0..p).map(|k| slot(t, k)).collect()).collect()
    }

    /// The only frame's.
    fn only(&self) -> Result<Vec<Detections>> {
        if self.shape[0] != 1 {
            return refuse("people", "one frame", format!("{} frames", self.shape[0]));
        }
        Ok(self.slots()?.swap_remove(0))
    }
}

/// Reject confidences outside [0, 1] in the argument ``people`` (T, M, P, N, 2|3).
#[pyfunction]
pub(crate) fn check_people(people: People) {
    let _ = people;
}

/// Return the fields of every ``skelsplat.Person``, and in how many frames there were too many
/// people.
///
/// Too many to compare or to follow. The refinement of each is as in ``Refiner.refine_sequence``.
#[pyfunction]
#[pyo3(signature = (refiner, layout, people, fps, *, max_people=None, progress=None))]
pub(crate) fn track_people<'py>(
    py: Python<'py>,
    refiner: &PyRefiner,
    layout: Layout,
    people: People,
    fps: f64,
    max_people: Option<usize>,
    progress: Option<Bound<'py, PyAny>>,
) -> Result<(Vec<Bound<'py, PyDict>>, usize)> {
    let [total, m, _, n] = people.shape;
    let slots = people.slots()?;
    drop(people);
    let (refiner, layout) = (Arc::clone(&refiner.0), layout.0);
    let work =
        move |progress: &Progress| track(&refiner, &layout, &slots, fps, max_people, progress);
    let found: Everybody = watch::watched(py, total, progress.as_ref(), work)?;
    let output = |person: Person| {
        let frames = Frames::of(person.frames.len(), m, n);
        let out = over_time(py, &frames, person.sequence)?;
        out.set_item("id", person.id)?;
        out.set_item("first", person.frames.start)?;
        out.set_item("slots", frames.out(numbers(person.slots), &[m]))?;
        out.set_item("more_slots", frames.out(numbers(person.more), &[m]))?;
        Ok(out)
    };
    Ok((found.people.into_iter().map(output).collect::<Result<_>>()?, found.cut))
}

/// Frames (C,), slots (C, M), costs (C,) and poses (C, N, 3).
type Ways = (Out<i64>, Out<i64>, Out<f64>, Out<f64>);

/// Return ways to choose one person in each frame: frame (C,), slots (C, M), cost (C,), pose (C, N,
/// 3).
///
/// Of each frame the ``most`` cheapest, none by more than ``worse`` than the first; -1 is no slot.
/// ``gates_px`` is per view the largest median distance, ``mirror`` (N,) every joint's mirror
/// image.
#[pyfunction]
#[pyo3(signature = (cameras, people, gates_px, *, min_confidence, min_joints, mirror, most, worse))]
#[allow(
    clippy::too_many_arguments,
    reason = "one settings object in Python would carry them one step"
)]
pub(crate) fn people_choices(
    py: Python<'_>,
    cameras: Cameras,
    people: People,
    gates_px: Vec<f64>,
    min_confidence: f64,
    min_joints: usize,
    mirror: Vec<usize>,
    most: usize,
    worse: f64,
) -> Result<Ways> {
    let ([_, m, _, n], cameras) = (people.shape, cameras.cameras);
    let slots = people.slots()?;
    let most_work = MOST_WORK;
    let rules = Rules { gates_px, min_confidence, min_joints, mirror, most, worse, most_work };
    let work = move |progress: &Progress| choices(&slots, &cameras, &rules, progress);
    let found: Vec<Choices> = watch::run(py, false, work)?;
    let of = |(t, frame): (usize, &Choices)| vec![t as i64; frame.all.len()];
    let step: Vec<i64> = found.iter().enumerate().flat_map(of).collect();
    let all: Vec<Choice> = found.into_iter().flat_map(|frame| frame.all).collect();
    let chosen = numbers(all.iter().flat_map(|choice| choice.slots.iter().copied()));
    let costs = all.iter().map(|choice| choice.cost).collect();
    let poses: Vec<_> = all.iter().flat_map(|choice| choice.pose.iter().copied()).collect();
    let count = step.len();
    let (step, chosen) = (Out(step, vec![count]), Out(chosen, vec![count, m]));
    Ok((step, chosen, Out(costs, vec![count]), Out::points(&poses, vec![count, n, 3])))
}

/// Return the slots (T, M) of one person, -1 for none, and the frames (T,) with too much to
/// compare.
///
/// As for `people_choices`; going over to someone else, ``switch_step`` away or more, costs
/// ``switch_cost``.
#[pyfunction]
#[pyo3(signature = (
    cameras, people, gates_px, *, min_confidence, min_joints, mirror, most, worse, switch_cost,
    switch_step
))]
#[allow(
    clippy::too_many_arguments,
    reason = "one settings object in Python would carry them one step"
)]
pub(crate) fn people_chosen(
    py: Python<'_>,
    cameras: Cameras,
    people: People,
    gates_px: Vec<f64>,
    min_confidence: f64,
    min_joints: usize,
    mirror: Vec<usize>,
    most: usize,
    worse: f64,
    switch_cost: f64,
    switch_step: f64,
) -> Result<(Out<i64>, Out<bool>)> {
    let ([t, m, _, _], cameras) = (people.shape, cameras.cameras);
    let slots = people.slots()?;
    drop(people);
    let most_work = MOST_WORK;
    let rules = Rules { gates_px, min_confidence, min_joints, mirror, most, worse, most_work };
    let linking = Linking { cost: switch_cost, step: switch_step };
    let work = move |progress: &Progress| choose(&slots, &cameras, &rules, linking, progress);
    let found: Chosen = watch::run(py, false, work)?;
    Ok((Out(numbers(found.slots), vec![t, m]), Out(found.cut, vec![t])))
}

/// Return scores of the figures of a frame: at a body (M, P), of pairs (M, P, M, P), support of the
/// body.
///
/// ``people`` is (1, M, P, N, 2|3), ``pose`` (N, 3) in mm. Scores of pairs of one view are 0.
#[pyfunction]
pub(crate) fn people_scores(
    refiner: &PyRefiner,
    layout: Layout,
    people: People,
    pose: Poses,
) -> Result<(Out<f64>, Out<f64>, f64)> {
    let [_, m, p, _] = people.shape;
    let (crowd, layout) = (Crowd::new(&refiner.0, &people.only()?)?, layout.0);
    let (known, pose) = (BodyModel::new(&refiner.0, &layout), pose.0.points());
    let figures: Vec<(usize, &Figure)> = crowd
        .views
        .iter()
        .enumerate()
        .flat_map(|(i, view)| view.iter().map(move |figure| (i, figure)))
        .collect();
    let at = |(_, figure): &(usize, &Figure)| at_body(figure, &pose, known.sigma, &known.mirror);
    let pair = |(i, a): &(usize, &Figure), (k, b): &(usize, &Figure)| {
        if i == k { 0.0 } else { of_pair(a, b, known.sigma).0 }
    };
    let bodies = figures.iter().map(at).collect();
    let pairs = figures.iter().flat_map(|a| figures.iter().map(|b| pair(a, b)));
    let pairs = pairs.collect();
    let free = crowd.views.iter().map(|view| vec![true; view.len()]).collect();
    let support = known.support(&crowd, &free, &pose);
    Ok((Out(bodies, vec![m, p]), Out(pairs, vec![m, p, m, p]), support))
}

/// The people of a live loop, with the state between frames.
///
/// Raises
/// ------
/// InvalidInputError
///     ``fps`` is not positive, or the method is ``paper``.
#[pyclass(frozen, module = "skelsplat._skelsplat", name = "Tracker")]
pub(crate) struct PyTracker {
    refiner: PyRefiner,
    tracker: Arc<Mutex<Tracker>>,
    n_joints: usize,
}

#[pymethods]
impl PyTracker {
    #[new]
    #[pyo3(signature = (refiner, layout, fps, *, max_people=None))]
    fn new(
        refiner: &PyRefiner,
        layout: Layout,
        fps: f64,
        max_people: Option<usize>,
    ) -> Result<Self> {
        let tracker = Tracker::new(&refiner.0, &layout.0, fps, max_people)?;
        let n_joints = layout.0.n_joints();
        Ok(Self { refiner: refiner.clone(), tracker: Arc::new(Mutex::new(tracker)), n_joints })
    }

    /// Return the fields of everybody in the next frame; ``people`` is (1, M, P, N, 2|3).
    fn step<'py>(&self, py: Python<'py>, people: People) -> Result<Vec<Bound<'py, PyDict>>> {
        let (m, n) = (people.shape[1], self.n_joints);
        let slots = people.only()?;
        let (refiner, tracker) = (Arc::clone(&self.refiner.0), Arc::clone(&self.tracker));
        let found = watch::run(py, true, move |progress| {
            watch::locked(&tracker).step(&refiner, &slots, progress)
        })?;
        let output = |seen: skelsplat_core::TrackedPerson| {
            let frame = Frames::single(m, n);
            let out = results(py, &frame, seen.refinement.into())?;
            let slots = |part: usize| numbers(seen.claims.iter().map(|claim| claim[part]));
            out.set_item("id", seen.id)?;
            out.set_item("slots", Out(slots(0), vec![m]))?;
            out.set_item("more_slots", Out(slots(1), vec![m]))?;
            Ok(out)
        };
        found.into_iter().map(output).collect()
    }

    /// Forget everybody; identities are not used again.
    fn reset(&self) {
        watch::locked(&self.tracker).reset();
    }

    /// Identities of everybody who is followed, also of those out of sight.
    fn ids(&self) -> Vec<usize> {
        watch::locked(&self.tracker).ids()
    }

    /// In how many frames so far there were too many people for all to be compared, or followed.
    fn cut(&self) -> usize {
        watch::locked(&self.tracker).cut()
    }

    /// Return another tracker in the same state.
    fn copy(&self) -> Self {
        let tracker = watch::locked(&self.tracker).clone();
        Self {
            refiner: self.refiner.clone(),
            tracker: Arc::new(Mutex::new(tracker)),
            n_joints: self.n_joints,
        }
    }
}

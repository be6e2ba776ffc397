//! `track` and `Tracker`: several people.

use std::sync::{Arc, Mutex};

use pyo3::Borrowed;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use skelsplat_core::study::people::known::BodyModel;
use skelsplat_core::study::people::score::{at_body, of_pair};
use skelsplat_core::study::people::{Crowd, Everybody, Figure, Identities, Identity, identify};
use skelsplat_core::{
    Detections, Layout as CoreLayout, LayoutSpec, Person, Progress, Tracker, track,
};

use crate::args::{Array, Out, Poses, place};
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
            let found = Detections::new(m, n, &pixels, scores.as_deref());
            Ok(found.map_err(|error| error.of_argument(&format!("people[{t}]")))?)
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

/// People, frames that were cut, and person-frames (M, M) that two views share, or do not.
type Tracked<'py> = (Vec<Bound<'py, PyDict>>, usize, Out<i64>, Out<i64>);

/// Return the fields of every ``skelsplat.Person``, and in how many frames there were too many
/// people.
///
/// Too many to compare or to follow. The refinement of each is as in ``Refiner.refine_sequence``.
/// The last two (M, M) are the person-frames that two views share, and those of the first for which
/// the second, which should see them, shows another person.
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
) -> Result<Tracked<'py>> {
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
    let table = |counts: Vec<usize>| {
        let counts: Vec<i64> = counts.into_iter().map(|n| n as i64).collect();
        let views = if counts.is_empty() { 0 } else { m };
        Out(counts, vec![views, views])
    };
    let (together, apart) = (table(found.agreement.together), table(found.agreement.apart));
    Ok((found.people.into_iter().map(output).collect::<Result<_>>()?, found.cut, together, apart))
}

/// The first frame of each person and the slots (F, M); and the frames (T,) with too many people.
type Identified = (Vec<(usize, Out<i64>)>, Out<bool>);

/// Return first frame and slots (F, M) of everybody whom two views see, -1 for none; and the frames
/// (T,) in which there were too many people to compare.
///
/// Nothing is solved, and neither the unit of the cameras nor the kind of body matters. Without a
/// layout bodies have neither bones nor sides.
#[pyfunction]
#[pyo3(signature = (refiner, layout, people, fps))]
pub(crate) fn people_identities(
    py: Python<'_>,
    refiner: &PyRefiner,
    layout: Option<Layout>,
    people: People,
    fps: f64,
) -> Result<Identified> {
    let [t, m, _, n] = people.shape;
    let joints = || (0..n).map(|j| j.to_string()).collect();
    let layout = match layout {
        Some(layout) => layout.0,
        None => CoreLayout::new(LayoutSpec { joints: joints(), ..LayoutSpec::default() })?,
    };
    let slots = people.slots()?;
    drop(people);
    let refiner = Arc::clone(&refiner.0);
    let work = move |progress: &Progress| identify(&refiner, &layout, &slots, fps, progress);
    let found: Identities = watch::run(py, false, work)?;
    let person = |one: Identity| {
        let frames = one.frames.len();
        (one.frames.start, Out(numbers(one.slots), vec![frames, m]))
    };
    Ok((found.people.into_iter().map(person).collect(), Out(found.cut, vec![t])))
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

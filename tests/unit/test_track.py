"""`skelsplat.track` and `skelsplat.Tracker`: who is who across views and over time."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import skelsplat as sk
from array_forms import bits
from skelsplat import metrics, synthetic
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import FindingWarning
from skelsplat.synthetic import Crowding, Scene

FPS = 30.0


def scene(people: int = 3, views: int = 4, frames: int = 90, **options) -> Scene:
    rig = synthetic.ring(views, radius_mm=4500.0)
    return synthetic.simulate_scene(people, rig, n_frames=frames, fps=FPS, **options)


@pytest.fixture(scope="module")
def three() -> Scene:
    return scene(seed=3)


@pytest.fixture(scope="module")
def tracked(three: Scene) -> list[sk.Person]:
    return sk.track(three.people, three.cameras, fps=FPS, layout=three.layout)


def scored(found: list[sk.Person], truth: Scene) -> metrics.TrackScores:
    tracks = [(one.id, one.frames, one.refinement.pose) for one in found]
    return metrics.track_scores(tracks, truth.truth, optional=truth.optional())


def test_everybody_is_found_once(three, tracked) -> None:
    scores = scored(tracked, three)
    assert [person.id for person in tracked] == [0, 1, 2]
    assert scores.recall > 0.98
    assert scores.precision > 0.98
    assert scores.identity_switches == 0


def test_poses_are_those_of_the_same_detections_in_time(three, tracked) -> None:
    person = tracked[1]
    alone = sk.refine_sequence(person.detections(three.people), three.cameras, fps=FPS, layout=three.layout)
    np.testing.assert_array_equal(alone.pose, person.refinement.pose)
    np.testing.assert_array_equal(alone.uncertainty, person.refinement.uncertainty)


def test_slots_are_not_identities(three, tracked) -> None:
    """The order of people in a view means nothing; in these scenes it changes with every frame."""
    assert (np.diff(tracked[0].slots, axis=0) != 0).any()
    reverse = sk.track(three.people[:, :, ::-1], three.cameras, fps=FPS, layout=three.layout)
    for one, other in zip(tracked, reverse, strict=True):
        np.testing.assert_array_equal(one.refinement.pose, other.refinement.pose)


def test_whoever_comes_back_is_the_same_person() -> None:
    truth = scene(people=2, frames=180, meetings=("leave",), crowding=Crowding.none(), seed=1)
    assert np.isnan(truth.truth).all(axis=(2, 3)).any(), "somebody has to be away"
    found = sk.track(truth.people, truth.cameras, fps=FPS, layout=truth.layout)
    assert len(found) == 2
    assert scored(found, truth).idf1 > 0.98


def test_at_most_so_many_are_returned(three, tracked) -> None:
    found = sk.track(three.people, three.cameras, fps=FPS, layout=three.layout, max_people=2)
    seen = sorted((int((person.slots >= 0).sum()) for person in tracked), reverse=True)
    assert sorted((int((person.slots >= 0).sum()) for person in found), reverse=True) == seen[:2]


def test_a_person_whom_one_view_sees_is_nobody(three) -> None:
    hidden = three.people.copy()
    hidden[:, 1:] = np.nan
    assert sk.track(hidden, three.cameras, fps=FPS, layout=three.layout) == []


def test_a_person_detected_in_two_halves_is_one() -> None:
    whole = scene(people=1, crowding=Crowding.none(), seed=5)
    halves = np.full((*whole.people.shape[:2], 2, *whole.people.shape[3:]), np.nan)
    upper = np.arange(17) >= 7
    halves[:, :, 0] = whole.people[:, :, 0]
    halves[:, 1, 0, upper] = np.nan
    halves[:, 1, 1, upper] = whole.people[:, 1, 0, upper]
    (expected,) = sk.track(whole.people, whole.cameras, fps=FPS, layout=whole.layout)
    (person,) = sk.track(halves, whole.cameras, fps=FPS, layout=whole.layout)
    assert (person.more_slots[:, 1] >= 0).mean() > 0.95
    apart = np.linalg.norm(person.refinement.pose - expected.refinement.pose, axis=-1)
    assert np.nanmedian(apart) < 0.1


@pytest.mark.parametrize(
    "people",
    [np.empty((5, 4, 0, 17, 3)), np.full((5, 4, 2, 17, 3), np.nan), [[[], [], [], []]] * 3, []],
    ids=["P of 0", "empty slots", "empty lists", "no frames"],
)
def test_nobody_there_is_an_empty_list(three, people) -> None:
    assert sk.track(people, three.cameras, fps=FPS, layout=three.layout) == []


JOINTS = np.zeros((1, 17, 3))
REFUSED = {
    "fps": [{"fps": 0.0}],
    "max_people": [{"max_people": 0}, {"max_people": 1.5}],
    "layout": [{"layout": "coco17x"}],
    "config.method": [{"config": sk.RefineConfig.paper()}],
    "people": [
        {"people": np.zeros((5, 4, 17, 3))},
        {"people": np.zeros((5, 3, 2, 17, 3))},
        {"people": "people.json"},
        {"people": [{"cam0": []}]},
        {"people": [[JOINTS] * 4, [JOINTS] * 3]},
        {"people": [[JOINTS] * 3 + [JOINTS[:, :16]]]},
    ],
    "people[0, 0, 0, 0, 2]": [{"people": np.full((2, 4, 1, 17, 3), 2.0)}],
}


@pytest.mark.parametrize("argument", REFUSED)
def test_bad_arguments_are_named(three, argument) -> None:
    for change in REFUSED[argument]:
        valid = {"people": three.people[:5], "fps": FPS, "layout": three.layout}
        with pytest.raises(InvalidInputError) as caught:
            sk.track(cameras=three.cameras, **(valid | change))
        assert caught.value.argument == argument


def test_an_identity_that_has_ended_does_not_return(three) -> None:
    tracker = sk.Tracker(three.cameras, fps=FPS, layout=three.layout)
    assert tracker.ids == ()
    for frame in three.people[:30]:
        tracker.step(frame)
    assert tracker.ids == (0, 1, 2)
    nobody = [np.empty((0, 17, 3))] * 4
    kept = [(tracker.step(nobody), tracker.ids)[1] for _ in range(7 * int(FPS))]
    assert kept[0] == kept[4 * int(FPS)] == (0, 1, 2)
    assert kept[-1] == ()
    for frame in three.people[30:60]:
        tracker.step(frame)
    assert tracker.ids == (3, 4, 5)
    tracker.reset()
    assert tracker.ids == ()


def test_bad_input_of_a_loop_leaves_the_state_as_it_was(three) -> None:
    tracker, untouched = (sk.Tracker(three.cameras, fps=FPS, layout=three.layout) for _ in range(2))
    for frame in three.people[:20]:
        tracker.step(frame)
        untouched.step(frame)
    wrong = three.people[20].copy()
    wrong[0, 0, 3, 2] = 300.0
    for bad in (wrong, wrong[:3], wrong[..., :5, :], three.people[:2]):
        with pytest.raises(InvalidInputError):
            tracker.step(bad)
    for one, same in zip(tracker.step(three.people[20]), untouched.step(three.people[20]), strict=True):
        assert bits(one.refinement) == bits(same.refinement)


def test_people_who_are_not_found_are_not_kept_silent(three) -> None:
    """Here for the unit of the cameras; nobody agrees on anybody."""
    rig = [sk.Camera(c.K, c.R, c.t / 1000, size=c.size) for c in three.cameras]
    with pytest.warns(FindingWarning, match="In 90 frames"):
        assert sk.track(three.people, rig, fps=FPS, layout=three.layout) == []
    tracker = sk.Tracker(rig, fps=FPS, layout=three.layout)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        assert [tracker.step(frame) for frame in three.people] == [[]] * len(three.people)
    assert [warning.message.finding.numbers for warning in told] == [{"frames": 60}]


def test_a_wrong_layout_is_said_once(three) -> None:
    with pytest.warns(FindingWarning) as said:
        sk.track(three.people, three.cameras, fps=FPS, layout="coco17")
    (finding,) = [one.message.finding for one in said]
    assert (finding.kind, finding.numbers["layouts_of_as_many_joints"]) == ("limbs_differ", ["h36m17"])


def test_too_many_people_to_compare_are_said_once() -> None:
    """Two views of 1,001 people allow more pairs than are compared in a frame."""
    rng, cameras = np.random.default_rng(2), sk.synthetic.ring(2)
    people = rng.uniform(0.0, 1000.0, (2, 1001, 1, 2)) + rng.uniform(0.0, 100.0, (17, 2))
    tracker = sk.Tracker(cameras, layout="h36m17", fps=30.0)
    with pytest.warns(FindingWarning, match="1,001"):
        tracker.step(people)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tracker.step(people)

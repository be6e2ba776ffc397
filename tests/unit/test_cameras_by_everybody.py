"""Cameras judged and adjusted by several people: who counts, and what follows when they disagree."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from rig_case import turned
from skelsplat import synthetic
from skelsplat.association import choose_person
from skelsplat.rig_check import ReadAs, check_rig
from skelsplat.run.adjusted import findings_of
from skelsplat.run.by_everybody import Scene, adjusted
from skelsplat.synthetic.rigs import mixed_heights
from sweeps import swept

LAYOUT = sk.layouts.H36M17
T = 60


def found_by(rig, people):
    """Return what became of the cameras, by everybody in the detections (T, M, P, N, 3)."""
    return adjusted(Scene(rig, people, np.arange(len(people)), LAYOUT, ReadAs()))


def statuses(found):
    return tuple(one.status for one in found.report)


@pytest.fixture(scope="module")
def crowd():
    """Return three people who cross, circle and pass each other, seen by four cameras."""
    return synthetic.simulate_scene(
        3, mixed_heights(4), n_frames=200, fps=30.0, meetings=["cross", "circle", "apart"], seed=1002
    )


def test_everybody_says_more_than_one_person(crowd):
    rig, people = turned(crowd.cameras, 1, [0.6, -0.5, 0.4]), crowd.people[:100:2]
    one = choose_person(people, rig, layout=LAYOUT)[0][:, :, None]
    by_one, by_all = found_by(rig, one), found_by(rig, people)
    assert statuses(by_one) == statuses(by_all) == ("sound", "adjusted", "sound", "sound")
    assert by_all.report[1].turn_sigma < 0.7 * by_one.report[1].turn_sigma
    assert by_all.fitted > by_one.fitted
    left = np.asarray(by_all.cameras[1].R) @ np.asarray(crowd.cameras[1].R).T
    assert np.degrees(np.arccos((np.trace(left) - 1) / 2)) < 2 * by_all.report[1].turn_sigma


def test_a_camera_that_saw_strangers_is_set_right_by_its_own_people(crowd):
    rig = turned(crowd.cameras, 2, [6.0, 8.0, 1.0])
    found = found_by(rig, crowd.people[:60:2])
    assert statuses(found) == ("sound", "sound", "adjusted", "sound")
    left = np.asarray(found.cameras[2].R) @ np.asarray(crowd.cameras[2].R).T
    assert np.degrees(np.arccos((np.trace(left) - 1) / 2)) < 0.3
    assert found.report[2].after < 2 * found.report[1].after


def two_who_disagree(rig):
    """Return two people, of whom each sees another camera turned."""
    truth = synthetic.simulate_scene(2, rig, n_frames=2 * T, fps=30.0, meetings=["cross"], seed=0).truth
    noise = synthetic.DetectionNoise.good()
    seen = [
        synthetic.simulate_detections(pose, turned(rig, camera, [0.9, 1.1, 0.2]), noise=noise, seed=camera)
        for pose, camera in zip(truth, (0, 2), strict=True)
    ]
    return np.stack(seen, axis=2)[::5]


def test_people_who_contradict_each_other_leave_the_cameras_in_doubt():
    rig = synthetic.human36m_like()
    people = two_who_disagree(rig)
    each = [found_by(rig, people[:, :, k : k + 1]) for k in (0, 1)]
    assert [one.of("adjusted")[0].name for one in each] == ["cam1", "cam3"]  # each of them is sure
    found = found_by(rig, people)
    assert not found.of("adjusted", "late")
    assert found.of("doubtful")
    assert {one.name for one in found.of("doubtful")} <= {"cam1", "cam3"}


def test_a_frame_offset_of_a_crowd_is_named(crowd):
    late = crowd.people.copy()
    late[3:, 0] = crowd.people[:-3, 0]
    (finding,) = check_rig(crowd.cameras, late, layout=LAYOUT).findings
    assert (finding.kind, finding.numbers["frames"]) == ("frame_offset", 3)


@pytest.mark.parametrize(
    ("name", "degrees", "step"), [("reach", 2.0, 2), swept("walk", 1.0, 1), swept("walk", 0.0, 1)]
)
def test_a_camera_that_was_knocked_is_said_with_the_frame(name, degrees, step):
    rig, motion = synthetic.human36m_like(), synthetic.motion(name, T, fps=30.0, seed=1)
    noise = synthetic.DetectionNoise.recording(30.0)
    before, after = (
        synthetic.simulate_detections(motion, one, noise=noise, seed=1)
        for one in (rig, turned(rig, 1, degrees, (1, 2, 0)))
    )
    seen = np.concatenate([before[: T // 2], after[T // 2 :]])
    found = Scene(rig, seen[:, :, None], 500 + step * np.arange(T), LAYOUT, ReadAs()).adjust()
    assert found.cameras == rig
    named = [one.subject for one in findings_of(found, 1.0, ReadAs()) if one.severity == "warning"]
    assert [(one.cameras, one.frames) for one in named] == [(("cam2",), (500 + step * T // 2,))][
        : degrees > 0
    ]

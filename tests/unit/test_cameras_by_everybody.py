"""Cameras judged and adjusted by several people: who counts, and what follows when they disagree."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.association import choose_person
from skelsplat.cameras import altered, matrix_from_vector
from skelsplat.exceptions import InvalidInputError
from skelsplat.rig_check import ReadAs, check_rig
from skelsplat.rig_check._scene import everybody, in_mm, one_after_another, scene_of_everybody
from skelsplat.run.adjust import adjusted
from skelsplat.run.by_everybody import Scene
from skelsplat.run.person import check_slot
from skelsplat.synthetic.people_sets import mixed_heights

LAYOUT = sk.layouts.H36M17
T = 60


def turned(rig, i, degrees):
    """Return the rig as calibrated before camera i was turned about its axes."""
    turn = matrix_from_vector(np.radians(degrees))
    cameras = list(rig)
    cameras[i] = altered(rig[i], R=turn @ rig[i].R, t=turn @ rig[i].t)
    return sk.CameraRig(cameras, rig.unit)


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
    rig = turned(crowd.cameras, 1, [0.6, -0.5, 0.4])
    one = choose_person(crowd.people, rig, layout=LAYOUT)[0][:, :, None]
    by_one, by_all = found_by(rig, one), found_by(rig, crowd.people)
    assert statuses(by_one) == statuses(by_all) == ("sound", "adjusted", "sound", "sound")
    assert by_all.report[1].turn_sigma < 0.7 * by_one.report[1].turn_sigma
    assert by_all.fitted > by_one.fitted
    left = np.asarray(by_all.cameras[1].R) @ np.asarray(crowd.cameras[1].R).T
    assert np.degrees(np.arccos((np.trace(left) - 1) / 2)) < 2 * by_all.report[1].turn_sigma


def test_a_camera_that_saw_strangers_is_set_right_by_its_own_people(crowd):
    rig = turned(crowd.cameras, 2, [6.0, 8.0, 1.0])
    found = found_by(rig, crowd.people)
    assert statuses(found) == ("sound", "sound", "adjusted", "sound")
    left = np.asarray(found.cameras[2].R) @ np.asarray(crowd.cameras[2].R).T
    assert np.degrees(np.arccos((np.trace(left) - 1) / 2)) < 0.3
    assert found.report[2].after < 2 * found.report[1].after


def two_who_disagree(rig):
    """Return two people, of whom each sees another camera turned."""
    truth = synthetic.simulate_scene(2, rig, n_frames=3 * T, fps=30.0, meetings=["cross"], seed=0).truth
    noise = synthetic.DetectionNoise.good()
    seen = [
        synthetic.simulate_detections(pose, turned(rig, camera, [0.9, 1.1, 0.2]), noise=noise, seed=camera)
        for pose, camera in zip(truth, (0, 2), strict=True)
    ]
    return np.stack(seen, axis=2)[::3]


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


def test_whom_only_two_views_see_does_not_count():
    rig = synthetic.human36m_like()
    people = two_who_disagree(rig)
    people[:, :2, 1] = np.nan
    (only,) = everybody(in_mm(rig), people, LAYOUT)[0]
    np.testing.assert_array_equal(only, people[:, :, 0])
    people[: T - 11] = np.nan
    assert len(everybody(in_mm(rig), people, LAYOUT)[0]) == 1


def test_between_people_no_clock_compares_one_with_another():
    rig = synthetic.human36m_like()
    people = two_who_disagree(rig)
    everyone, _ = everybody(in_mm(rig), people, LAYOUT)
    scene = scene_of_everybody(in_mm(rig), people, 2 * np.arange(T), LAYOUT)
    assert len(scene.frames) == 2 * T
    assert scene.frames[T] - scene.frames[T - 1] > 30
    both = one_after_another(everyone)
    assert np.isnan(both[T:-T]).all()
    assert len(both) - 2 * T > 30


def test_who_may_judge():
    check_slot("everybody")
    with pytest.raises(InvalidInputError, match=r"^person: expected everybody, consistent, largest or"):
        check_slot("moves-most")

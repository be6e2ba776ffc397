"""Cameras adjusted, and judged by several people: who counts, and what follows when they disagree."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from rig_case import turned
from skelsplat import synthetic
from skelsplat.association import choose_person
from skelsplat.exceptions import InvalidInputError
from skelsplat.rig_check import ReadAs, check_rig
from skelsplat.run.adjusted import findings_of
from skelsplat.run.by_everybody import Scene, adjusted
from skelsplat.synthetic import DetectionNoise
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
    rig, people = turned(crowd.cameras, 1, [0.6, -0.5, 0.4]), crowd.people[:100:4]
    one = choose_person(people, rig, layout=LAYOUT)[0][:, :, None]
    by_one, by_all = found_by(rig, one), found_by(rig, people)
    assert statuses(by_one) == statuses(by_all) == ("sound", "adjusted", "sound", "sound")
    assert by_all.report[1].turn_sigma < 0.7 * by_one.report[1].turn_sigma
    assert by_all.fitted > by_one.fitted
    left = np.asarray(by_all.cameras[1].R) @ np.asarray(crowd.cameras[1].R).T
    assert np.degrees(np.arccos((np.trace(left) - 1) / 2)) < 2 * by_all.report[1].turn_sigma


def test_a_camera_that_saw_strangers_is_set_right_by_its_own_people(crowd):
    rig = turned(crowd.cameras, 2, [6.0, 8.0, 1.0])
    found = found_by(rig, crowd.people[:60:3])
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


@pytest.mark.parametrize("skipped", [5, 0])
def test_a_clock_that_changes_is_said_with_the_frame(skipped):
    rig, motion = synthetic.human36m_like(), synthetic.motion("walk", 2 * T + skipped, fps=30.0, seed=1)
    noise = synthetic.DetectionNoise.recording(30.0)
    seen = synthetic.simulate_detections(motion, rig, noise=noise, seed=1)
    late = seen[: 2 * T].copy()
    late[T:, 1] = seen[T + skipped :, 1]
    found = Scene(rig, late[:, :, None], 500 + 2 * np.arange(2 * T), LAYOUT, ReadAs()).adjust()
    assert found.cameras == rig
    named = [one for one in findings_of(found, 1.0, ReadAs()) if one.severity == "warning"]
    assert [(one.kind, one.subject.cameras) for one in named] == [("clock_changes", ("cam2",))][: skipped > 0]
    for one in named:
        assert one.numbers["clock_frames"] == -2 * skipped
        assert one.subject.frames[0] == pytest.approx(500 + 2 * T, abs=20)


# names, units and statuses; the core's tests have the faults


RIG = sk.CameraRig(synthetic.human36m_like(), unit="mm")
TURN = np.array([0.0, 1.5, 0.0])
KNOCKED = turned(RIG, 2, -TURN)  # its third camera, about its own y axis


@pytest.fixture(scope="module")
def detections() -> np.ndarray:
    """Simulate a minute of somebody walking about, every 20th frame."""
    poses = synthetic.motion("walk", 1800, fps=30)[::20]
    noise = DetectionNoise.recording(frame_rate=1.5)
    return synthetic.simulate_detections(poses, RIG, noise=noise, seed=3)


def test_a_joint_that_one_view_has_wrong_for_twenty_frames_turns_no_camera() -> None:
    poses, noise = synthetic.motion("walk", 20, fps=30, seed=16), DetectionNoise.recording(frame_rate=30)
    seen = synthetic.simulate_detections(poses, list(RIG)[:3], noise=noise, layout="h36m17", seed=16)
    wrong = int(np.random.default_rng(16).integers(17))
    seen[:, 1, wrong, :2] += 80.0 * np.array([np.cos(16.0), np.sin(16.0)])
    assert not sk.adjust_cameras(seen, list(RIG)[:3]).of("adjusted", "late")


def test_coordinates_from_0_to_1_are_no_pixels(detections) -> None:
    with pytest.raises(sk.InvalidInputError, match="from 0 to 1"):
        sk.adjust_cameras(detections / 2000.0, RIG)


def test_cameras_may_be_named(detections) -> None:
    by_name, by_number = (sk.adjust_cameras(detections, KNOCKED, free=one) for one in (RIG.names[2], [2]))
    assert by_name.cameras == by_number.cameras
    assert [one.status for one in by_name.report] == ["sound", "sound", "adjusted", "sound"]
    assert repr(by_name) == f"RigAdjustment(cameras={by_name.cameras})"  # not all its numbers


def test_a_plain_sequence_of_cameras_is_in_mm(detections) -> None:
    found = sk.adjust_cameras(detections, list(RIG))
    assert found.cameras == RIG
    assert {one.status for one in found.report} == {"sound"}
    assert all(0.0 < one.turn_sigma < 2.0 for one in found.report)
    assert all(np.isnan(one.clock_sigma) for one in found.report)


def test_two_cameras_that_see_tell_nothing_of_each_other(detections) -> None:
    blind = detections.copy()
    blind[:, 2:] = np.nan
    assert {one.status for one in sk.adjust_cameras(blind, RIG).report} == {"unseen"}


@pytest.mark.parametrize("free", [["side"], [4], [-1], [0, 1, 2, 3]])
def test_a_wrong_choice_of_cameras_is_named(detections, free) -> None:
    with pytest.raises(InvalidInputError) as caught:
        sk.adjust_cameras(detections, RIG, free=free)
    assert caught.value.argument == "free"

"""`skelsplat.adjust_cameras`: names, units and statuses; the core's tests have the faults."""

from __future__ import annotations

import numpy as np
import pytest

import rig_case
import skelsplat as sk
from skelsplat import synthetic
from skelsplat.exceptions import InvalidInputError
from skelsplat.synthetic import DetectionNoise

RIG = sk.CameraRig(synthetic.human36m_like(), unit="mm")
TURN = np.array([0.0, 1.5, 0.0])
KNOCKED = rig_case.turned(RIG, 2, -TURN)  # its third camera, about its own y axis


@pytest.fixture(scope="module")
def detections() -> np.ndarray:
    """Simulate a minute of somebody walking about, every 20th frame."""
    poses = synthetic.motion("walk", 1800, fps=30)[::20]
    noise = DetectionNoise.recording(frame_rate=1.5)
    return synthetic.simulate_detections(poses, RIG, noise=noise, seed=3)


def test_a_turned_camera_is_set_right(detections) -> None:
    found = sk.adjust_cameras(detections, KNOCKED)
    name = RIG.names[2]
    assert [one.name for one in found.of("adjusted")] == [name]
    (turned,) = found.of("adjusted")
    assert turned.turn == pytest.approx(TURN, abs=0.3)
    assert turned.degrees == pytest.approx(1.5, abs=2.0 * turned.turn_sigma)
    assert turned.distance <= 2.0 * turned.shift_sigma
    assert turned.after < 0.3 * turned.before
    assert found.cameras.names == RIG.names
    assert found.cameras[name] != KNOCKED[name]
    assert [found.cameras[i] for i in (0, 1, 3)] == [KNOCKED[i] for i in (0, 1, 3)]
    assert (found.fitted, found.judged) == (70, 20)


def test_a_joint_that_one_view_has_wrong_for_twenty_frames_turns_no_camera() -> None:
    poses, noise = synthetic.motion("walk", 20, fps=30, seed=16), DetectionNoise.recording(frame_rate=30)
    seen = synthetic.simulate_detections(poses, list(RIG)[:3], noise=noise, layout="h36m17", seed=16)
    wrong = int(np.random.default_rng(16).integers(17))
    seen[:, 1, wrong, :2] += 80.0 * np.array([np.cos(16.0), np.sin(16.0)])
    assert not sk.adjust_cameras(seen, list(RIG)[:3]).of("adjusted", "late")


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

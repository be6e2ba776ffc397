"""Detections that lie to one side of the reprojected pose: a wrong camera, and what is none."""

from __future__ import annotations

import re

import numpy as np
import pytest

import skelsplat as sk
from rig_case import turned
from skelsplat import synthetic
from skelsplat.run import displaced
from skelsplat.synthetic import DetectionNoise
from two_people import LAYOUT, findings_of, seen

FRAMES = 30


def scattered(people, px, seed=5):
    people = people.copy()
    people[..., :2] += np.random.default_rng(seed).normal(0.0, px, people[..., :2].shape)
    return people


def walker(rig, noise=None, frames=FRAMES):
    return seen([synthetic.motion("walk", frames, seed=3)], rig, noise)


def displaced_findings(people, rig, person="consistent"):
    words = ("looks wrong", "from the pose", "the whole pose")
    return [doubt for doubt in findings_of(people, rig, person) if any(word in doubt for word in words)]


@pytest.mark.parametrize("distortion", [False, True])
def test_a_turned_camera_is_named_with_its_shift(distortion):
    rig = synthetic.human36m_like(distortion=distortion)
    people = scattered(walker(rig), 8.0)
    (doubt,) = displaced_findings(people, turned(rig, 1, 1.5, (0, 1, 0)))
    assert doubt.startswith("cam2")
    assert re.search(r"detections are shifted by \d+ px from the pose \(\d+ px left", doubt), doubt
    assert displaced_findings(people, rig) == []


def test_a_rejected_camera_has_one_message():
    rig = synthetic.human36m_like()
    wrong = turned(rig, 1, 1.5, (0, 1, 0))
    (doubt,) = (doubt for doubt in findings_of(walker(rig), wrong) if "cam2" in doubt)
    shift = re.search(r"shifted by (\d+) px from the pose \(\1 px left\)", doubt)
    assert shift is not None, doubt
    truth = synthetic.motion("walk", FRAMES, seed=3)  # where the other cameras keep the pose
    expected = np.median(sk.project(truth, rig)[1, ..., 0] - sk.project(truth, wrong)[1, ..., 0])
    assert abs(int(shift[1]) + expected) < 1.0


@pytest.mark.parametrize(
    "noise",
    [DetectionNoise.good(), DetectionNoise.noisy(), DetectionNoise.occluded(3, hard=True)],
    ids=["good", "noisy", "occluded"],
)
@pytest.mark.parametrize(
    ("rig", "frames"), [(synthetic.human36m_like(), FRAMES), (synthetic.ring(3), 3)], ids=["four", "three"]
)
def test_sound_cameras_are_not_doubted(rig, noise, frames):
    assert displaced_findings(walker(rig, noise, frames), rig) == []
    assert displaced_findings(scattered(walker(rig, noise, frames), 10.0), rig) == []


def test_a_still_person_whose_joints_are_off_in_every_view_is_not_doubted():
    """A detector's own offset of every joint and view does not change while a person stands still."""
    rig, rng = synthetic.human36m_like(), np.random.default_rng(0)
    pose = np.repeat(synthetic.motion("reach", 1, seed=2), FRAMES, axis=0)
    for _ in range(5):
        people = seen([pose], rig)
        people[..., :2] += rng.normal(0.0, 20.0, (1, 4, 1, 17, 2))
        assert displaced_findings(people, rig) == []


def test_joints_whose_offsets_point_any_way_share_a_side_as_often_as_is_said():
    """Under the null hypothesis p is uniform; 2000 draws have it below 0.05 in 5 % ± 3 · 0.49 %."""
    rng = np.random.default_rng(0)
    for joints in (4, 8, 17):
        offsets = rng.normal(0.0, 1.0, (2000, joints, 2)) @ np.array([[3.0, 1.0], [0.0, 2.0]])
        share = np.mean([displaced.same_side(one) < 0.05 for one in offsets])
        assert abs(share - 0.05) < 3 * np.sqrt(0.05 * 0.95 / 2000)
    assert displaced.same_side(np.ones((17, 2))) == 1.0  # one point is no scatter to compare with


LEGS = slice(1, 7)
FEW = sk.Layout("legs", LAYOUT.joints[LEGS], limbs=[(0, 1), (1, 2), (3, 4), (4, 5), (0, 3)])


def test_noise_over_time_shows_a_turned_camera_to_few_joints():
    """Frames alone follow it, and others are pulled along; over time its view has the most noise."""
    rig = synthetic.ring(3)
    wrong, people = turned(rig, 1, (0, 1.5, 0)), walker(rig, DetectionNoise.recording(60.0), 60)[..., LEGS, :]
    alone, over_time = (findings_of(people, wrong, layout=FEW, fps=fps) for fps in (None, 60.0))
    assert not any("looks wrong" in text for text in alone)
    assert [text[:6] for text in over_time if "looks wrong" in text] == [f"{rig.names[1]}'s"]

"""Strides of people who walk: simulated, along a path at a known speed, and in the files of a run."""

from __future__ import annotations

import csv
from itertools import pairwise

import numpy as np
import pytest

import skelsplat as sk
from command_line import READ, read_report, succeed
from skelsplat import synthetic
from skelsplat.io import write_calibration
from skelsplat.run.strides import FILE, find_strides
from skelsplat.synthetic.motions import stroll

JOINTS = sk.layouts.H36M17.joints
FPS, UP = 60.0, np.array([0.0, 0.0, 1.0])


def walk(speed=1300.0, seconds=9.0, *, backwards=False):
    """Return a person who walks straight ahead (T, 17, 3), mm."""
    along = np.arange(0.0, seconds, 1 / FPS) * speed
    heading = np.full(len(along), 180.0 * backwards)
    return stroll(np.stack([along, 0.0 * along], axis=-1), heading, fps=FPS, seed=3)


@pytest.mark.parametrize("speed", [900.0, 1300.0])
def test_strides_have_the_speed_of_the_walk_and_both_sides_take_turns(speed):
    found = find_strides(walk(speed), JOINTS, UP, FPS)
    assert {one.side for one in found} == {"left", "right"}
    for one in found:
        assert one.length * FPS / (one.next - one.strike) == pytest.approx(speed, rel=0.03)
        assert 0.55 < (one.off - one.strike) / (one.next - one.strike) < 0.7
    left, right = ([one for one in found if one.side == side] for side in ("left", "right"))
    assert len(left) >= 3
    assert all(one.next == other.strike for one, other in pairwise(left))
    middle = (left[0].strike + left[0].next) / 2
    assert min(abs(one.strike - middle) for one in right) <= 2


def test_any_axis_may_be_up_and_a_gap_costs_its_strides():
    pose = walk()
    found = find_strides(pose, JOINTS, UP, FPS)
    turned = np.stack([pose[..., 0], -pose[..., 2], pose[..., 1]], axis=-1)
    assert [one[:4] for one in find_strides(turned, JOINTS, np.array([0.0, -1.0, 0.0]), FPS)] == [
        one[:4] for one in found
    ]
    pose[found[1].strike + 33, JOINTS.index("left_ankle")] = np.nan
    assert [one for one in found if one not in find_strides(pose, JOINTS, UP, FPS)] == found[1:2]


def test_other_motions_have_no_strides():
    assert find_strides(walk(backwards=True), JOINTS, UP, FPS) == []
    for name in ("sit", "reach", "crouch", "wave", "turn"):
        assert find_strides(np.asarray(synthetic.motion(name, 500, seed=1)), JOINTS, UP, 50.0) == []
    assert find_strides(np.zeros((90, 3, 3)), ("left_hip", "left_knee", "left_ankle"), UP, FPS) == []


def refined(folder, pose, *options):
    """Refine detections of a pose with --angles and return the report."""
    rig = synthetic.ring(4)
    write_calibration(folder / "Calib.toml", rig)
    for name, seen in zip(rig.names, sk.project(pose, rig), strict=True):
        np.savez(folder / f"{name}.npz", detections=seen[:, None], frames=np.arange(len(pose)) + 100)
    command = ["refine", folder / "Calib.toml", folder, *READ, *options, "--angles", "--no-html"]
    succeed(*command, "-o", folder / "out")
    return read_report(folder / "out")


@pytest.mark.parametrize(("motion", "rate"), [("wave", ("--fps", 50)), ("walk", ())])
def test_a_run_without_strides_notes_it_in_place_of_the_file(tmp_path, monkeypatch, motion, rate):
    monkeypatch.setattr("skelsplat.run.folder.can_draw", lambda: False)
    report = refined(tmp_path, np.asarray(synthetic.motion(motion, 120, seed=1)), *rate)
    assert "no_strides" in [finding["kind"] for finding in report["findings"]]
    assert FILE not in report["files"]
    assert not (tmp_path / "out" / FILE).exists()


def test_a_run_with_angles_writes_them_in_metres(tmp_path, monkeypatch):
    monkeypatch.setattr("skelsplat.run.folder.can_draw", lambda: False)
    pose = np.asarray(synthetic.motion("walk", 200, seed=1))
    report = refined(tmp_path, pose, "--fps", 50)
    rows = list(csv.DictReader((tmp_path / "out" / FILE).read_text().splitlines()))
    expected = find_strides(pose, JOINTS, UP, 50.0)
    assert [row["side"] for row in rows] == [one.side for one in expected]
    for row, one in zip(rows, expected, strict=True):
        assert abs(int(row["first_frame"]) - 100 - one.strike) <= 1
        length, seconds, speed = (float(row[name]) for name in ("length_m", "duration_s", "speed_m_s"))
        assert length == pytest.approx(one.length / 1000, abs=0.04)
        assert speed == pytest.approx(length / seconds, rel=2e-3)
    assert FILE in report["files"]
    assert "no_strides" not in [finding["kind"] for finding in report["findings"]]

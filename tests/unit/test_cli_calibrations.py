"""Calibrations of all formats on the command line: the unit where the file lacks it, and their options."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import calibration_files as files
import skelsplat as sk
from command_line import assert_fails, invoke, read_report, succeed
from skelsplat import synthetic
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.io import read_npz

LAYOUT = ["--layout", "h36m17"]
# How the file is written, what has to be said of it, its unit, and what the report calls it.
CALIBRATIONS = [
    (files.easymocap, ["--unit", "m", "--calibration-format", "easymocap"], "m", "easymocap"),
    (files.openpose, ["--size", "1000x1002"], "m", "openpose"),
    (files.panoptic, ["--camera-type", "hd"], "cm", "panoptic"),
    (files.human36m, ["--subject", "S9"], "mm", "human36m"),
    (files.qualisys, ["--binning", "1"], "mm", "qualisys"),
]


@pytest.fixture
def views():
    """Four cameras without distortion; their images have one size, which OpenPose has to be told."""
    return [replace(view, size=(1000, 1002)) for view in files.reference(files.NAMES, distortion=False)]


@pytest.mark.parametrize(("write", "options", "unit", "name"), CALIBRATIONS)
def test_refine_reads_every_format_and_says_which(tmp_path, views, write, options, unit, name):
    pose = synthetic.motion("walk", 3, seed=3)
    cameras = [sk.Camera(v.K, v.R, v.t, size=v.size, name=v.name) for v in views]
    np.savez(tmp_path / "detections.npz", detections=sk.project(pose, cameras).swapaxes(0, 1))
    (tmp_path / "rig").mkdir()
    given = [write(tmp_path / "rig", views), tmp_path / "detections.npz", *LAYOUT, *options]
    succeed("refine", *given, "--order", "sorted", "-q", "--fps", 50, "-o", tmp_path / "out")
    said = read_report(tmp_path / "out")["input"]
    assert (said["unit"], said["calibration_format"]) == (unit, name)
    poses = read_npz(tmp_path / "out" / "pose.npz")
    assert poses.unit == unit
    # the files hold six digits: at 4 m a hundredth of a pixel is 0.04 mm; symmetry pulls by less than that
    np.testing.assert_allclose(poses.pose * MM_PER_UNIT[unit], pose, atol=1.0)


@pytest.mark.parametrize("command", ["refine", "check-cameras"])
@pytest.mark.parametrize(
    ("write", "options", "option"),
    [
        (files.anipose, [], "--unit"),
        (files.qualisys, ["--unit", "m"], "--unit"),
        (files.human36m, [], "--subject"),
        (files.openpose, ["--size", "wide"], "--size"),
        (files.anipose, ["--calibration-format", "toml"], "--calibration-format"),
    ],
)
def test_what_is_missing_or_wrong_is_status_2_and_names_the_option(
    tmp_path, views, command, write, options, option
):
    layout = [] if command == "check-cameras" else LAYOUT  # which needs none without detections
    rest = [tmp_path / "none", "-o", tmp_path / "out"] if command == "refine" else []
    (tmp_path / "rig").mkdir()
    result = invoke(command, write(tmp_path / "rig", views), *rest, *layout, *options)
    assert_fails(result, 2, f"error: {option}: ", f"{command} --help")

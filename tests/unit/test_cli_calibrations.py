"""Calibrations of all formats on the command line: the unit where the file lacks it, and their options."""

from __future__ import annotations

import json

import numpy as np
import pytest

import calibration_files as files
import skelsplat as sk
from command_line import assert_fails, invoke
from skelsplat import synthetic
from skelsplat.io import read_npz

NAMES = ["54138969", "55011271", "58860488", "60457274"]
T = 3
LAYOUT = ["--layout", "h36m17"]
# How the file is written, what has to be said of it, its unit, and what the report calls it.
CALIBRATIONS = [
    (files.anipose, ["--unit", "m"], "m", "anipose"),
    (files.easymocap, ["--unit", "m", "--calibration-format", "easymocap"], "m", "easymocap"),
    (files.caliscope, [], "m", "caliscope"),
    (files.openpose, ["--size", "1000x1002"], "m", "openpose"),
    (files.panoptic, ["--camera-type", "hd"], "cm", "panoptic"),
    (files.human36m, ["--subject", "S9"], "mm", "human36m"),
    (files.qualisys, ["--binning", "1"], "mm", "qualisys"),
    (files.vicon, [], "mm", "vicon"),
    (files.own_json, [], "mm", "json"),
    (files.own_npz, [], "m", "npz"),
]


@pytest.fixture
def views():
    """Four cameras without distortion; their images have one size, which OpenPose has to be told."""
    return [
        files.View(view.name, view.K, view.R, view.t, (1000, 1002), view.distortion)
        for view in files.reference(NAMES, distortion=False)
    ]


def written(tmp_path, views, write):
    folder = tmp_path / "calibration"
    folder.mkdir()
    return write(folder, views)


def detections_of(tmp_path, views):
    """Write a walk seen by the views, without noise; return the file and the pose in mm."""
    pose = synthetic.motion("walk", T, seed=3)
    cameras = [sk.Camera(v.K, v.R, v.t, size=v.size, name=v.name) for v in views]
    seen = sk.project(pose, sk.CameraRig(cameras, unit="mm")).swapaxes(0, 1)
    path = tmp_path / "detections.npz"
    np.savez(path, detections=seen)
    return path, pose


def refine(tmp_path, calibration, detections, *options):
    always = [*LAYOUT, "--order", "sorted", "-q", "--fps", 50, "-o", tmp_path / "out"]
    return invoke("refine", calibration, detections, *always, *options)


@pytest.mark.parametrize(("write", "options", "unit", "name"), CALIBRATIONS)
def test_refine_reads_every_format_and_says_which(tmp_path, views, write, options, unit, name):
    calibration = written(tmp_path, views, write)
    detections, pose = detections_of(tmp_path, views)
    result = refine(tmp_path, calibration, detections, *options)
    assert result.exit_code == 0, result.output
    said = json.loads((tmp_path / "out" / "report.json").read_text())["input"]
    assert (said["unit"], said["calibration_format"]) == (unit, name)
    poses = read_npz(tmp_path / "out" / "pose.npz")
    assert poses.unit == unit
    in_mm = poses.pose * {"mm": 1.0, "cm": 10.0, "m": 1000.0}[unit]
    # the files hold six digits: at 4 m a hundredth of a pixel is 0.04 mm; symmetry pulls by less than that
    np.testing.assert_allclose(in_mm, pose, atol=1.0)


@pytest.mark.parametrize("command", ["refine", "live", "check-cameras"])
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
    result = invoke(command, written(tmp_path, views, write), *rest, *layout, *options)
    assert_fails(result, 2, f"error: {option}: ", f"{command} --help")

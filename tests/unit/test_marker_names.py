"""What joints are called in the marker files of other programs."""

from __future__ import annotations

import json

import ezc3d
import numpy as np
import pytest

import skelsplat as sk
from command_line import READ, assert_fails, invoke
from skelsplat.io import PoseData, read_trc, write_c3d, write_csv, write_pose, write_trc
from skelsplat.layouts import get

# Pose2Sim's skeletons, the nodes with a detection, in the order of the detector
LEGS = [side + name for side in "RL" for name in ("Hip", "Knee", "Ankle")]
FEET = [side + name for side in "RL" for name in ("BigToe", "SmallToe", "Heel")]
ARMS = [side + name for side in "RL" for name in ("Shoulder", "Elbow", "Wrist")]
POSE2SIM = {
    "halpe26": {"Hip", "Head", "Neck", "Nose", *LEGS, *FEET, *ARMS},
    "body25": {"CHip", "Neck", "Nose", *LEGS, *FEET, *ARMS},
    "body25b": {"Head", "Neck", "Nose", *LEGS, *FEET, *ARMS},
    "coco17": {"Nose", *LEGS, *ARMS},
}
FACE = {"LEye", "REye", "LEar", "REar"}  # Pose2Sim has no markers there


def poses(layout):
    joints = get(layout).joints
    rng = np.random.default_rng(0)
    return PoseData(rng.normal(0, 1, (3, len(joints), 3)), joints, np.arange(3), "m", frame_rate=50.0)


@pytest.mark.parametrize("layout", POSE2SIM)
def test_pose2sim_finds_its_markers(tmp_path, layout):
    write_trc(tmp_path / "a.trc", poses(layout), marker_names="pose2sim")
    read = read_trc(tmp_path / "a.trc")
    assert set(read.joint_names) - FACE == POSE2SIM[layout]
    place = dict(zip(get(layout).joints, read.joint_names, strict=True))
    assert (place["left_hip"], place["right_wrist"]) == ("LHip", "RWrist")
    np.testing.assert_allclose(read.pose, poses(layout).pose, atol=1e-6)


def test_c3d_takes_the_same_names(tmp_path):
    write_c3d(tmp_path / "a.c3d", poses("halpe26"), marker_names="pose2sim")
    labels = ezc3d.c3d(str(tmp_path / "a.c3d"))["parameters"]["POINT"]["LABELS"]["value"]
    assert set(labels) - FACE == POSE2SIM["halpe26"]


@pytest.mark.parametrize("write", [write_trc, write_c3d])
def test_an_unknown_style_is_refused(tmp_path, write):
    with pytest.raises(sk.InvalidInputError, match="marker_names: expected one of skelsplat, pose2sim, got"):
        write(tmp_path / "a", poses("coco17"), marker_names="opensim")
    assert not list(tmp_path.iterdir())


def test_a_format_without_markers_refuses_the_option(tmp_path):
    with pytest.raises(sk.InvalidInputError, match="marker_names"):
        write_pose(tmp_path / "a.csv", poses("coco17"), marker_names="pose2sim")


def test_refine_and_convert_take_the_option(recording, arguments, tmp_path):
    folder, _, _ = recording
    style = ["--marker-names", "pose2sim"]
    assert invoke(*arguments, *READ, "--fps", 50, "--write", "trc,c3d", *style).exit_code == 0
    assert "RHip" in read_trc(folder / "out" / "pose.trc").joint_names
    report = json.loads((folder / "out" / "report.json").read_text())
    assert "RHip" not in [joint["name"] for joint in report["reprojection_error"]["joints"]]
    assert invoke("convert", folder / "out" / "pose.npz", tmp_path / "b.trc", *style).exit_code == 0
    assert "RHip" in read_trc(tmp_path / "b.trc").joint_names
    write_csv(tmp_path / "c.csv", poses("coco17"))
    result = invoke("convert", tmp_path / "c.csv", tmp_path / "d.npz", *style)
    assert_fails(result, 2, "--marker-names", ".npz")

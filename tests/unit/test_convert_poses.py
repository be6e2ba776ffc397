"""Pose files into other formats, and the names of their joints in other programs."""

from __future__ import annotations

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import skelsplat as sk
from command_line import READ, assert_fails, invoke, succeed
from pose_sample import JOINTS, assert_equal, sample
from skelsplat import synthetic
from skelsplat.findings import collected_warnings
from skelsplat.io import (
    PoseData,
    read_json,
    read_npz,
    read_pose,
    read_trc,
    write_calibration,
    write_csv,
    write_json,
    write_npz,
    write_pose,
)
from skelsplat.io.poses import convert_poses
from skelsplat.io.poses._markers import IK_SETUPS, ik_model
from skelsplat.layouts import get, names


def test_between_formats_that_hold_everything(tmp_path):
    write_npz(tmp_path / "a.npz", sample())
    assert_equal(convert_poses(tmp_path / "a.npz", tmp_path / "b.json"), sample())
    before = (tmp_path / "b.json").read_bytes()
    result = invoke("convert", tmp_path / "a.npz", tmp_path / "b.json")
    assert_fails(result, 1, "b.json: OUTPUT: expected no file of this name (--force replaces it), got one")
    assert (tmp_path / "b.json").read_bytes() == before
    result = invoke("convert", tmp_path / "a.npz", tmp_path / "b.json", "--force")
    assert result.stdout == f"Wrote 4 frames of 3 joints to {tmp_path / 'b.json'}.\n"
    convert_poses(tmp_path / "b.json", tmp_path / "c.npz")
    assert_equal(read_npz(tmp_path / "c.npz"), sample())


def test_options_reach_the_target(tmp_path):
    write_json(tmp_path / "a.json", sample())
    convert_poses(tmp_path / "a.json", tmp_path / "a.trc", fps=25.0, unit="mm", y_up=True)
    back = read_trc(tmp_path / "a.trc")
    assert (back.frame_rate, back.unit) == (25.0, "mm")
    # half a unit of the third decimal
    np.testing.assert_allclose(back.pose[0], sample().pose[0][:, [1, 2, 0]], atol=5.0001e-4)
    convert_poses(tmp_path / "a.trc", tmp_path / "b.json", fps=20.0)
    assert read_json(tmp_path / "b.json").frame_rate == 20.0


def test_every_length_is_in_the_new_unit(tmp_path):
    write_npz(tmp_path / "a.npz", sample())
    convert_poses(tmp_path / "a.npz", tmp_path / "b.json", unit="cm")
    back, data = read_json(tmp_path / "b.json"), sample()
    assert back.unit == "cm"
    for name, factor in {"pose": 0.1, "init_pose": 0.1, "noise": 0.1, "uncertainty": 0.01}.items():
        np.testing.assert_allclose(getattr(back, name), getattr(data, name) * factor, rtol=1e-15)
    np.testing.assert_array_equal(back.reprojection_error, data.reprojection_error)
    for kind, unit in (("trc", "cm"), ("c3d", "m"), ("npz", "in")):
        command = ["convert", tmp_path / "b.json", tmp_path / f"c.{kind}", "--to-unit", unit]
        assert_fails(invoke(*command), 2, "--to-unit: expected", "got ")


def test_velocities_are_those_at_the_new_frame_rate(tmp_path):
    velocity = np.arange(4 * len(JOINTS) * 3.0).reshape(4, len(JOINTS), 3)
    squares = np.broadcast_to(np.eye(3), (4, len(JOINTS), 3, 3))
    data = replace(sample(), frame_rate=50.0, velocity=velocity, velocity_uncertainty=squares)
    write_npz(tmp_path / "a.npz", data)
    assert invoke("convert", tmp_path / "a.npz", tmp_path / "b.npz", "--fps", 25).exit_code == 0
    found = read_npz(tmp_path / "b.npz")
    assert found.frame_rate == 25.0
    np.testing.assert_array_equal(found.velocity, velocity / 2)
    np.testing.assert_array_equal(found.velocity_uncertainty, squares / 4)


def test_a_frame_rate_that_the_source_does_not_state_is_asked_for(tmp_path):
    write_csv(tmp_path / "a.csv", replace(sample(), frame_rate=None))
    with pytest.raises(sk.DatasetError, match=r"a\.csv: frame_rate"):
        convert_poses(tmp_path / "a.csv", tmp_path / "b.trc")
    convert_poses(tmp_path / "a.csv", tmp_path / "b.trc", fps=50.0)
    assert read_trc(tmp_path / "b.trc").joint_names == JOINTS


def test_what_cannot_be_converted(tmp_path):
    write_npz(tmp_path / "a.npz", sample())
    with pytest.raises(sk.DatasetError, match="target"):
        convert_poses(tmp_path / "a.npz", tmp_path / "." / "a.npz")
    with pytest.raises(sk.InvalidInputError, match="path"):
        convert_poses(tmp_path / "a.npz", tmp_path / "a.fbx")
    with pytest.raises(sk.InvalidInputError, match="y_up"):
        convert_poses(tmp_path / "a.npz", tmp_path / "a.csv", y_up=True)
    with pytest.raises(sk.DatasetError, match=r"b\.npz: file"):
        convert_poses(tmp_path / "b.npz", tmp_path / "b.json")
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_a_calibration_is_not_written_over_itself(tmp_path):
    path = tmp_path / "Calib.toml"
    write_calibration(path, synthetic.human36m_like())
    before = path.read_bytes()
    result = invoke("convert", path, tmp_path / "." / "Calib.toml", "--unit", "mm", "--to-unit", "m")
    assert_fails(result, 1, "Calib.toml: OUTPUT: expected another file than the input, got the same")
    assert path.read_bytes() == before


@pytest.mark.parametrize("options", [("--y-up",), ("--fps", "60"), ()])
def test_the_folder_of_a_run_stands_for_its_poses(tmp_path, options):
    run = tmp_path / "out"
    run.mkdir()
    write_npz(run / "pose.npz", replace(sample(), frame_rate=50.0))
    result = succeed("convert", run, tmp_path / "walk.trc", *options)
    assert result.stderr == ""
    write_npz(tmp_path / "a.npz", replace(sample(), frame_rate=50.0))
    assert invoke("convert", tmp_path / "a.npz", tmp_path / "a.trc", *options).exit_code == 0
    np.testing.assert_array_equal(read_trc(tmp_path / "walk.trc").pose, read_trc(tmp_path / "a.trc").pose)


def test_axes_that_are_turned_once_more_are_a_warning(tmp_path):
    write_npz(tmp_path / "a.npz", replace(sample(), frame_rate=50.0))
    for kind in ("trc", "c3d"):
        turned, again = tmp_path / f"a.{kind}", tmp_path / f"b.{kind}"
        result = invoke("convert", tmp_path / "a.npz", turned, "--y-up")
        assert (result.exit_code, result.stderr) == (0, "")
        assert invoke("convert", turned, again, "--y-up").stderr.startswith("warning: ")
        with collected_warnings() as found:
            convert_poses(turned, again, fps=50.0, y_up=True)
        assert [one.kind for one in found] == ["axes_turned"]
        assert invoke("convert", turned, again, "--force").stderr == ""
    invoke("convert", tmp_path / "a.npz", tmp_path / "up.c3d")
    assert invoke("convert", tmp_path / "up.c3d", tmp_path / "c.c3d", "--y-up").stderr == ""


# Pose2Sim's skeletons, the nodes with a detection
LEGS = [side + name for side in "RL" for name in ("Hip", "Knee", "Ankle")]
FEET = [side + name for side in "RL" for name in ("BigToe", "SmallToe", "Heel")]
ARMS = [side + name for side in "RL" for name in ("Shoulder", "Elbow", "Wrist")]
HANDS = [side + name for side in "RL" for name in ("Thumb", "Index", "Pinky")]
EYES = ["LEye", "REye"]
BLAZEPOSE = {"Nose", *EYES, *LEGS, *FEET, *ARMS, *HANDS} - {"LSmallToe", "RSmallToe"}
# By layout, Pose2Sim's model and the markers of its IK_Setup_Pose2Sim_*.xml.
POSE2SIM = {
    "halpe26": ("Halpe26", {"Hip", "Head", "Neck", "Nose", *LEGS, *FEET, *ARMS}),
    "body25": ("Body25", {"CHip", "Neck", "Nose", *LEGS, *FEET, *ARMS}),
    "body25b": ("Body25b", {"Head", "Neck", "Nose", *LEGS, *FEET, *ARMS}),
    "coco17": ("Coco17", {"Neck", "Nose", *LEGS, *ARMS}),
    "halpe136": ("Halpe68_136", {"Hip", "Head", "Neck", "Nose", *LEGS, *FEET, *ARMS, *HANDS}),
    "wholebody133": ("Coco133", {"Nose", *EYES, *LEGS, *FEET, *ARMS, *HANDS}),
    "mediapipe33": ("Blazepose", BLAZEPOSE),
    "h36m17": ("Coco17", {"Neck", "Nose", *LEGS, *ARMS}),
    "panoptic19": ("Coco17", {"Neck", "Nose", *LEGS, *ARMS}),
    "shelf14": ("Coco17", {"Neck", *LEGS, *ARMS}),
    "occlusion_person15": ("Coco17", {"Neck", *LEGS, *ARMS}),
}


def test_these_are_the_markers_of_pose2sim():
    package = find_spec("Pose2Sim")
    if package is None:
        pytest.skip("pose2sim is not installed (a wheel of 49 MB)")
    folder = Path(package.submodule_search_locations[0]) / "OpenSim_Setup"
    for layout, (setup, markers) in POSE2SIM.items():
        tree = ElementTree.parse(folder / f"IK_Setup_Pose2Sim_{setup}.xml")
        stated = {task.get("name"): float(task.find("weight").text) for task in tree.iter("IKMarkerTask")}
        lacking = {"Nose"} if layout in ("shelf14", "occlusion_person15") else set()
        assert stated.keys() - lacking == markers
        assert IK_SETUPS[ik_model(get(layout).joints)].weights == pytest.approx(stated)


def test_every_layout_of_people_has_a_model():
    assert {name for name in names if get(name).human} == POSE2SIM.keys()


@pytest.mark.parametrize("kind", ["trc", "c3d"])
@pytest.mark.parametrize("layout", POSE2SIM)
def test_pose2sim_finds_its_markers(tmp_path, layout, kind):
    path, joints = tmp_path / f"a.{kind}", get(layout).joints
    pose = np.random.default_rng(0).normal(0, 1, (3, len(joints), 3))
    data = PoseData(pose, joints, np.arange(3), "m", frame_rate=50.0)
    write_pose(path, data, marker_names="pose2sim")
    back = read_pose(path)
    wanted = IK_SETUPS[ik_model(joints)].weights
    assert set(back.joint_names) & wanted.keys() == POSE2SIM[layout][1]
    place = dict(zip(joints, back.joint_names, strict=False))
    assert (place["left_hip"], place["right_wrist"]) == ("LHip", "RWrist")
    if "Neck" not in place.values() and "Neck" in wanted:
        ends = [joints.index(f"{side}_shoulder") for side in ("left", "right")]
        np.testing.assert_allclose(back.in_unit("m").pose[:, -1], pose[:, ends].mean(axis=1), atol=1e-6)
    for name, style in ((f"b.{kind}", "opensim"), ("b.csv", "pose2sim")):
        with pytest.raises(sk.InvalidInputError, match="marker_names"):
            write_pose(tmp_path / name, data, marker_names=style)
    assert list(tmp_path.iterdir()) == [path]


def test_refine_and_convert_take_marker_names(folder, arguments, tmp_path):
    style = ["--marker-names", "pose2sim"]
    assert invoke(*arguments, *READ, "--fps", 50, "--write", "trc", *style).exit_code == 0
    assert "RHip" in read_trc(folder / "out" / "pose.trc").joint_names
    assert "RHip" not in read_npz(folder / "out" / "pose.npz").joint_names
    assert invoke("convert", folder / "out" / "pose.npz", tmp_path / "b.trc", *style).exit_code == 0
    assert "RHip" in read_trc(tmp_path / "b.trc").joint_names
    result = invoke("convert", folder / "out" / "pose.npz", tmp_path / "d.npz", *style)
    assert_fails(result, 2, "--marker-names", ".npz")

"""``skelsplat plot``: from a run or a file of poses to figures and numbers."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import skelsplat as sk
from command_line import assert_fails, invoke, succeed
from skelsplat.io import PoseData, read_npz, write_pose
from skelsplat.run.plots import read_source
from sweeps import swept

LAYOUT = sk.layouts.H36M17


def h36m(steps=6, **changes):
    """Return a still pose with every joint 100 mm above the last, in metres."""
    pose = np.zeros((steps, 17, 3))
    pose[..., 2] = 0.1 * np.arange(17)
    return replace(PoseData(pose, tuple(LAYOUT.joints), np.arange(steps) + 10, "m", frame_rate=50), **changes)


def written(path, data):
    write_pose(path, data)
    return path


def numbers(*arguments):
    result = succeed("plot", *arguments, "--json")
    return json.loads(result.stdout)


def test_a_run_gives_three_figures_in_its_folder(run_folder):
    result = succeed("plot", run_folder)
    assert result.stderr == ""
    for name in ("trajectories", "bones", "errors"):
        assert (run_folder / "plots" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert f"{name}.png" in result.stdout


def test_bone_lengths_are_those_of_numpy(run_folder):
    poses = read_npz(run_folder / "pose.npz")
    bones = numbers(run_folder, "--only", "bones")["bones"]
    assert len(bones) == len(LAYOUT.limbs)
    for name, side, ends in (
        ("knee – ankle", "left", ("left_knee", "left_ankle")),
        ("pelvis – hip", "right", ("pelvis", "right_hip")),
        ("nose – head", None, ("nose", "head")),
    ):
        a, b = (poses.pose[:, LAYOUT.joints.index(end)] for end in ends)
        lengths = np.linalg.norm(a - b, axis=1)
        (bone,) = [bone for bone in bones if (bone["limb"], bone["side"]) == (name, side)]
        assert bone["median_mm"] == pytest.approx(np.median(lengths), rel=1e-12)
        assert bone["sd_mm"] == pytest.approx(np.std(lengths), rel=1e-9)
        assert bone["frames_counted"] == 5


def test_weak_and_filled_ends_do_not_count(tmp_path):
    data = h36m(joint_status=np.full((6, 17), "ok", dtype="<U10"))
    knee = LAYOUT.joints.index("left_knee")
    data.pose[2:4, knee] = 99.0
    data.joint_status[2, knee], data.joint_status[3, knee] = "weak", "filled"
    bones = numbers(written(tmp_path / "p.npz", data), "--only", "bones")["bones"]
    (bone,) = [bone for bone in bones if (bone["limb"], bone["side"]) == ("knee – ankle", "left")]
    assert bone["frames_counted"] == 4
    assert bone["median_mm"] == pytest.approx(100.0)
    assert bone["sd_mm"] == pytest.approx(0.0, abs=1e-9)


def test_errors_are_medians_and_shares(run_folder):
    poses = read_npz(run_folder / "pose.npz")
    errors = numbers(run_folder, "--only", "errors")["errors"]
    assert errors["median_px"] == pytest.approx(np.nanmedian(poses.reprojection_error))
    used = np.isfinite(poses.view_weights)
    rejected = used & (poses.view_weights < sk.REJECTED_WEIGHT)
    for i, camera in enumerate(errors["cameras"]):
        assert camera["camera"] == poses.camera_names[i]
        assert camera["median_px"] == pytest.approx(np.nanmedian(poses.reprojection_error[:, i]))
        assert camera["rejected_share"] == pytest.approx(rejected[:, i].sum() / used[:, i].sum())
    for j, joint in enumerate(errors["joints"]):
        assert joint["joint"] == LAYOUT.joints[j]
        assert joint["median_px"] == pytest.approx(np.nanmedian(poses.reprojection_error[:, :, j]))


def test_the_standard_deviations_are_those_of_the_run(run_folder):
    poses = read_npz(run_folder / "pose.npz")
    found = numbers(run_folder, "--only", "trajectories", "--joints", "head,left_knee")["trajectories"]
    assert [joint["joint"] for joint in found] == ["head", "left_knee"]
    for joint in found:
        covariances = poses.error_bar[:, LAYOUT.joints.index(joint["joint"])]
        expected = np.median(np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)), axis=0)
        assert joint["sigma_median_mm"] == pytest.approx(expected.tolist())


def test_pose2sims_names_are_those_of_the_layout_they_came_from(tmp_path):
    layout = "halpe26"
    known = sk.layouts.get(layout)
    poses = h36m(pose=np.zeros((6, known.n_joints, 3)), joint_names=tuple(known.joints))
    path = tmp_path / "pose.trc"
    write_pose(path, poses, frame_rate=50.0, marker_names="pose2sim")
    found = read_source(path)
    assert "RWrist" in found.poses.joint_names
    assert found.limbs == tuple(known.limbs)
    assert found.left_right == tuple(known.left_right)
    backward = replace(found.poses, joint_names=found.poses.joint_names[::-1])
    write_pose(path, backward, frame_rate=50.0)
    last = known.n_joints - 1
    assert read_source(path).limbs == ()
    assert read_source(path, layout=layout).limbs == tuple((last - a, last - b) for a, b in known.limbs)


@pytest.mark.parametrize("suffix", ["npz", "trc", *map(swept, ["csv", "c3d", "json", "nc"])])
def test_any_pose_file_has_trajectories_and_bones(tmp_path, suffix):
    path = written(tmp_path / f"walk.{suffix}", h36m())
    result = succeed("plot", path)
    assert "warning: errors left out: the file has no errors per camera" in result.stderr
    assert (tmp_path / "plots" / f"walk.{suffix}" / "trajectories.png").is_file()
    assert (tmp_path / "plots" / f"walk.{suffix}" / "bones.png").is_file()
    assert not (tmp_path / "errors.png").exists()


def test_bones_need_a_layout(tmp_path):
    names = tuple(f"marker{k}" for k in range(17))
    path = written(tmp_path / "walk.npz", h36m(joint_names=names))
    result = succeed("plot", path, "--json")
    report = json.loads(result.stdout)
    assert "name the layout" in report["left_out"]["bones"]
    assert report["bones"] is None
    assert "warning: bones left out" in result.stderr
    assert len(numbers(path, "--layout", "H36M17", "--only", "bones")["bones"]) == len(LAYOUT.limbs)


@pytest.mark.parametrize(
    ("options", "status", "parts"),
    [
        (["--only", "bones,arms"], 2, ["--only", "'arms'"]),
        (["--joints", "head,tail"], 2, ["--joints", "'tail'"]),
        (["--layout", "body25"], 2, ["--layout", "body25"]),
        (["--range", "99-"], 2, ["--range", "99"]),
        (["--only", "errors"], 1, ["walk.npz", "errors per camera"]),
    ],
)
def test_a_wrong_option_is_named(tmp_path, options, status, parts):
    path = written(tmp_path / "walk.npz", h36m())
    assert_fails(invoke("plot", path, *options), status, *parts)

"""``refine --opensim``: markers, weights and commands, and what OpenSim makes of them."""

from __future__ import annotations

import subprocess
import sys
from importlib.util import find_spec
from xml.etree import ElementTree

import numpy as np
import pytest

import skelsplat as sk
from command_line import READ, assert_fails, invoke, read_report, succeed
from skelsplat.io import PoseData, read_trc, sample
from skelsplat.io.poses import OPENSIM_FILES, write_opensim
from skelsplat.io.poses._markers import IK_SETUPS
from skelsplat.run import Run
from skelsplat.run import run as run_job
from skelsplat.run.job import Job

Z_UP = np.array([0.0, 0.0, 1.0])
TRC, SETUP, SCRIPT = OPENSIM_FILES


def poses_of(layout="halpe26", sigma_mm=10.0, frames=6):
    """Poses of random joints in mm, with scatter."""
    joints = tuple(sk.layouts.get(layout).joints)
    pose = np.random.default_rng(5).normal(0, 500, (frames, len(joints), 3))
    scatter = np.broadcast_to(sigma_mm**2 * np.eye(3), (*pose.shape, 3))
    return PoseData(pose, joints, np.arange(frames) + 3, "mm", uncertainty=scatter, frame_rate=50.0)


def weights_of(folder):
    tree = ElementTree.parse(folder / SETUP)
    return {task.get("name"): float(task.find("weight").text) for task in tree.iter("IKMarkerTask")}


@pytest.mark.parametrize("up", [*np.eye(3), *-np.eye(3)], ids=["x", "y", "z", "-x", "-y", "-z"])
def test_markers_are_in_metres_with_y_up(tmp_path, up):
    data = poses_of()
    write_opensim(tmp_path, data, up)
    back = read_trc(tmp_path / TRC)
    assert (back.unit, back.frame_rate) == ("m", 50.0)
    hips = [data.joint_names.index(f"{side}_hip") for side in ("left", "right")]
    there = data.pose[:, hips] / 1000.0
    found = back.pose[:, [back.joint_names.index(name) for name in ("LHip", "RHip")]]
    np.testing.assert_allclose(found[..., 1], there @ up, atol=1e-6)
    turn = np.linalg.lstsq(there.reshape(-1, 3), found.reshape(-1, 3), rcond=None)[0]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-4)
    assert np.linalg.det(turn) > 0


def test_a_marker_weighs_less_the_more_it_scatters(tmp_path):
    data = poses_of()
    knee = data.joint_names.index("left_knee")
    data.uncertainty[:3, knee] *= 9.0  # of half the frames
    write_opensim(tmp_path, data, Z_UP)
    weights, usual = weights_of(tmp_path), IK_SETUPS["HALPE_26"].weights
    assert list(weights) == list(read_trc(tmp_path / TRC).joint_names)
    assert sum(weights.values()) == pytest.approx(sum(usual.values()), abs=2e-3)
    found = weights["LKnee"] / weights["RKnee"]
    assert found == pytest.approx((25**2 + 10**2) / (25**2 + 5 * 10**2), abs=1e-3)


def test_without_scatter_the_weights_are_those_of_pose2sim(tmp_path):
    data = poses_of("mediapipe33")
    write_opensim(tmp_path, PoseData(data.pose, data.joint_names, data.frames, "mm"), Z_UP, 50.0)
    assert weights_of(tmp_path) == pytest.approx(IK_SETUPS["BLAZEPOSE"].weights, abs=1e-4)


def test_what_is_never_seen_is_left_out(tmp_path):
    data = poses_of("body25")
    data.pose[:, data.joint_names.index("left_heel")] = np.nan
    data.pose[[0, 1, 3, 5]] = np.nan
    write_opensim(tmp_path, data, Z_UP)
    back = read_trc(tmp_path / TRC)
    assert set(IK_SETUPS["BODY_25"].weights) - set(back.joint_names) == {"LHeel"}
    assert "LHeel" not in weights_of(tmp_path)
    assert back.frames.tolist() == [1, 3, 5]  # the first for the times
    assert np.isfinite(back.pose[1:]).all()
    assert ElementTree.parse(tmp_path / SETUP).find(".//time_range").text == "0.040000 0.080000"


@pytest.mark.parametrize(
    ("layout", "markers", "without"),
    [("coco17", "BODY_25", "LBigToe"), ("halpe136", "HALPE_136", "Hip"), ("h36m17", "BODY_25", "Hip")],
)
def test_markers_that_pose2sim_misplaces_are_not_used(tmp_path, layout, markers, without):
    write_opensim(tmp_path, poses_of(layout), Z_UP)
    assert f'MARKERS = "{markers}"' in (tmp_path / SCRIPT).read_text()
    assert without not in read_trc(tmp_path / TRC).joint_names


# runs


def test_refine_writes_them_and_a_later_run_removes_them(finished_run, tmp_path):
    out = tmp_path / "out"
    stored = [finished_run / "cameras.json", finished_run / "detections.npz"]
    given = ["refine", *stored, *READ, "--fps", 50, "--no-html", "-o", out]
    result = succeed(*given, "--opensim")
    assert set(OPENSIM_FILES) <= set(read_report(out)["files"])
    first, again = (out / SETUP).read_text(), tmp_path / "again"
    Run.open(out).write(again, ("npz",), html=False, opensim=True)
    assert (again / SETUP).read_text() == first
    assert (again / TRC).read_text() == (out / TRC).read_text()
    (out / "opensim" / "poses.mot").touch()
    result = invoke(*given)
    assert "! opensim/poses.mot is from an earlier run" in result.stdout
    assert [path.name for path in (out / "opensim").iterdir()] == ["poses.mot"]
    (out / "opensim" / "poses.mot").unlink()
    assert invoke(*given, "--opensim").exit_code == 0
    assert "earlier run" not in invoke(*given).stdout
    assert not (out / "opensim").exists()


def test_what_is_no_person_is_refused_before_the_work(tmp_path):
    rig = sk.synthetic.ring(3)
    hand = np.random.default_rng(1).normal(0, 80, (2, 21, 3))
    np.savez(tmp_path / "hand.npz", detections=sk.project(hand, rig).swapaxes(0, 1))
    sk.io.write_calibration(tmp_path / "rig.json", rig)
    files = [tmp_path / "rig.json", tmp_path / "hand.npz", "--order", "sorted", "--layout", "hand21"]
    result = invoke("refine", *files, "--unit", "mm", "--opensim", "-o", tmp_path / "out")
    assert_fails(result, 2, "--opensim", "shoulders, hips, knees", "got hand21")
    assert not (tmp_path / "out").exists()


# OpenSim


@pytest.fixture(scope="module")
def balancing(tmp_path_factory):
    """Return the first poses of the embedded recording."""
    paths = sample.extract(tmp_path_factory.mktemp("sample"))
    job = Job(paths.calibration, paths.detections, unit="m", layout="body25b", fps=60.0)
    poses = run_job(job).poses
    return PoseData(poses.pose[:12], poses.joint_names, poses.frames[:12], "m", frame_rate=60.0)


def as_mediapipe(data):
    """Return the same joints in the order and by the names of mediapipe33."""
    joints = tuple(sk.layouts.get("mediapipe33").joints)
    pose = np.full((len(data.pose), len(joints), 3), np.nan)
    for k, name in enumerate(joints):
        name = name.replace("foot_index", "big_toe")
        if name in data.joint_names:
            pose[:, k] = data.pose[:, data.joint_names.index(name)]
    return PoseData(pose, joints, data.frames, "m", frame_rate=60.0)


def angles_from_opensim(folder, data):
    """Run the commands; return angles by name, in degrees."""
    folder.mkdir()
    write_opensim(folder, data, Z_UP)
    done = subprocess.run([sys.executable, folder / SCRIPT], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    _, _, table = (folder / "opensim" / "poses.mot").read_text().partition("endheader\n")
    header, *rows = (line.split("\t") for line in table.splitlines())
    return dict(zip(header, np.array(rows, dtype=float).T, strict=True))


@pytest.mark.timeout(300)
def test_opensim_finds_the_angles_of_a_person(balancing, tmp_path):
    """They are nearly ours, and the same by the names of both layouts."""
    for name in ("opensim", "Pose2Sim"):
        if find_spec(name) is None:
            pytest.skip(f"{name.lower()} is not installed (wheels of 120 MB)")
    found = angles_from_opensim(tmp_path / "openpose", balancing)
    np.testing.assert_allclose(found["time"], np.arange(12) / 60, atol=1e-6)
    ours = sk.joint_angles(balancing.pose, layout="body25b")
    for side in ("left", "right"):
        for name, theirs in (("knee_flexion", "knee_angle"), ("hip_flexion", "hip_flexion")):
            assert np.abs(found[f"{theirs}_{side[0]}"] - ours[f"{side}_{name}"]).max() < 15
        elbow = found[f"elbow_flex_{side[0]}"] - ours[f"{side}_elbow_flexion"]
        assert np.ptp(elbow) < 5  # the model's straight arm is bent by 15° between its markers
    again = angles_from_opensim(tmp_path / "mediapipe", as_mediapipe(balancing))
    for name in ("ankle_angle", "knee_angle", "hip_flexion"):
        for side in "lr":
            assert np.abs(again[f"{name}_{side}"] - found[f"{name}_{side}"]).max() < 8

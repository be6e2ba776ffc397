"""``refine --angles``: the files of joint angles, their picture, and the page's curves."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

import skelsplat as sk
from command_line import READ, RESULTS, assert_fails, invoke, read_report, succeed
from skelsplat.io import read_npz
from skelsplat.run import Run
from skelsplat.run.angles import FILES
from skelsplat.run.folder import find_in_files
from skelsplat.run.job import Writing

NAMES = 16  # angles of h36m17, which has no feet


@pytest.fixture
def no_pictures(monkeypatch):
    monkeypatch.setattr("skelsplat.run.folder.can_draw", lambda: False)


@pytest.fixture(scope="module")
def with_angles(finished_run, tmp_path_factory):
    """Return the folder of a run with angles; not to be written to."""
    out = tmp_path_factory.mktemp("angles") / "out"
    stored = [finished_run / "cameras.json", finished_run / "detections.npz"]
    result = succeed("refine", *stored, *READ, "--fps", 50, "--angles", "-o", out)
    assert "angles.csv" in result.stdout
    return out


def test_three_files_come_with_the_others_and_are_listed(with_angles):
    assert {path.name for path in with_angles.iterdir()} == RESULTS | set(FILES)
    report = read_report(with_angles)
    assert set(FILES) <= set(report["files"])
    assert report["joint_angles"]["up"] == [0.0, 0.0, 1.0]
    assert len(report["joint_angles"]["names"]) == NAMES


def test_the_files_hold_the_angles_of_the_poses(with_angles):
    poses = read_npz(with_angles / "pose.npz")
    expected = sk.joint_angles(poses.pose, layout="h36m17", uncertainty=poses.error_bar)
    scatter = sk.joint_angles(poses.pose, layout="h36m17", uncertainty=poses.uncertainty)
    with np.load(with_angles / "angles.npz") as stored:
        assert tuple(stored["names"]) == expected.names
        np.testing.assert_array_equal(stored["degrees"], expected.degrees)
        np.testing.assert_array_equal(stored["sigma"], expected.sigma)
        np.testing.assert_array_equal(stored["scatter"], scatter.sigma)
        np.testing.assert_array_equal(stored["frames"], poses.frames)
        assert stored["frame_rate"] == 50
        np.testing.assert_array_equal(stored["up"], [0, 0, 1])
    rows = list(csv.DictReader((with_angles / "angles.csv").read_text().splitlines()))
    assert list(rows[0])[:3] == ["frame", "time", expected.names[0]]
    assert [int(row["frame"]) for row in rows] == poses.frames.tolist()
    assert [float(row["time"]) for row in rows] == ((poses.frames - poses.frames[0]) / 50).tolist()
    for values, end in ((expected.degrees, ""), (expected.sigma, "_sigma"), (scatter.sigma, "_scatter")):
        read = np.array([[float(row[name + end]) for name in expected.names] for row in rows])
        np.testing.assert_allclose(read, values, atol=0.5e-4)
    np.testing.assert_array_equal(Run.open(with_angles).angles.degrees, expected.degrees)


def test_the_motion_file_has_the_header_of_opensim(with_angles):
    lines = (with_angles / "angles.mot").read_text().splitlines()
    rows = [line.split("\t") for line in lines[6:]]
    assert lines[:6] == [
        "Coordinates",
        "version=1",
        f"nRows={len(rows) - 1}",
        f"nColumns={len(rows[0])}",
        "inDegrees=yes",
        "endheader",
    ]
    assert rows[0][:2] == ["time", "left_hip_flexion"]
    assert [float(row[0]) for row in rows[1:]] == pytest.approx([0, 0.02, 0.04, 0.06, 0.08])
    with np.load(with_angles / "angles.npz") as stored:
        np.testing.assert_allclose(np.array(rows[1:], dtype=float)[:, 1:], stored["degrees"], atol=0.5e-4)


@pytest.mark.usefixtures("no_pictures")
def test_cameras_without_a_vertical_leave_out_trunk_and_pelvis(finished_run, tmp_path):
    run = Run.open(finished_run)
    down = [
        sk.Camera(camera.K, np.diag([k, -k, -1.0]), camera.t, size=camera.size, name=camera.name)
        for camera, k in zip(run.cameras, (1.0, -1.0, 1.0, -1.0), strict=True)
    ]
    run = replace(run, inputs=replace(run.inputs, rig=sk.CameraRig(down)))
    run.write(tmp_path / "out", ("npz",), html=False, angles=True)
    report = read_report(tmp_path / "out")
    assert "vertical_unknown" in [note.kind for note in find_in_files(Writing(angles=True), run.inputs)]
    assert report["joint_angles"]["up"] is None
    assert report["joint_angles"]["names"][-1] == "right_elbow_flexion"
    with np.load(tmp_path / "out" / "angles.npz") as stored:
        assert np.isnan(stored["up"]).all()


# plot


def test_angles_are_drawn_with_their_bands(with_angles, tmp_path, figures):
    result = succeed("plot", with_angles, "--only", "angles", "-o", tmp_path, "--json")
    (knee,) = [one for one in json.loads(result.stdout)["angles"] if one["angle"] == "left_knee_flexion"]
    with np.load(with_angles / "angles.npz") as stored:
        column = stored["names"].tolist().index("left_knee_flexion")
        assert knee["median_degrees"] == pytest.approx(np.median(stored["degrees"][:, column]))
        assert knee["sigma_median_degrees"] == pytest.approx(np.median(stored["sigma"][:, column]))
        curves = [line.get_ydata() for axes in figures[0].axes for line in axes.lines]
        assert any(np.array_equal(curve, stored["degrees"][:, column]) for curve in curves)
    assert (tmp_path / "angles.png").is_file()


def test_chosen_joints_choose_the_angles_at_them(with_angles, tmp_path):
    def drawn(joints):
        return invoke("plot", with_angles, "--only", "angles", "-o", tmp_path, "--json", "--joints", joints)

    names = [one["angle"] for one in json.loads(drawn("left_knee,right_elbow,head").stdout)["angles"]]
    assert sorted(names) == ["left_knee_flexion", "right_elbow_flexion"]
    assert_fails(drawn("head"), 1, "no angle at head")


@pytest.mark.usefixtures("no_pictures")
def test_a_layout_with_angles_of_its_own_brings_them_into_files_and_figures(finished_run, tmp_path):
    joints, limbs = sk.layouts.H36M17.joints, sk.layouts.H36M17.limbs
    own = sk.Layout("own", joints, limbs=limbs, angles=[("bend", ["spine", "neck", "head"], -1, 90)])
    sk.layouts.write(tmp_path / "own.toml", own)
    stored = [finished_run / "cameras.json", finished_run / "detections.npz"]
    command = ["refine", *stored, "--unit", "mm", "--layout", tmp_path / "own.toml", "--angles"]
    result = succeed(*command, "--fps", 50, "-o", tmp_path / "out", "--no-html")
    poses = read_npz(tmp_path / "out" / "pose.npz")
    expected = sk.joint_angles(poses.pose, layout=own, uncertainty=poses.error_bar)
    with np.load(tmp_path / "out" / "angles.npz") as stored:
        assert tuple(stored["names"]) == expected.names
        assert expected.names[-1] == "bend"
        np.testing.assert_array_equal(stored["degrees"], expected.degrees)
        np.testing.assert_array_equal(stored["sigma"], expected.sigma)
    result = invoke("plot", tmp_path / "out", "--joints", "neck", "--only", "angles", "--json")
    (drawn,) = json.loads(result.stdout)["angles"]
    assert drawn["angle"] == "bend"

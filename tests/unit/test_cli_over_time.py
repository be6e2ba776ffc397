"""``skelsplat refine`` over time, in other formats and of joints that one view sees: files and sentences."""

from __future__ import annotations

import csv
import json
import sys

import numpy as np
import pytest

from command_line import READ, assert_fails, invoke, succeed
from skelsplat import temporal
from skelsplat.io import read_c3d, read_json, read_netcdf, read_npz, read_trc
from skelsplat.run import engine

FPS = ["--fps", "50", "--frame-by-frame", "-q"]
long_enough = pytest.mark.parametrize("recording", [9], indirect=True)  # for a filter of order 2: seven


def test_a_gap_is_filled_and_marked(gap, arguments):
    assert invoke(*arguments, *READ, *FPS).exit_code == 0
    plain = read_npz(gap / "out" / "pose.npz")
    result = succeed(*arguments, *READ, "--fps", 50, "--frame-by-frame", "--fill-gaps", 1)
    written = read_npz(gap / "out" / "pose.npz")
    expected, filled = temporal.fill_gaps(plain.pose, 1)
    assert np.argwhere(filled).tolist() == [[2, 16]]
    np.testing.assert_array_equal(written.pose, expected)
    np.testing.assert_array_equal(np.argwhere(written.joint_status == "filled"), [[2, 16]])
    assert np.isnan(written.uncertainty[2, 16]).all()
    with (gap / "out" / "pose.csv").open(newline="") as stream:
        assert [row["status"] for row in csv.DictReader(stream)].count("filled") == 1
    sentence = "Gaps of at most 1 frames filled by cubic splines: 1 joint positions, whose status is filled."
    assert written.processing == (sentence,)
    assert sentence in " ".join(result.stdout.split())
    report = json.loads((gap / "out" / "report.json").read_text())["over_time"]
    assert report["gaps"] == {"max_frames": 1, "weak_joints_too": False, "filled": 1}
    assert report["processing"] == [sentence]


@long_enough
def test_the_filter_is_that_of_temporal_and_is_stated_in_every_format_with_a_place(gap, arguments):
    for package in ("ezc3d", "xarray", "h5netcdf", "h5py"):
        pytest.importorskip(package, reason=f"{package} is not installed")
    assert invoke(*arguments, *READ, *FPS).exit_code == 0
    plain = read_npz(gap / "out" / "pose.npz").pose
    run = [*arguments, *READ, *FPS, "--filter", "butterworth:6:2", "--write", "npz,json,c3d,nc,trc"]
    assert invoke(*run).exit_code == 0
    expected, left = temporal.butterworth(plain, 50.0, 6.0, order=2)
    sentence = (
        "Low-pass: Butterworth of order 2, −3 dB at 6 Hz, zero-lag (forward and backward); "
        f"{left.sum()} joint positions in runs too short for it are unchanged. Uncertainties, weights and "
        "reprojection errors are from before filtering."
    )
    readers = {"npz": read_npz, "json": read_json, "c3d": read_c3d, "nc": read_netcdf}
    for kind, read in readers.items():
        data = read(gap / "out" / f"pose.{kind}")
        # C3D has single precision
        np.testing.assert_allclose(data.pose, expected, rtol=1e-7 if kind == "c3d" else 0.0, err_msg=kind)
        assert data.processing == (sentence,)
        assert data.frame_rate == 50.0
    assert read_trc(gap / "out" / "pose.trc").frame_rate == 50.0
    entry = json.loads((gap / "out" / "report.json").read_text())["over_time"]["filter"]
    assert entry == {
        "name": "butterworth",
        "cutoff_hz": 6.0,
        "order": 2,
        "left_as_they_are": left.sum(),
        "weak_left": 0,
    }


def with_a_weak_joint(recording):
    """Let two views see the right wrist in frame 2, and contradict each other."""
    folder, rig, _ = recording
    seen = {0: 0.0, 1: 300.0}
    for i, name in enumerate(rig.names):
        path = folder / "openpose" / name / "000002_keypoints.json"
        document = json.loads(path.read_text())
        joint = document["people"][0]["pose_keypoints_2d"]
        joint[48:51] = [joint[48], joint[49] + seen[i], 0.9] if i in seen else [0.0, 0.0, 0.0]
        path.write_text(json.dumps(document))


def test_weak_joints_are_filled_when_asked(recording, arguments):
    folder, _, _ = recording
    with_a_weak_joint(recording)
    run = [*arguments, *READ, *FPS, "--fill-gaps", "2"]
    left = succeed(*run)
    assert read_npz(folder / "out" / "pose.npz").processing == ()  # there is no gap
    assert "warning: Weak joints" in left.stderr
    assert read_npz(folder / "out" / "pose.npz").joint_status[2, 16] == "weak"
    filled = succeed(*run, "--fill-weak")
    assert "Weak joints" not in filled.stderr
    written = read_npz(folder / "out" / "pose.npz")
    assert written.joint_status[2, 16] == "filled"
    assert np.isnan(written.uncertainty[2, 16]).all()
    np.testing.assert_allclose(written.pose[2, 16], written.pose[[1, 3], 16].mean(axis=0), atol=20.0)


def test_an_unknown_frame_rate_is_a_warning_of_the_files_that_need_one(folder, arguments):
    pytest.importorskip("ezc3d", reason="ezc3d is not installed")
    run = [*arguments, *READ, "-q", "--write"]
    assert invoke(*run, "npz,csv,json").stderr == ""
    assert read_json(folder / "out" / "pose.json").frame_rate is None
    result = invoke(*run, "c3d,trc,npz")
    assert "the times in pose.c3d and pose.trc assume 30" in result.stderr
    assert read_c3d(folder / "out" / "pose.c3d").frame_rate == 30.0
    assert read_npz(folder / "out" / "pose.npz").frame_rate is None


@pytest.mark.parametrize(
    ("extra", "modules", "package"),
    [
        (["--write", "c3d"], ["ezc3d"], "formats"),
        (["--write", "nc"], ["h5netcdf"], "formats"),
        (["--fps", "50", "--filter", "butterworth"], ["scipy.signal"], "temporal"),
        (["--fill-gaps", "3"], ["scipy.interpolate"], "temporal"),
    ],
)
def test_a_missing_package_is_status_1_before_the_work(arguments, monkeypatch, extra, modules, package):
    for module in modules:
        monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setattr(engine, "open_files", lambda *_: pytest.fail("it read"))
    assert_fails(invoke(*arguments, *READ, *extra), 1, f"pip install 'skelsplat[{package}]'")


FREE = ["--fps", "50", "--frame-by-frame", "--free-bones"]


def hide(recording, frame=2):
    """Let the first view alone see the right wrist in a frame."""
    folder, rig, _ = recording
    for name in rig.names[1:]:
        path = folder / "openpose" / name / f"00000{frame}_keypoints.json"
        document = json.loads(path.read_text())
        document["people"][0]["pose_keypoints_2d"][48:51] = [0.0, 0.0, 0.0]
        path.write_text(json.dumps(document))
    return folder / "out"


@pytest.mark.drawn
def test_a_joint_that_a_single_view_detects_is_said_to_have_none(recording, arguments):
    out = hide(recording)
    result = invoke(*arguments, *READ, *FREE, "--filter", "butterworth")
    assert "right_wrist (frame 2)" in " ".join(result.stdout.split())
    data = read_npz(out / "pose.npz")
    assert data.joint_status[2, 16] == "weak"
    assert np.isnan(data.pose[2, 16]).all()
    with (out / "pose.csv").open(newline="") as stream:
        rows = {(row["frame"], row["joint"]): row for row in csv.DictReader(stream)}
    row = rows["2", "right_wrist"]
    assert (row["x"], row["status"], row["n_views"]) == ("", "weak", "0")


@pytest.mark.drawn
@pytest.mark.parametrize(("frame", "helps"), [(2, True), (4, False)])
def test_filling_gaps_is_a_remedy_only_between_frames_that_have_the_joint(recording, arguments, frame, helps):
    out = hide(recording, frame)
    assert invoke(*arguments, *READ, *FREE).exit_code == 0
    (found,) = [
        finding
        for finding in json.loads((out / "report.json").read_text())["findings"]
        if finding["kind"] == "unobserved_joints"
    ]
    assert ("fill_gaps" in [remedy["setting"] for remedy in found["remedy"]]) == helps

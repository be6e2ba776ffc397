"""Pose files as JSON, CSV and NetCDF, and all formats by their extension."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import skelsplat as sk
from pose_sample import JOINTS, MISSING, N, assert_equal, sample
from skelsplat.io import (
    PoseData,
    read_csv,
    read_json,
    read_npz,
    read_pose,
    write_csv,
    write_json,
    write_npz,
    write_pose,
)
from skelsplat.io.poses import POSE_FORMATS
from skelsplat.io.poses._csv import _rate

# json


def test_json_returns_every_field(tmp_path):
    write_json(tmp_path / "pose.json", sample())
    assert_equal(read_json(tmp_path / "pose.json"), sample())


def test_json_is_strict_has_a_line_per_frame_and_null_for_a_missing_joint(tmp_path):
    write_json(tmp_path / "pose.json", sample())
    text = (tmp_path / "pose.json").read_text(encoding="utf-8")
    document = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    lines = [line for line in text.splitlines() if line.startswith('{"frame"')]
    assert [json.loads(line.removesuffix(","))["frame"] for line in lines] == [10, 11, 13, 14]
    assert (document["format"], document["version"], document["unit"]) == ("skelsplat-poses", 1, "mm")
    for t, j in MISSING:
        assert document["frames"][t]["pose"][j] is None
        assert document["frames"][t]["uncertainty"][j] is None
    assert document["frames"][0]["view_weights"][1][0] is None
    assert document["frames"][2]["noise"] is None


def test_json_of_other_programs_needs_little(tmp_path):
    frames = [{"frame": 3, "pose": [[1, 2.5, None], None]}]
    document = {"format": "skelsplat-poses", "version": 1, "unit": "m", "joint_names": ["a", "b"]}
    (tmp_path / "own.json").write_text(json.dumps({**document, "frames": frames}))
    pose = np.array([[[1.0, 2.5, np.nan], [np.nan] * 3]])
    assert_equal(read_json(tmp_path / "own.json"), PoseData(pose, ("a", "b"), np.array([3]), "m"))


def with_frame(t, **change):
    def alter(document):
        document["frames"][t].update(change)
        return document

    return alter


def without(*keys):
    return lambda document: {key: value for key, value in document.items() if key not in keys}


MALFORMED_JSON = {
    "another format": (lambda d: {**d, "format": "coco"}, "format: expected .*, got 'coco'"),
    "no names": (without("joint_names"), "joint_names: expected a list of strings, got nothing"),
    "inches": (lambda d: {**d, "unit": "in"}, "unit: expected one of mm, cm, m, got 'in'"),
    "no frames": (without("frames"), "frames: expected a list of objects, got nothing"),
    "a joint too few": (with_frame(1, pose=[None]), r"frames\[1\].pose"),
    "text": (with_frame(2, pose=[None, [1, 2, "x"], None]), r"frames\[2\].pose\[1\]\[2\]"),
    "400 digits": (with_frame(0, noise=10**400), r"frames\[0\].noise"),
}


@pytest.mark.parametrize("case", MALFORMED_JSON)
def test_a_malformed_json(tmp_path, case):
    change, message = MALFORMED_JSON[case]
    path = tmp_path / "pose.json"
    write_json(path, sample())
    path.write_text(json.dumps(change(json.loads(path.read_text(encoding="utf-8")))))
    with pytest.raises(sk.DatasetError, match=rf"pose\.json: {message}") as caught:
        read_json(path)
    assert "\n" not in str(caught.value)


# csv


def test_csv_and_back(tmp_path):
    data = sample()
    write_csv(tmp_path / "pose.csv", data)
    back = read_csv(tmp_path / "pose.csv")
    diagonal = data.uncertainty * np.eye(3)
    np.testing.assert_allclose(back.uncertainty, diagonal, rtol=1e-15)  # a root and a square
    names = ("pose", "joint_names", "frames", "unit", "joint_status")
    for name in names:
        np.testing.assert_array_equal(getattr(back, name), getattr(data, name), err_msg=name)


@pytest.mark.parametrize("rate", [25.0, 29.97, 60.0, 240.0, 0.2, 24000 / 1001, 30000 / 1001])
def test_csv_has_times_and_the_frame_rate_is_read_from_them(tmp_path, rate):
    data = replace(sample(), frame_rate=rate)
    write_csv(tmp_path / "pose.csv", data)
    back = read_csv(tmp_path / "pose.csv")
    assert back.frame_rate == rate
    np.testing.assert_array_equal(back.pose, data.pose)
    lines = (tmp_path / "pose.csv").read_text().splitlines()
    assert lines[0].startswith("frame,time,joint,x,")
    assert lines[1].startswith(f"10,0.0,{JOINTS[0]},")
    assert lines[-1].startswith(f"14,{4 / rate!r},{JOINTS[-1]},")
    cut = [lines[0], *lines[1 + N :]]  # without the first frame
    (tmp_path / "pose.csv").write_text("\n".join(cut))
    assert read_csv(tmp_path / "pose.csv").frame_rate == pytest.approx(rate, rel=1e-14)


@pytest.mark.parametrize("rate", [24.0, 29.97, 30.0, 59.94, 120.0])
def test_times_that_r_or_a_spreadsheet_rounded_have_the_frame_rate(rate):
    frames = np.arange(7, 5000)
    texts = [f"{time:.15g}" for time in frames / rate]
    assert _rate(frames, texts) == rate
    assert _rate(frames[:2], texts[:2]) == pytest.approx(rate, rel=1e-13)


def test_csv_of_other_programs_needs_little(tmp_path):
    (tmp_path / "own.csv").write_text(
        "joint,frame,unit,x,y,z\na,3,m,1,2,3\nb,3,m,,,\na,5,m,4,5,6\nb,5,m,7,8,9\n"
    )
    pose = np.array([[[1.0, 2, 3], [np.nan] * 3], [[4, 5, 6], [7, 8, 9]]])
    assert_equal(read_csv(tmp_path / "own.csv"), PoseData(pose, ("a", "b"), np.array([3, 5]), "m"))


MALFORMED_CSV = {
    "empty": (lambda _: [], "line 1: expected a column frame, got nothing"),
    "text": (
        lambda lines: [*lines[:2], lines[2].replace("11,", "eleven,").replace("10,", "ten,", 1), *lines[3:]],
        "line 3, frame: expected a number, got 'ten'",
    ),
    "a field too few": (
        lambda lines: [*lines[:3], lines[3].rpartition(",")[0], *lines[4:]],
        "line 4: expected 17 fields, got 16 fields",
    ),
    "a joint too few": (
        lambda lines: [*lines[:5], *lines[6:]],
        "line 6",
    ),
    "a joint twice": (
        lambda lines: [*lines[:4], lines[1], *lines[4:]],
        "line 5",
    ),
    "frames that descend": (
        lambda lines: [lines[0], *lines[1 + N : 1 + 2 * N], *lines[1 : 1 + N]],
        "line 5",
    ),
    "two units": (
        lambda lines: [*lines[:4], lines[4].replace(",mm,", ",m,"), *lines[5:]],
        "line 5: expected the unit mm, cm or m, one for all, got 'm'",
    ),
    "a quote": (lambda lines: [*lines[:2], '"' + lines[2]], "line 3: expected comma-separated fields"),
}


@pytest.mark.parametrize("case", MALFORMED_CSV)
def test_a_malformed_csv(tmp_path, case):
    change, message = MALFORMED_CSV[case]
    path = tmp_path / "pose.csv"
    write_csv(path, sample())
    path.write_text("\n".join(change(path.read_text().splitlines())))
    with pytest.raises(sk.DatasetError, match=rf"pose\.csv: {message}"):
        read_csv(path)


LACKING = "joint_status: expected unobserved or weak in frame 13, joint nose, which has no position, got "


@pytest.mark.parametrize("status", ["ok", "inferred", "filled"])
def test_a_joint_that_is_determined_has_a_position(tmp_path, status):
    data = sample()
    pose, statuses = data.pose.copy(), data.joint_status.copy()
    statuses[2, 0] = status
    write_npz(tmp_path / "a.npz", replace(data, joint_status=statuses))
    pose[2, 0, 1] = np.nan
    with pytest.raises(sk.InvalidInputError, match=f"^{LACKING}{status}$"):
        replace(data, pose=pose, joint_status=statuses)
    for allowed in ("weak", "unobserved"):
        statuses[2, 0] = allowed
        write_npz(tmp_path / "b.npz", replace(data, pose=pose, joint_status=statuses))
        assert read_npz(tmp_path / "b.npz").joint_status[2, 0] == allowed
    with np.load(tmp_path / "a.npz") as arrays:
        np.savez(tmp_path / "c.npz", **{**arrays, "pose": pose})
    with pytest.raises(sk.DatasetError, match=rf"c\.npz: .*{LACKING}{status}$"):
        read_npz(tmp_path / "c.npz")


# by extension


@pytest.fixture(params=POSE_FORMATS)
def kind(request):
    for package in POSE_FORMATS[request.param].packages:
        pytest.importorskip(package, reason=f"{package} is not installed")
    return request.param


def test_the_extension_names_the_format(tmp_path, kind):
    path = tmp_path / f"pose.{kind.upper()}"
    write_pose(path, sample())
    back = read_pose(path)
    assert back.joint_names == JOINTS
    there = np.isfinite(sample().pose)
    factor = 1e3 if back.unit == "m" else 1.0
    pose = back.pose[[0, 1, 3, 4]] if kind == "c3d" else back.pose
    # trc has micrometres, c3d single precision of some metres in mm
    np.testing.assert_allclose((pose * factor)[there], sample().pose[there], rtol=1e-7, atol=1e-3)
    assert np.isnan(pose[~there]).all()


def test_a_file_is_written_whole_or_not_at_all(tmp_path, kind):
    path = tmp_path / f"pose.{kind}"
    path.write_text("old")
    write_pose(path, sample())
    whole = path.read_bytes()
    assert whole != b"old"
    assert list(tmp_path.iterdir()) == [path]
    (tmp_path / f"folder.{kind}").mkdir()
    for bad in (tmp_path / "none" / f"pose.{kind}", tmp_path / f"folder.{kind}", path / f"pose.{kind}"):
        with pytest.raises(
            sk.DatasetError, match="output: expected a path that can be written, got"
        ) as caught:
            write_pose(bad, sample())
        assert "\n" not in str(caught.value)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [f"folder.{kind}", f"pose.{kind}"]
    assert path.read_bytes() == whole

"""Pose files as npz, JSON and CSV, and what all formats share."""

from __future__ import annotations

import csv
import json
import os
import zipfile
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import skelsplat as sk
from pose_sample import JOINTS, MISSING, M, N, T, assert_equal, sample
from skelsplat import synthetic
from skelsplat._atomic import atomic_write, remove_left
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
from skelsplat.io.poses import POSE_FORMATS, READ
from skelsplat.io.poses._pose_data import ARRAYS, PoseParts

WRONG = {
    "unit": "inch",
    "pose": np.zeros((T, N, 2)),
    "processing": ("a\0b",),
    "uncertainty": np.zeros((T, N)),
    "frame_rate": 0.0,
}


@pytest.mark.parametrize("name", WRONG)
def test_parts_that_do_not_fit(name):
    with pytest.raises(sk.InvalidInputError, match=name):
        replace(sample(), **{name: WRONG[name]})


@pytest.mark.parametrize("status", ["ok", "inferred", "filled"])
def test_a_joint_that_is_determined_has_a_position(tmp_path, status):
    data = sample()
    pose, statuses = data.pose.copy(), data.joint_status.copy()
    statuses[2, 0] = status
    write_npz(tmp_path / "a.npz", replace(data, joint_status=statuses))
    pose[2, 0, 1] = np.nan
    with pytest.raises(sk.InvalidInputError, match=r"^joint_status: .* frame 13, joint nose"):
        replace(data, pose=pose, joint_status=statuses)
    with np.load(tmp_path / "a.npz") as arrays:
        np.savez(tmp_path / "c.npz", **{**arrays, "pose": pose})
    with pytest.raises(sk.DatasetError, match=r"c\.npz: joint_status: .* frame 13, joint nose"):
        read_npz(tmp_path / "c.npz")
    for allowed in ("weak", "unobserved"):
        statuses[2, 0] = allowed
        replace(data, pose=pose, joint_status=statuses)


# npz


def test_npz_has_every_field_under_its_name(tmp_path):
    write_npz(tmp_path / "pose.npz", sample())
    assert_equal(read_npz(tmp_path / "pose.npz"), sample())
    with np.load(tmp_path / "pose.npz", allow_pickle=False) as archive:
        assert set(archive) == {entry.name for entry in fields(PoseData)} | {"version", "error_bar"}
        beyond = archive["error_bar"] - archive["uncertainty"]
        expected = archive["joint_bias"][..., None, None] ** 2 * np.eye(3)
        np.testing.assert_allclose(beyond[0], expected[0], rtol=1e-12)
        assert archive["view_weights"].shape == (T, M, N)


def test_npz_of_other_programs_needs_only_poses_with_names_and_a_unit(tmp_path):
    pose, frames = sample().pose, sample().frames
    np.savez(tmp_path / "own.npz", pose=pose, joint_names=np.array(JOINTS), frames=frames, unit=np.array("m"))
    assert_equal(read_npz(tmp_path / "own.npz"), PoseData(pose, JOINTS, frames, "m"))


def test_an_npz_cut_in_half(tmp_path):
    path = tmp_path / "pose.npz"
    write_npz(path, sample())
    whole = path.read_bytes()
    for size in (0, 200, len(whole) - 1):
        path.write_bytes(whole[:size])
        with pytest.raises(sk.DatasetError, match=r"pose\.npz: file"):
            read_npz(path)


# json


def test_json_has_a_line_per_frame_and_null_for_a_missing_joint(tmp_path):
    write_json(tmp_path / "pose.json", sample())
    assert_equal(read_json(tmp_path / "pose.json"), sample())
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


def without(key):
    return lambda document: {name: value for name, value in document.items() if name != key}


MALFORMED_JSON = {
    "another format": (lambda d: {**d, "format": "coco"}, "format"),
    "no names": (without("joint_names"), "joint_names"),
    "inches": (lambda d: {**d, "unit": "in"}, "unit"),
    "no frames": (without("frames"), "frames"),
    "a joint too few": (with_frame(1, pose=[None]), r"frames\[1\].pose"),
    "text": (with_frame(2, pose=[None, [1, 2, "x"], None]), r"frames\[2\].pose\[1\]\[2\]"),
    "400 digits": (with_frame(0, noise=10**400), "noise"),
    "a count of 20 digits": (with_frame(0, n_iter=10**20), r"frames\[0\].n_iter"),
}


@pytest.mark.parametrize("case", MALFORMED_JSON)
def test_a_malformed_json(tmp_path, case):
    change, field = MALFORMED_JSON[case]
    path = tmp_path / "pose.json"
    write_json(path, sample())
    path.write_text(json.dumps(change(json.loads(path.read_text(encoding="utf-8")))))
    with pytest.raises(sk.DatasetError, match=rf"pose\.json: {field}"):
        read_json(path)


# csv


def test_csv_and_back(tmp_path):
    data = replace(sample(), joint_names=("nose", 'head top, "upper"', "=tail"))
    write_csv(tmp_path / "pose.csv", data)
    back = read_csv(tmp_path / "pose.csv")
    diagonal = data.uncertainty * np.eye(3)
    np.testing.assert_allclose(back.uncertainty, diagonal, rtol=1e-15)  # a root and a square
    for name in ("pose", "joint_names", "frames", "unit", "joint_status"):
        np.testing.assert_array_equal(getattr(back, name), getattr(data, name), err_msg=name)


def test_csv_has_standard_deviations_per_axis_and_counts_rejected_views(tmp_path):
    weights = sample().view_weights.copy()
    weights[3, 0, 2] = 0.1
    write_csv(tmp_path / "pose.csv", replace(sample(), view_weights=weights))
    with (tmp_path / "pose.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["frame"], row["joint"]) for row in rows] == [
        (str(frame), joint) for frame in (10, 11, 13, 14) for joint in JOINTS
    ]
    assert [float(rows[0][f"scatter_{axis}"]) for axis in "xyz"] == [10.0, 15.0, 20.0]
    bars = [float(rows[0][f"error_bar_{axis}"]) for axis in "xyz"]
    assert bars == pytest.approx([np.hypot(15.0, own) for own in (10.0, 15.0, 20.0)])
    assert [row["n_rejected"] for row in rows] == ["0"] * 11 + ["1"]
    assert [rows[k]["n_views"] for k in (0, 1, 4)] == ["1", "2", "0"]


@pytest.mark.parametrize("rate", [25.0, 29.97, 0.2, 30000 / 1001])
def test_csv_has_times_and_the_frame_rate_is_read_from_them(tmp_path, rate):
    path = tmp_path / "pose.csv"
    write_csv(path, replace(sample(), frame_rate=rate))
    assert read_csv(path).frame_rate == rate
    lines = path.read_text().splitlines()
    assert lines[0].startswith("frame,time,joint,x,")
    assert lines[1].startswith(f"10,0.0,{JOINTS[0]},")
    assert lines[-1].startswith(f"14,{4 / rate!r},{JOINTS[-1]},")
    path.write_text("\n".join([lines[0], *lines[1 + N :]]))  # cut: without the first frame
    assert read_csv(path).frame_rate == pytest.approx(rate, rel=1e-13)


def test_times_that_a_spreadsheet_rounded_have_the_frame_rate(tmp_path):
    rows = [f"{t},{t / 29.97:.15g},a,0,0,0,m" for t in range(7, 3000)]
    (tmp_path / "own.csv").write_text("\n".join(["frame,time,joint,x,y,z,unit", *rows]))
    assert read_csv(tmp_path / "own.csv").frame_rate == 29.97


def test_csv_of_other_programs_needs_little(tmp_path):
    (tmp_path / "own.csv").write_text(
        "joint,frame,unit,x,y,z\na,3,m,1,2,3\nb,3,m,,,\na,5,m,4,5,6\nb,5,m,7,8,9\n"
    )
    pose = np.array([[[1.0, 2, 3], [np.nan] * 3], [[4, 5, 6], [7, 8, 9]]])
    assert_equal(read_csv(tmp_path / "own.csv"), PoseData(pose, ("a", "b"), np.array([3, 5]), "m"))


MALFORMED_CSV = {
    "empty": (lambda _: [], "line 1"),
    "text": (lambda lines: [*lines[:2], lines[2].replace("10,", "ten,", 1), *lines[3:]], "line 3, frame"),
    "a field too few": (lambda lines: [*lines[:3], lines[3].rpartition(",")[0], *lines[4:]], "line 4"),
    "a joint too few": (lambda lines: [*lines[:5], *lines[6:]], "line 6, joint"),
    "the last joint too few": (lambda lines: lines[:-1], "line 12, joint"),
    "a joint twice": (lambda lines: [*lines[:4], lines[1], *lines[4:]], "line 5, joint"),
    "frames that descend": (
        lambda lines: [lines[0], *lines[1 + N : 1 + 2 * N], *lines[1 : 1 + N]],
        "line 5, joint",
    ),
    "two units": (lambda lines: [*lines[:4], lines[4].replace(",mm,", ",m,"), *lines[5:]], "line 5, unit"),
    "a quote": (lambda lines: [*lines[:2], '"' + lines[2]], "line 3"),
}


@pytest.mark.parametrize("case", MALFORMED_CSV)
def test_a_malformed_csv(tmp_path, case):
    change, place = MALFORMED_CSV[case]
    path = tmp_path / "pose.csv"
    write_csv(path, sample())
    path.write_text("\n".join(change(path.read_text().splitlines())))
    with pytest.raises(sk.DatasetError, match=rf"pose\.csv: {place}: expected"):
        read_csv(path)


# every format


@pytest.fixture(params=[kind for kind, entry in POSE_FORMATS.items() if entry.read is not None])
def kind(request):
    for package in POSE_FORMATS[request.param].packages:
        pytest.importorskip(package, reason=f"{package} is not installed")
    return request.param


@pytest.mark.parametrize("kind", READ, indirect=True)
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


def test_aniposes_csv_has_its_columns(tmp_path):
    pandas = pytest.importorskip("pandas", reason="it reads the file as Anipose does")
    data = sample()
    write_pose(tmp_path / "walk.anipose.csv", data)
    table = pandas.read_csv(tmp_path / "walk.anipose.csv")
    parts = ("x", "y", "z", "error", "ncams", "score")
    own = [f"{joint}_{part}" for joint in JOINTS for part in parts]
    world = [*(f"M_{i}{j}" for i in range(3) for j in range(3)), *(f"center_{i}" for i in range(3))]
    assert table.columns.tolist() == [*own, *world, "fnum"]
    found = table[own].to_numpy().reshape(4, 3, 6)
    np.testing.assert_allclose(found[..., :3], data.pose, rtol=1e-15)  # old readers round
    np.testing.assert_array_equal(found[0, :, 4], [1, 2, 2])
    np.testing.assert_allclose(found[0, 1, 5], data.view_weights[0, :, 1].mean())
    np.testing.assert_array_equal(table["fnum"], data.frames)
    np.testing.assert_array_equal(table[world].to_numpy()[2], [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0])
    with pytest.raises(sk.InvalidInputError, match="only written"):
        read_pose(tmp_path / "walk.anipose.csv")


def test_freemocaps_array_is_in_millimetres(tmp_path):
    write_pose(tmp_path / "walk.npy", sample().in_unit("m"))
    np.testing.assert_allclose(np.load(tmp_path / "walk.npy"), sample().pose, rtol=1e-12)


def test_a_file_is_written_whole_or_not_at_all(tmp_path, kind):
    path = tmp_path / f"pose.{kind}"
    path.write_text("old")
    write_pose(path, sample())
    whole = path.read_bytes()
    assert whole != b"old"
    assert list(tmp_path.iterdir()) == [path]
    (tmp_path / f"folder.{kind}").mkdir()
    for bad in (tmp_path / "none" / f"pose.{kind}", tmp_path / f"folder.{kind}", path / f"pose.{kind}"):
        with pytest.raises(sk.DatasetError, match="output"):
            write_pose(bad, sample())
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [f"folder.{kind}", f"pose.{kind}"]
    assert path.read_bytes() == whole


def test_a_failed_write_leaves_the_older_file(tmp_path):
    path = tmp_path / "pose"
    path.write_text("old")

    def write():
        with atomic_write(path) as stream:
            stream.write(b"new")
            raise RuntimeError("halfway")

    with pytest.raises(RuntimeError, match="halfway"):
        write()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_pipe_is_not_replaced(tmp_path):
    os.mkfifo(path := tmp_path / "pose.npz")
    with pytest.raises(sk.DatasetError, match="a device or a pipe"), atomic_write(path):
        pass
    assert path.is_fifo()


def test_what_killed_processes_left_is_removed(tmp_path):
    kept = [".pose.npz", ".notes.0123456789ab.tmp", "pose.0123456789ab.tmp", ".pose.0123456789.tmp"]
    for name in [".pose.0123456789ab.tmp", ".report.a1b2c3d4e5f6.nc", *kept]:
        (tmp_path / name).touch()
    remove_left(tmp_path, ["pose.npz", "report.json"])
    assert {path.name for path in tmp_path.iterdir()} == set(kept)


@pytest.fixture(scope="module")
def poses() -> PoseData:
    rig, layout = synthetic.human36m_like(), sk.layouts.get("h36m17")
    walk = synthetic.motion("walk", 23, seed=0)
    seen = synthetic.simulate_detections(walk, rig, noise=synthetic.DetectionNoise.occluded(3), seed=0)
    found = sk.refine_sequence(seen, rig, fps=50, layout=layout)
    return PoseData.from_refinement(
        found,
        joint_names=layout.joints,
        frames=np.delete(np.arange(3, 27), 7),
        camera_names=rig.names,
        unit="mm",
        frame_rate=50.0,
    )


def in_parts(poses: PoseData, folder: Path, size: int) -> PoseParts:
    folder.mkdir()
    parts = PoseParts(folder, poses.frames, size)
    for first in range(0, len(poses.frames), 9):
        parts.append(part_of(poses, slice(first, first + 9)))
    return parts


def part_of(poses: PoseData, here: slice) -> PoseData:
    return replace(poses, frames=poses.frames[here], **{name: getattr(poses, name)[here] for name in ARRAYS})


@pytest.mark.parametrize("kind", ["csv", "trc", "json"])
@pytest.mark.parametrize("size", [4, 23])
def test_text_files_are_the_same(poses: PoseData, tmp_path: Path, kind: str, size: int) -> None:
    (tmp_path / "whole").mkdir()
    write_pose(tmp_path / "whole" / f"pose.{kind}", poses)
    write_pose(tmp_path / f"pose.{kind}", in_parts(poses, tmp_path / "parts", size))
    assert (tmp_path / f"pose.{kind}").read_bytes() == (tmp_path / "whole" / f"pose.{kind}").read_bytes()


def test_npz_files_hold_the_same(poses: PoseData, tmp_path: Path) -> None:
    write_pose(tmp_path / "whole.npz", poses)
    write_pose(tmp_path / "parts.npz", in_parts(poses, tmp_path / "parts", 5))
    with zipfile.ZipFile(tmp_path / "whole.npz") as whole, zipfile.ZipFile(tmp_path / "parts.npz") as parts:
        assert parts.namelist() == whole.namelist()
        assert [parts.read(name) == whole.read(name) for name in whole.namelist()] == [True] * 26


def test_netcdf_files_hold_the_same(poses: PoseData, tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    write_pose(tmp_path / "whole.nc", poses)
    write_pose(tmp_path / "parts.nc", in_parts(poses, tmp_path / "parts", 5))
    files = (tmp_path / f"{name}.nc" for name in ("whole", "parts"))
    whole, parts = (xarray.load_dataset(file, engine="h5netcdf") for file in files)
    assert parts.identical(whole)

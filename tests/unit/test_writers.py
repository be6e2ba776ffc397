"""Pose files: what is written can be read, and a failed write leaves nothing behind."""

from __future__ import annotations

import csv
from dataclasses import fields, replace

import numpy as np
import pytest

import skelsplat as sk
from pose_sample import assert_equal
from skelsplat._atomic import atomic_write, remove_left
from skelsplat.findings import FindingWarning
from skelsplat.io import PoseData, read_csv, read_npz, read_trc, write_csv, write_npz, write_trc

T, N, M = 3, 2, 2


@pytest.fixture
def data():
    rng = np.random.default_rng(3)
    pose = rng.normal(scale=1000.0, size=(T, N, 3))
    pose[1, 1] = np.nan
    errors = rng.uniform(1.0, 9.0, size=(T, M, N))
    errors[0, 1, 0] = np.nan
    errors[1, :, 1] = np.nan
    status = np.full((T, N), "ok", dtype="<U10")
    status[1, 1] = "unobserved"
    weights = np.where(np.isfinite(errors), 0.9, np.nan)
    weights[2, 0, 1] = 0.1
    swapped = np.zeros((T, M, N), dtype=bool)
    swapped[2, 1, 0] = True
    uncertainty = np.broadcast_to(np.diag([100.0, 225.0, 400.0]), (T, N, 3, 3)).copy()
    uncertainty[1, 1] = np.nan
    return PoseData(
        pose=pose,
        joint_names=("nose", "head top, upper"),
        frames=np.array([10, 11, 13]),
        unit="mm",
        camera_names=("cam_01", "cam_02"),
        init_pose=pose + 1.0,
        covariance=np.broadcast_to(400.0 * np.eye(3), (T, N, 3, 3)).copy(),
        uncertainty=uncertainty,
        joint_bias=np.broadcast_to([24.0, 18.0], (T, N)),
        view_weights=weights,
        swapped=swapped,
        noise=np.array([6.0, 7.0, np.nan]),
        reprojection_error=errors,
        joint_status=status,
        loss=np.array([0.1, 0.2, np.nan]),
        n_iter=np.array([125, 40, 0]),
        stop_reason=np.array(["max_steps", "converged", "no_observations"]),
        frame_rate=59.94,
        processing=("Gaps of at most 5 frames filled by straight lines.",),
    )


# npz


def test_npz_returns_every_field(data, tmp_path):
    write_npz(tmp_path / "pose.npz", data)
    assert_equal(read_npz(tmp_path / "pose.npz"), data)


def test_npz_has_error_bars_and_weights_under_their_names(data, tmp_path):
    write_npz(tmp_path / "pose.npz", data)
    with np.load(tmp_path / "pose.npz", allow_pickle=False) as archive:
        assert set(archive) == {entry.name for entry in fields(PoseData)} | {"version", "error_bar"}
        assert archive["uncertainty"].shape == archive["error_bar"].shape == (T, N, 3, 3)
        beyond = archive["error_bar"] - archive["uncertainty"]
        expected = archive["joint_bias"][..., None, None] ** 2 * np.eye(3)
        np.testing.assert_allclose(beyond[0], expected[0], rtol=1e-12)
        assert archive["view_weights"].shape == (T, M, N)
        assert archive["swapped"].dtype == bool
        assert archive["noise"].shape == (T,)


def test_npz_of_other_programs_needs_only_poses_with_names_and_a_unit(data, tmp_path):
    bare = PoseData(data.pose, data.joint_names, data.frames, "m")
    np.savez(
        tmp_path / "own.npz",
        pose=data.pose,
        joint_names=np.array(data.joint_names),
        frames=data.frames,
        unit=np.array("m"),
    )
    assert_equal(read_npz(tmp_path / "own.npz"), bare)


def test_an_npz_cut_in_half(data, tmp_path):
    path = tmp_path / "pose.npz"
    write_npz(path, data)
    whole = path.read_bytes()
    for size in (0, 2, 200, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:size])
        with pytest.raises(sk.DatasetError, match=r"pose\.npz: file"):
            read_npz(path)


# csv


def rows_of(path):
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_csv_has_a_row_for_every_frame_and_joint(data, tmp_path):
    write_csv(tmp_path / "pose.csv", data)
    rows = rows_of(tmp_path / "pose.csv")
    assert [(row["frame"], row["joint"]) for row in rows[:3]] == [
        ("10", "nose"),
        ("10", "head top, upper"),
        ("11", "nose"),
    ]
    assert len(rows) == T * N
    assert [float(rows[5][axis]) for axis in "xyz"] == data.pose[2, 1].tolist()
    assert {row["unit"] for row in rows} == {"mm"}


def test_csv_has_standard_deviations_per_axis_and_counts_rejected_views(data, tmp_path):
    write_csv(tmp_path / "pose.csv", data)
    rows = rows_of(tmp_path / "pose.csv")
    assert [float(rows[0][f"scatter_{axis}"]) for axis in "xyz"] == [10.0, 15.0, 20.0]
    bars = [float(rows[0][f"error_bar_{axis}"]) for axis in "xyz"]
    assert bars == pytest.approx([26.0, np.hypot(24.0, 15.0), np.hypot(24.0, 20.0)])
    assert [row["n_rejected"] for row in rows] == ["0", "0", "0", "0", "0", "1"]


# trc


def test_trc_lines(tmp_path):
    small = PoseData(
        np.array([[[1.0, 2.0, 3.0], [np.nan] * 3], [[-4.0, 5.5, 6.25], [7.0, 8.0, 9.0]]]),
        ("nose", "head"),
        np.array([7, 8]),
        "mm",
    )
    write_trc(tmp_path / "pose.trc", small, frame_rate=60.0, unit="mm")
    assert (tmp_path / "pose.trc").read_text().split("\n") == [
        "PathFileType\t4\t(X/Y/Z)\tpose.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
        "60\t60\t2\t2\tmm\t60\t1\t2",
        "Frame#\tTime\tnose\t\t\thead\t\t\t",
        "\t\tX1\tY1\tZ1\tX2\tY2\tZ2\t",
        "",
        "1\t0.000000\t1.000\t2.000\t3.000\t\t\t\t",
        "2\t0.016667\t-4.000\t5.500\t6.250\t7.000\t8.000\t9.000\t",
        "",
    ]


@pytest.mark.parametrize(("unit", "factor", "half_digit"), [("mm", 1.0, 5e-4), ("m", 1e-3, 5e-7)])
def test_trc_and_back(data, tmp_path, unit, factor, half_digit):
    write_trc(tmp_path / "pose.trc", data, frame_rate=50.0, unit=unit)
    back = read_trc(tmp_path / "pose.trc")
    assert back.unit == unit
    assert back.joint_names == data.joint_names
    # half a unit of the last digit written, and one ulp of slack
    np.testing.assert_allclose(back.pose, data.pose * factor, rtol=1e-15, atol=half_digit * 1.000001)


@pytest.mark.parametrize("name", ["a\rb", "a\nb", "a\r\nb", 'a"\rb', "=a,b"])
def test_a_csv_keeps_every_name_in_one_field(data, tmp_path, name):
    path = tmp_path / "pose.csv"
    write_csv(path, replace(data, joint_names=("nose", name)))
    ends = name.replace("\r\n", "\n").replace("\r", "\n")  # as text is read
    assert read_csv(path).joint_names == ("nose", ends)
    with path.open(newline="", encoding="utf-8") as stream:
        assert {row["joint"] for row in csv.DictReader(stream)} == {"nose", name}


def test_trc_keeps_gaps_in_time(data, tmp_path):
    write_trc(tmp_path / "pose.trc", data, frame_rate=50.0)
    rows = [line.split("\t")[:2] for line in (tmp_path / "pose.trc").read_text().splitlines()[6:]]
    assert rows == [["1", "0.000000"], ["2", "0.020000"], ["4", "0.060000"]]


def test_trc_y_up_puts_the_worlds_z_second(data, tmp_path):
    write_trc(tmp_path / "pose.trc", data, frame_rate=50.0, unit="mm", y_up=True)
    x, y, z = read_trc(tmp_path / "pose.trc").pose[0, 0]
    # half a unit of the third decimal
    np.testing.assert_allclose([z, x, y], data.pose[0, 0], atol=5.0001e-4)


@pytest.mark.parametrize("change", ["no blank line", "nan", "no tab at the end", "windows"])
def test_trc_of_other_writers(data, tmp_path, change):
    path = tmp_path / "pose.trc"
    write_trc(path, data, frame_rate=50.0)
    expected = read_trc(path)
    lines = path.read_text().split("\n")
    if change == "no blank line":
        del lines[5]
    elif change == "nan":
        lines[7] = lines[7].replace("\t\t\t\t", "\tnan\tnan\tnan\t")
    elif change == "no tab at the end":
        lines[3:9] = [line.removesuffix("\t") for line in lines[3:9]]
    path.write_bytes(("\r\n" if change == "windows" else "\n").join(lines).encode())
    assert_equal(read_trc(path), expected)


@pytest.mark.parametrize("stated", ["2", "4.0", "6", "0"])
def test_a_trc_that_miscounts_its_frames_is_read_by_its_rows(data, tmp_path, stated):
    path = tmp_path / "pose.trc"
    write_trc(path, data, frame_rate=50.0)
    expected = read_trc(path)
    path.write_text(path.read_text().replace("\t3\t2\tm", f"\t{stated}\t2\tm"))
    with pytest.warns(FindingWarning, match=rf"\(line 3\) states {stated[0]} frames") as told:
        found = read_trc(path)
    assert_equal(found, expected)
    assert [one.message.finding.severity for one in told] == ["warning"]


@pytest.mark.parametrize("stated", ["0.00", "nan"])
@pytest.mark.parametrize(
    ("change", "rate"),
    [
        (lambda line: line, 50.0),
        (lambda line: line.replace("\t0.0", "\tx0.0", 1), None),
        (lambda line: line.replace("\t0.02", "\t0.00", 1), None),
    ],
    ids=["times", "text", "no time passes"],
)
def test_a_trc_without_a_frame_rate_has_that_of_its_times(data, tmp_path, change, rate, stated):
    path = tmp_path / "pose.trc"
    write_trc(path, data, frame_rate=50.0)
    lines = path.read_text().replace("\n50\t50\t", f"\n{stated}\t50\t").split("\n")
    path.write_text("\n".join([*lines[:6], *map(change, lines[6:])]))
    with pytest.warns(FindingWarning, match=rf"\(line 3\) states {float(stated):g} frames per sec") as told:
        assert read_trc(path).frame_rate == rate
    assert [one.message.finding.severity for one in told] == ["warning"]


def with_times(data, path, times, stated):
    """Write a TRC of a row for each of the times, whose header states a rate."""
    poses = np.repeat(data.pose[:1], len(times), axis=0)
    write_trc(path, PoseData(poses, data.joint_names, np.arange(len(times)), data.unit), frame_rate=50.0)
    lines = path.read_text().replace("\n50\t50\t", f"\n{stated}\t{stated}\t").split("\n")
    rows = [line.split("\t") for line in lines[6:-1]]
    rows = ["\t".join([row[0], time, *row[2:]]) for row, time in zip(rows, times, strict=True)]
    path.write_text("\n".join([*lines[:6], *rows, ""]))
    return path


@pytest.mark.parametrize(
    ("stated", "rate", "decimals"),
    [("30", 60.0, 6), ("30.00", 60.0, 3), ("60", 59.94, 6), ("120", 60.0, 2), ("100", 30.0, 17)],
)
def test_times_that_contradict_the_frame_rate_of_a_trc_decide(data, tmp_path, stated, rate, decimals):
    times = [f"{t / rate:.{decimals}f}".rstrip("0") for t in range(600)]
    path = with_times(data, tmp_path / "pose.trc", times, stated)
    text = rf"\(line 3\) states {float(stated):g} frames per second; it is "
    with pytest.warns(FindingWarning, match=text) as told:
        found = read_trc(path).frame_rate
    # the last time is rounded by up to half a digit
    assert found == pytest.approx(rate, abs=rate * 0.5 * 10.0**-decimals / (599 / rate) + 1e-3)
    assert [one.message.finding.severity for one in told] == ["warning"]


MALFORMED_TRC = {
    "not a trc": (
        lambda _: ["hello"],
        "header: expected five lines that start with PathFileType, got 1 lines",
    ),
    "inches": (
        lambda lines: [line.replace("\tm\t", "\tinch\t") for line in lines],
        "line 3 Units: expected m, cm or mm in the fifth field, got 'inch'$",
    ),
    "no frame rate": (
        lambda lines: [line.replace("50\t50\t", "x\t50\t") for line in lines],
        "line 3 DataRate: expected frames per second, a positive number, got 'x'",
    ),
    "a row cut short": (lambda lines: [*lines[:6], lines[6][:30]], "line 7"),
    "text": (
        lambda lines: [*lines[:6], lines[6].replace("1\t0.0", "one\t0.0")],
        "line 7: expected numbers, got 'one'",
    ),
}


@pytest.mark.parametrize("case", MALFORMED_TRC)
def test_a_malformed_trc(data, tmp_path, case):
    change, message = MALFORMED_TRC[case]
    path = tmp_path / "pose.trc"
    write_trc(path, data, frame_rate=50.0)
    path.write_text("\n".join(change(path.read_text().split("\n"))))
    with pytest.raises(sk.DatasetError, match=rf"pose\.trc: {message}"):
        read_trc(path)


# what all writers share


WRITERS = {
    "npz": write_npz,
    "csv": write_csv,
    "trc": lambda path, data: write_trc(path, data, frame_rate=60.0),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_an_older_file_is_replaced(data, tmp_path, kind):
    path = tmp_path / "pose"
    path.write_text("old")
    WRITERS[kind](path, data)
    assert path.read_bytes() != b"old"
    assert list(tmp_path.iterdir()) == [path]


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


def test_what_killed_processes_left_is_removed(tmp_path):
    kept = [".pose.npz", ".notes.0123456789ab.tmp", "pose.0123456789ab.tmp", ".pose.0123456789.tmp"]
    for name in [".pose.0123456789ab.tmp", ".report.a1b2c3d4e5f6.nc", *kept]:
        (tmp_path / name).touch()
    remove_left(tmp_path, ["pose.npz", "report.json"])
    assert {path.name for path in tmp_path.iterdir()} == set(kept)


WRONG = {
    "unit": ("inch", "unit: expected"),
    "pose": (np.zeros((T, N, 2)), "pose"),
    "processing": (("a\0b",), "processing"),
    "uncertainty": (np.zeros((T, N)), "uncertainty"),
    "frame_rate": (0.0, "frame_rate: expected a positive number, got 0.0"),
}


@pytest.mark.parametrize("name", WRONG)
def test_parts_that_do_not_fit(data, name):
    value, message = WRONG[name]
    with pytest.raises(sk.InvalidInputError, match=message):
        replace(data, **{name: value})

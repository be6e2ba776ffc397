"""C3D files: what two independent readers find in them, and what is no such file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import skelsplat as sk
from pose_sample import FILLED, JOINTS, MISSING, T, sample
from skelsplat.io import PoseData, read_c3d, write_c3d

ezc3d = pytest.importorskip("ezc3d", reason="ezc3d is not installed: pip install 'skelsplat[formats]'")

# √((100 + 225 + 400) / 3 + b²) mm for the biases b of 15, 0 and 20 mm: 21.6, 15.5 and 25.3, in whole mm
RESIDUAL = np.array([[22.0], [16.0], [25.0]])
ROWS = [0, 1, 3, 4]  # frames 10, 11, 13, 14


def expected_residuals():
    residuals = np.repeat(RESIDUAL, T + 1, axis=1)
    residuals[:, 2] = -1.0
    residuals[FILLED[1], ROWS[FILLED[0]]] = 0.0
    for t, j in MISSING:
        residuals[j, ROWS[t]] = -1.0
    return residuals


def test_ezc3d_reads_points_residuals_and_parameters(tmp_path):
    data = sample()
    write_c3d(tmp_path / "pose.c3d", data)
    file = ezc3d.c3d(str(tmp_path / "pose.c3d"))
    point = file["parameters"]["POINT"]
    assert point["UNITS"]["value"] == ["mm"]
    assert point["LABELS"]["value"] == list(JOINTS)
    assert point["RATE"]["value"][0] == np.float32(59.94)
    assert file["parameters"]["SKELSPLAT"]["PROCESSING"]["value"] == list(data.processing)
    np.testing.assert_array_equal(file["data"]["meta_points"]["residuals"][0], expected_residuals())
    points = file["data"]["points"][:3].transpose(2, 1, 0)
    np.testing.assert_array_equal(points[ROWS], data.pose.astype(np.float32))
    assert np.isnan(points[2]).all()


# this reader warns that there are no force plates
@pytest.mark.filterwarnings("ignore:No analog data found in file.:UserWarning")
def test_another_reader_finds_the_same(tmp_path):
    c3d = pytest.importorskip("c3d", reason="c3d is not installed")
    data = sample()
    write_c3d(tmp_path / "pose.c3d", data)
    with (tmp_path / "pose.c3d").open("rb") as stream:
        reader = c3d.Reader(stream)
        frames = [(number, points) for number, points, _ in reader.read_frames()]
        assert tuple(label.strip() for label in reader.point_labels) == JOINTS
        assert reader.get("POINT:UNITS").string_value == "mm"
        assert reader.point_rate == np.float32(59.94)
    assert [number for number, _ in frames] == [10, 11, 12, 13, 14]
    points = np.array([points for _, points in frames])
    residuals = expected_residuals()
    # of a missing point this reader gives −1 in place of the residual's byte
    np.testing.assert_array_equal(points[..., 3].T == -1.0, residuals == -1.0)
    np.testing.assert_array_equal(points[..., 4].T[residuals >= 0.0], residuals[residuals >= 0.0])
    there = np.isfinite(data.pose)
    np.testing.assert_array_equal(points[ROWS][..., :3][there], data.pose.astype(np.float32)[there])


@pytest.mark.parametrize("name", ["x" * 128, "é" * 64, " "])
def test_names_that_the_format_cannot_hold(tmp_path, name):
    with pytest.raises(sk.InvalidInputError, match="joint_names"):
        write_c3d(tmp_path / "a.c3d", replace(sample(), joint_names=("nose", name, "tail")))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("first", [0, -5, 70_000])
def test_frame_numbers_that_the_format_cannot_hold_come_back(tmp_path, first):
    data = replace(sample(), frames=np.arange(first, first + T))
    write_c3d(tmp_path / "pose.c3d", data)
    assert ezc3d.c3d(str(tmp_path / "pose.c3d"))["header"]["points"]["first_frame"] == 0  # counted from 0
    assert read_c3d(tmp_path / "pose.c3d").frames.tolist() == data.frames.tolist()


def test_metres_become_millimetres_and_an_error_bar_has_seven_bits(tmp_path):
    pose = np.array([[[1.0, 2.0, 3.0], [0.0, 0.0, 0.5]]])
    wide = np.array([[4.0 * np.eye(3), 1e-8 * np.eye(3)]])  # 2 m and 0.1 mm
    write_c3d(
        tmp_path / "pose.c3d", PoseData(pose, ("a", "b"), np.array([1]), "m", uncertainty=wide), frame_rate=50
    )
    file = ezc3d.c3d(str(tmp_path / "pose.c3d"))
    assert file["data"]["points"][:3, 0, 0].tolist() == [1000.0, 2000.0, 3000.0]
    assert file["data"]["meta_points"]["residuals"][0, :, 0].tolist() == [127.0, 1.0]


def test_y_up_turns_the_axes_and_says_so(tmp_path):
    data = sample()
    write_c3d(tmp_path / "pose.c3d", data, y_up=True)
    point = ezc3d.c3d(str(tmp_path / "pose.c3d"))["parameters"]["POINT"]
    assert (point["X_SCREEN"]["value"], point["Y_SCREEN"]["value"]) == (["+X"], ["+Y"])
    y, z, x = read_c3d(tmp_path / "pose.c3d").pose[0, 0]
    np.testing.assert_array_equal([x, y, z], data.pose[0, 0].astype(np.float32))


def with_parameters(**parameters):
    """Write two frames of three points with ezc3d, some parameters as given."""

    def write(path):
        file = ezc3d.c3d()
        known = {"UNITS": ["mm"], "RATE": [50.0], "LABELS": ["a", "b", "c"]}
        for name, value in {**known, **parameters}.items():
            file["parameters"]["POINT"][name]["value"] = value
        file["data"]["points"] = np.ones((4, 3, 2))
        file["data"]["meta_points"]["residuals"] = np.ones((1, 3, 2))
        file["data"]["meta_points"]["camera_masks"] = np.zeros((7, 3, 2), dtype=bool)
        file.write(str(path))

    return write


def cut(size):
    return lambda path: path.write_bytes(path.read_bytes()[:size])


def without_rate(path):
    """Put 0 in the place of the frame rate; ezc3d itself writes no such file."""
    with_parameters()(path)
    path.write_bytes(path.read_bytes().replace(np.float32(50.0).tobytes(), bytes(4)))


MALFORMED = {
    "empty": (cut(0), "file"),
    "cut in the parameters": (cut(1100), "file"),
    "cut in the points": (cut(-300), "frames"),
    "another processor": (
        lambda path: path.write_bytes(path.read_bytes()[:515] + b"\x09" + path.read_bytes()[516:]),
        "file",
    ),
    "inches": (with_parameters(UNITS=["in"]), "POINT:UNITS"),
    "no rate": (without_rate, "POINT:RATE"),
    "a point without a label": (with_parameters(LABELS=["a", "b", ""]), "POINT:LABELS"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_a_malformed_c3d(tmp_path, case):
    change, field = MALFORMED[case]
    path = tmp_path / "pose.c3d"
    write_c3d(path, sample())
    change(path)
    with pytest.raises(sk.DatasetError, match=rf"pose\.c3d: {field}: expected"):
        read_c3d(path)


def test_labels_of_older_programs_are_latin_1(tmp_path):
    with_parameters(LABELS=["Hueft", "b", "c"])(tmp_path / "old.c3d")
    content = (tmp_path / "old.c3d").read_bytes().replace(b"Hueft", "Hüfte".encode("latin-1"))
    (tmp_path / "old.c3d").write_bytes(content)
    assert read_c3d(tmp_path / "old.c3d").joint_names == ("Hüfte", "b", "c")

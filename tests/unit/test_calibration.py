"""Reading and writing calibrations: one valid file, and one thing broken in it at a time."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from skelsplat.cameras import matrix_from_vector
from skelsplat.io import read_calibration, write_calibration

CAMERA = """[{key}]
name = "{name}"
size = [1088.0, 1920.0]
matrix = [[1681.25, 0.0, 532.5], [0.0, 1681.0, 948.25], [0.0, 0.0, 1.0]]
distortions = [-0.05, 0.002, 1e-05, -2e-05]
rotation = [{rotation}, 0.0, 0.0]
translation = [{x}, 0.5, 3.0]
fisheye = false
"""
VALID = "\n".join(
    [
        CAMERA.format(key="cam_b", name="left", rotation=1.5, x=-2.0),
        CAMERA.format(key="cam_a", name="right", rotation=0.0, x=2.5),
        "[metadata]\nadjusted = false\nerror = 0.0\n",
    ]
)


@pytest.fixture
def write(tmp_path):
    def write(text):
        path = tmp_path / "Calib.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def test_every_number_of_a_camera_is_read(write):
    rig = read_calibration(write(VALID), unit="m")
    assert rig.unit == "m"
    left = rig["left"]
    np.testing.assert_array_equal(left.K, [[1681.25, 0, 532.5], [0, 1681.0, 948.25], [0, 0, 1]])
    np.testing.assert_array_equal(left.t, [-2.0, 0.5, 3.0])
    np.testing.assert_array_equal(left.distortion, [-0.05, 0.002, 1e-05, -2e-05])
    assert left.size == (1088, 1920)
    assert left.fisheye is False
    turn = [[1, 0, 0], [0, np.cos(1.5), -np.sin(1.5)], [0, np.sin(1.5), np.cos(1.5)]]
    # entries up to 1 from a handful of operations: a few ulp
    np.testing.assert_allclose(left.R, turn, atol=1e-15)


@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_every_opencv_count_of_coefficients_is_read(write, count):
    coefficients = [0.001 * (i + 1) for i in range(count)]
    text = VALID.replace("[-0.05, 0.002, 1e-05, -2e-05]", str(coefficients))
    np.testing.assert_array_equal(read_calibration(write(text), unit="m")[0].distortion, coefficients)


@pytest.mark.parametrize("padding", ["", ", 0.0"], ids=["four", "four and a zero"])
def test_fisheye_coefficients(write, padding):
    text = VALID.replace("fisheye = false", "fisheye = true").replace("-2e-05]", f"-2e-05{padding}]")
    camera = read_calibration(write(text), unit="m")[0]
    assert camera.fisheye is True
    np.testing.assert_array_equal(camera.distortion, [-0.05, 0.002, 1e-05, -2e-05])


def test_a_camera_without_distortions_has_none_and_is_warned_of(write):
    text = VALID.replace("distortions = [-0.05, 0.002, 1e-05, -2e-05]\n", "")
    with pytest.warns(
        UserWarning, match="no distortions for left, right: assumed to have no lens distortion"
    ):
        assert read_calibration(write(text), unit="m")[0].distortion is None


# One key of the second camera replaced (or the text as a whole), with what the message must say.
LAST = VALID.rindex("[cam_a]")


def _broken(old, new):
    assert old in VALID[LAST:]
    return VALID[:LAST] + VALID[LAST:].replace(old, new)


MATRIX = "matrix = [[1681.25, 0.0, 532.5], [0.0, 1681.0, 948.25], [0.0, 0.0, 1.0]]"
MALFORMED = {
    "bad TOML": (VALID[:200], "TOML"),
    "no matrix": (_broken(MATRIX + "\n", ""), r"cam_a\.matrix"),
    "matrix 2×3": (_broken(", [0.0, 0.0, 1.0]]", "]"), r"cam_a\.matrix"),
    "NaN": (_broken("1681.25", "nan"), r"cam_a\.matrix"),
    "negative focal length": (_broken("1681.25", "-1681.25"), "Calib.*: K of camera '.*'"),
    "three coefficients": (_broken(", -2e-05]", "]"), r"cam_a\.distortions"),
    "five fisheye coefficients": (
        _broken("-2e-05]", "-2e-05, 0.1]").replace("fisheye = false", "fisheye = true"),
        r"cam_a\.distortions",
    ),
    "half a pixel": (_broken("1088.0", "1088.5"), r"cam_a\.size"),
    "a name twice": (_broken('"right"', '"left"'), "name"),
    "not a calibration": ("hello, world", "content"),
    "UTF-16": ("[cam]".encode("utf-16"), "file"),
    "zeros": (bytes(20), "file"),
}


@pytest.mark.parametrize("case", MALFORMED)
def test_a_malformed_file_is_named_with_its_field(write, case):
    text, message = MALFORMED[case]
    path = write(text)
    with pytest.raises(sk.DatasetError, match=message) as caught:
        read_calibration(path, unit="m")
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_the_unit_must_be_given_and_the_likely_one_is_named(write):
    with pytest.raises(sk.InvalidInputError, match=r'unit: expected "mm", "cm" or "m" .*"m" is likely'):
        read_calibration(write(VALID))


def _scaled(path, rig, factor, focal=1.0):
    """Write a rig with all lengths times a factor, without its unit."""
    zoom = np.diag([focal, focal, 1.0])
    scaled = [sk.Camera(c.K @ zoom, c.R, c.t * factor, size=c.size, name=c.name) for c in rig]
    write_calibration(path, sk.CameraRig(scaled, unit="m"))
    path.write_text(path.read_text().replace('unit = "m"\n', ""))
    return path


@pytest.mark.parametrize(
    ("metres", "file_unit", "hint"),
    [
        (5.4, 1, 'so "m" is likely'),
        (5.4, 1000, 'so "mm" is likely'),
        (5.4, 100, r'is 540 in the file, that is 0\.54 m in "mm" or 5\.4 m in "cm"$'),
        (0.3, 1000, r'that is 0\.3 m in "mm" or 3 m in "cm"$'),
        (1.3, 1000, r'that is 1\.3 m in "mm" or 13 m in "cm"$'),
        (0.3, 1, 'so "m" is likely'),
        (0.13, 1000, r'that is 0\.13 m in "mm" or 1\.3 m in "cm"$'),
        (12.0, 1, r'that is 0\.12 m in "cm" or 12 m in "m"$'),
    ],
)
def test_the_unit_that_alone_gives_a_usual_distance_is_likely(write, metres, file_unit, hint):
    rig = read_calibration(write(VALID), unit="m")
    spread = np.linalg.norm(rig[0].centre - rig[1].centre)
    with pytest.raises(sk.InvalidInputError, match=hint):
        read_calibration(_scaled(write(""), rig, metres / spread * file_unit))


def test_millimetres_read_as_metres_are_warned_about(write):
    text = VALID.replace("[-2.0, 0.5, 3.0]", "[-2000, 500, 3000]").replace(
        "[2.5, 0.5, 3.0]", "[2500, 500, 3000]"
    )
    with pytest.warns(UserWarning, match=r'are \d{4} m apart; .*"mm" is likely'):
        read_calibration(write(text), unit="m")


def test_writing_and_reading_gives_the_same_rig(write, tmp_path):
    rig = read_calibration(write(VALID), unit="m")
    write_calibration(tmp_path / "copy.toml", rig)
    copy = read_calibration(tmp_path / "copy.toml", unit="m")
    assert copy.names == rig.names
    for a, b in zip(rig, copy, strict=True):
        np.testing.assert_array_equal(a.K, b.K)
        np.testing.assert_array_equal(a.t, b.t)
        np.testing.assert_array_equal(a.distortion, b.distortion)
        assert (a.size, a.fisheye) == (b.size, b.fisheye)
        # the format stores three numbers for nine: entries up to 1, a few ulp each way
        np.testing.assert_allclose(a.R, b.R, rtol=0, atol=2e-15)


def test_a_file_that_this_package_wrote_states_its_unit(write, tmp_path):
    path = tmp_path / "copy.toml"
    write_calibration(path, read_calibration(write(VALID), unit="m"))
    assert read_calibration(path).unit == "m"
    with pytest.raises(sk.InvalidInputError, match=r'unit: expected none or "m", the unit of .*, got \'mm\''):
        read_calibration(path, unit="mm")


def test_rotation_vectors_agree_with_opencv():
    cv2 = pytest.importorskip("cv2")
    for vector in np.random.default_rng(0).normal(scale=1.5, size=(20, 3)):
        # both evaluate the same closed form in double precision
        np.testing.assert_allclose(matrix_from_vector(vector), cv2.Rodrigues(vector)[0], atol=1e-14)

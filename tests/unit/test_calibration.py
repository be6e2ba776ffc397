"""Reading and writing calibrations: what is the same for all formats."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.io

import skelsplat as sk
from skelsplat.cameras import matrix_from_vector
from skelsplat.findings import Remedy
from skelsplat.io import convert_unit, read_calibration, write_calibration
from skelsplat.io.calibration import find_format

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
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("padding", ["", ", 0.0"], ids=["four", "four and a zero"])
def test_fisheye_coefficients(write, padding):
    text = VALID.replace("fisheye = false", "fisheye = true").replace("-2e-05]", f"-2e-05{padding}]")
    camera = read_calibration(write(text), unit="m")[0]
    assert camera.fisheye is True
    np.testing.assert_array_equal(camera.distortion, [-0.05, 0.002, 1e-05, -2e-05])


def test_a_camera_without_distortions_has_none_and_is_warned_of(write):
    text = VALID.replace("distortions = [-0.05, 0.002, 1e-05, -2e-05]\n", "")
    with pytest.warns(UserWarning, match="no distortions for left, right"):
        assert read_calibration(write(text), unit="m")[0].distortion is None


def _scaled(path, rig, factor):
    """Write a rig with all lengths times a factor, without its unit."""
    scaled = [sk.Camera(c.K, c.R, c.t * factor, size=c.size, name=c.name) for c in rig]
    write_calibration(path, sk.CameraRig(scaled, unit="m"))
    path.write_text(path.read_text().replace('unit = "m"\n', ""))
    return path


@pytest.mark.parametrize(
    ("metres", "file_unit", "hint"),
    [
        (5.4, 1, 'so "m" is likely'),
        (5.4, 1000, 'so "mm" is likely'),
        (0.3, 1, 'so "m" is likely'),
        (0.3, 1000, r'that is 30 cm in "mm" or 3 m in "cm"$'),
        (12.0, 1, r'that is 12 cm in "cm" or 12 m in "m"$'),
    ],
)
def test_the_unit_must_be_given_and_one_that_alone_gives_a_usual_distance_is_likely(
    write, metres, file_unit, hint
):
    rig = read_calibration(write(VALID), unit="m")
    spread = np.linalg.norm(rig[0].centre - rig[1].centre)
    with pytest.raises(sk.InvalidInputError, match=rf'unit: expected "mm", "cm" or "m" .*{hint}'):
        read_calibration(_scaled(write(""), rig, metres / spread * file_unit))


def test_millimetres_read_as_metres_are_warned_about(write, tmp_path):
    path = _scaled(tmp_path / "mm.toml", read_calibration(write(VALID), unit="m"), 1000.0)
    with pytest.warns(UserWarning, match=r'are [\d,]+ m apart; .*"mm" is likely') as caught:
        read_calibration(path, unit="m")
    finding = caught[0].message.finding
    assert (finding.kind, finding.remedy) == ("unit_wrong", (Remedy("unit", "mm"),))


@pytest.mark.parametrize("suffix", [".json", ".npz", ".toml"])
def test_writing_and_reading_gives_the_same_rig(tmp_path, suffix):
    K = [[900.5, 0, 320], [0, 901, 240], [0, 0, 1]]
    turn = matrix_from_vector(np.array([0.3, -0.2, 1.5]))
    lens = {
        "α": [0.1, 0, 0, 0],
        "b": [0.1, 0.2, 0, 0, 3e-4, 1, 2, 3],
        "c": [0.1, 0.2, 0, 0.5],
        "d": [0.0] * 4,
    }
    lens["d"] = None if suffix != ".toml" else lens["d"]  # which has no place for none
    cameras = [
        sk.Camera(K, turn, [1 / 3, k, 3], size=(640 + k, 480), name=name, distortion=one, fisheye=name == "c")
        for k, (name, one) in enumerate(lens.items())
    ]
    path, rig = tmp_path / f"rig{suffix}", sk.CameraRig(cameras, "m", {"b": -3.25, "c": 0.0}, 0.0031)
    write_calibration(path, rig)
    copy = read_calibration(path)
    assert (copy.unit, copy.clocks, copy.joint_sigma) == ("m", {"b": -3.25}, 0.0031)
    assert convert_unit(copy, "cm")[1:].joint_sigma == pytest.approx(0.31)
    assert (convert_unit(copy, "mm").clocks, copy[1:].clocks, copy[2:].clocks) == ({"b": -3.25},) * 2 + ({},)
    for a, b in zip(rig, copy, strict=True):
        # TOML stores three numbers for the nine of a rotation: entries up to 1, a few ulp each way
        np.testing.assert_allclose(a.R, b.R, rtol=0, atol=2e-15 if suffix == ".toml" else 0)
        for name in ("K", "t", "distortion", "size", "fisheye", "name"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    with pytest.raises(sk.InvalidInputError, match="unit: "):
        read_calibration(path, unit="mm")


def test_what_is_no_calibration(tmp_path):
    (tmp_path / "a.json").write_text('{"people": []}')
    (tmp_path / "b.xml").write_text("<html/>")
    (tmp_path / "c.txt").write_text("[1, 2, 3]\n[4]\n")
    (tmp_path / "c.mot").write_text("Coordinates\nversion=1\nnRows=2\nendheader\ntime knee\n")
    np.savez(tmp_path / "d.npz", pose=np.zeros(3))
    (tmp_path / "e").mkdir()
    for name in ("a.json", "b.xml", "c.txt", "c.mot", "d.npz", "e"):
        assert find_format(tmp_path / name) is None
        with pytest.raises(sk.DatasetError, match=f"{name}: content"):
            read_calibration(tmp_path / name)


def test_a_folder_with_one_calibration_is_that_calibration(write, tmp_path):
    path = write(VALID)
    (tmp_path / "broken.json").write_text("{")
    assert read_calibration(tmp_path, unit="m") == read_calibration(path, unit="m")
    write_calibration(tmp_path / "rig.json", read_calibration(path, unit="m"))
    with pytest.raises(sk.DatasetError, match=r"content: .*Calib\.toml, rig\.json"):
        read_calibration(tmp_path, unit="m")


def test_a_mat_file_without_cameras_is_refused_with_what_to_save(tmp_path):
    scipy.io.savemat(tmp_path / "stereo.mat", {"stereoParams": {"ImageSize": [1080, 1920]}})
    with pytest.raises(sk.DatasetError, match="save K, r, t, RDistort, TDistort"):
        read_calibration(tmp_path / "stereo.mat")

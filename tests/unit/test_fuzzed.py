"""Small cases of what fuzzing found (`tests/fuzz`)."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import calibration_files
import skelsplat as sk
from array_forms import LAYOUT, PIXELS, RIG, SEEN
from pose_sample import sample
from skelsplat.datasets._files import Value
from skelsplat.io import read_calibration, read_pose, write_pose
from skelsplat.io._arrays import as_numbers as of_file
from skelsplat.io.poses._xarray import to_xarray
from takes import hand_made


def test_detections_of_images_of_twice_the_size_do_not_make_a_recording_nan():
    found = sk.refine_sequence(2.0 * PIXELS, RIG, layout=LAYOUT, fps=50.0)
    assert np.isfinite(found.pose).all()
    assert (found.joint_status == "weak").all()
    assert np.isfinite(found.noise).all()


@pytest.mark.parametrize(
    "fps",
    [memoryview(np.array(50.0)), np.array("2000", "M8[s]"), np.zeros(0), [50.0, 50.0], "50", 10**400],
)
@pytest.mark.parametrize("name", ["refine_sequence", "Refiner", "Tracker", "track"])
def test_a_rate_that_is_no_number_is_named(name, fps):
    calls = {
        "refine_sequence": lambda: sk.refine_sequence(PIXELS, RIG, layout=LAYOUT, fps=fps),
        "Refiner": lambda: sk.Refiner(RIG, layout=LAYOUT, fps=fps),
        "Tracker": lambda: sk.Tracker(RIG, layout=LAYOUT, fps=fps),
        "track": lambda: sk.track(SEEN[:, :, None], RIG, layout=LAYOUT, fps=fps),
    }
    with pytest.raises(sk.InvalidInputError, match=r"^fps: expected a positive number, got .+$"):
        calls[name]()


def test_what_files_hold_is_shortened_in_messages():
    said = str(sk.DatasetError("a.csv", "line 1", "frame", "x" * 5000))
    assert len(said) < 1100
    assert said.startswith("a.csv: line 1: expected frame, got xxx")


@pytest.mark.parametrize("confidence", [1e-29, 1e-31, 1e-150, 5e-324])
def test_tiny_confidences_do_not_make_a_pose_nan(confidence):
    seen = SEEN.copy()
    seen[..., 2] = confidence
    for found in (
        sk.refine(None, seen, RIG, layout=LAYOUT),
        sk.refine_sequence(seen, RIG, layout=LAYOUT, fps=50.0),
    ):
        there = found.joint_status != "unobserved"
        assert there.all() == (confidence > 1e-30)
        assert np.isfinite(found.pose[there]).all()


def test_a_calibrations_name_of_numbers_that_are_no_characters(tmp_path):
    np.savez(
        tmp_path / "a.npz",
        **{name: np.zeros(3) for name in "KRt"},
        names=np.array([0x110000], "<u4").view("<U1"),
    )
    with pytest.raises(sk.DatasetError, match=r"a\.npz: names: expected "):
        read_calibration(tmp_path / "a.npz")


@pytest.mark.parametrize("value", [np.inf, -1e31, 1e308])
def test_data_sets_have_numbers_that_can_be_computed_with(value):
    truth = hand_made().truth.copy()
    truth[0, 3, 1] = value
    with pytest.raises(
        sk.DatasetError, match=r"truth: expected numbers within ±1e\+30, NaN where missing, got "
    ):
        replace(hand_made(), truth=truth)


def test_complex_numbers_of_data_sets_are_no_coordinates(tmp_path):
    with pytest.raises(sk.DatasetError, match="x: expected real numbers, got an array of complex128"):
        Value(tmp_path, "x", np.ones(3, complex)).array()


def test_error_bars_of_which_the_square_is_no_number_name_the_line(tmp_path):
    columns = "frame,joint,x,y,z,error_bar_x,error_bar_y,error_bar_z,unit"
    (tmp_path / "p.csv").write_text(f"{columns}\n0,a,1,2,3,1,1,1,mm\n0,b,1,2,3,1,1e200,1,mm\n")
    with pytest.raises(sk.DatasetError, match=r"p\.csv: line 3, standard deviation: "):
        read_pose(tmp_path / "p.csv")


@pytest.mark.parametrize("name", ["loss", "reprojection_error", "view_weights", "uncertainty"])
def test_poses_with_infinite_numbers_name_the_file_and_the_array(tmp_path, name):
    write_pose(tmp_path / "pose.npz", sample())
    with np.load(tmp_path / "pose.npz") as arrays:
        held = dict(arrays)
    held[name].reshape(-1)[0] = -np.inf
    np.savez(tmp_path / "pose.npz", **held)
    with pytest.raises(sk.DatasetError, match=rf"pose\.npz: {name}: expected finite numbers"):
        read_pose(tmp_path / "pose.npz")


def test_numbers_of_nan_that_signal_are_missing(tmp_path):
    signals = np.array([0x7FA00000], np.uint32).view(np.float32)
    with np.errstate(all="raise"):
        assert np.isnan(of_file(tmp_path, "x", signals)).all()
        assert np.isnan(Value(tmp_path, "x", signals).array()).all()


def test_frames_of_netcdf_are_whole_numbers(tmp_path):
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    found = to_xarray(sample())
    found["frame"] = xarray.full_like(found["frame"], np.nan, dtype=float)
    found.to_netcdf(tmp_path / "pose.nc", engine="h5netcdf")
    with pytest.raises(
        sk.DatasetError, match=r"pose\.nc: variables: .*frames: expected whole numbers, got nan"
    ):
        read_pose(tmp_path / "pose.nc")


def test_a_camera_of_a_calibration_at_1e308_is_no_warning(tmp_path):
    path, rig = tmp_path / "Calib.qca.txt", calibration_files.reference(calibration_files.NAMES)
    calibration_files.qualisys(tmp_path, rig)
    path.write_text(re.sub(r' x="[^"]*"', ' x="1.5e308"', path.read_text()))
    refused = pytest.raises(
        sk.DatasetError, match=r"Calib\.qca\.txt: t of camera .*: expected values within "
    )
    with np.errstate(all="raise"), refused:
        read_calibration(path)

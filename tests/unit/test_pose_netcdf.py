"""Poses as an xarray data set and as NetCDF, as movement lays them out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import skelsplat as sk
from pose_sample import FILLED, JOINTS, MISSING, N, T, sample
from skelsplat.io import PoseData, read_netcdf, to_xarray, write_netcdf


@pytest.fixture
def xarray():
    for package in ("h5py", "h5netcdf"):
        pytest.importorskip(package, reason=f"{package} is not installed: pip install 'skelsplat[formats]'")
    return pytest.importorskip("xarray", reason="xarray is not installed: pip install 'skelsplat[formats]'")


def test_the_dataset_has_the_dimensions_variables_and_attributes_of_movement(xarray, tmp_path):
    data = sample()
    write_netcdf(tmp_path / "pose.nc", data)
    with xarray.open_dataset(tmp_path / "pose.nc", engine="h5netcdf") as dataset:
        assert dataset.position.dims == ("time", "space", "keypoints", "individuals")
        assert dataset.confidence.dims == ("time", "keypoints", "individuals")
        assert dict(dataset.sizes) == {"time": T, "space": 3, "keypoints": N, "individuals": 1, "space_2": 3}
        coordinates = (list(dataset[name].values) for name in ("space", "keypoints", "individuals"))
        assert list(coordinates) == [["x", "y", "z"], list(JOINTS), ["id_0"]]
        np.testing.assert_allclose(dataset.time, np.array([0, 1, 3, 4]) / 59.94, rtol=1e-15)
        expected = {"fps": 59.94, "time_unit": "seconds", "ds_type": "poses", "unit": "mm"}
        expected |= {"source_software": f"SkelSplat {sk.__version__}"}
        assert {name: dataset.attrs[name] for name in expected} == expected
        assert dataset.processing.splitlines() == list(data.processing)
        nose = dataset.position.sel(keypoints="nose", individuals="id_0")
        np.testing.assert_array_equal(nose.values, data.pose[:, 0])
        assert dataset.status.values[FILLED] == "filled"


def test_confidence_is_the_mean_weight_and_0_without_a_sound_position(xarray):  # noqa: ARG001  skips
    data = sample()
    confidence = to_xarray(data).confidence.values[..., 0]
    assert confidence[0, 0] == data.view_weights[0, 0, 0]  # the other view has no detection
    assert confidence[0, 1] == data.view_weights[0, :, 1].mean()
    assert [confidence[place] for place in (*MISSING, FILLED)] == [0.0, 0.0, 0.0]
    bare = PoseData(data.pose, JOINTS, data.frames, "mm")
    assert np.isnan(to_xarray(bare).confidence).all()


@pytest.mark.parametrize("singular", [False, True])
def test_netcdf_and_back(xarray, tmp_path, singular):  # noqa: ARG001
    data = sample()
    write_netcdf(tmp_path / "pose.nc", data, singular=singular)
    back = read_netcdf(tmp_path / "pose.nc")
    names = ("pose", "uncertainty", "joint_status", "joint_names", "frames", "unit", "frame_rate")
    for name in (*names, "processing"):
        np.testing.assert_array_equal(getattr(back, name), getattr(data, name), err_msg=name)


def test_a_joint_whose_position_movement_has_removed_is_unobserved(xarray, tmp_path):  # noqa: ARG001
    """Its filters set positions to NaN, and know no status."""
    data = sample()
    status = data.joint_status.copy()
    status[0, 1], status[MISSING[0]] = "inferred", "weak"
    dataset = to_xarray(replace(data, joint_status=status))
    dataset["position"][0] = np.nan
    dataset.to_netcdf(tmp_path / "pose.nc", engine="h5netcdf")
    back = read_netcdf(tmp_path / "pose.nc")
    status[0] = "unobserved"
    np.testing.assert_array_equal(back.joint_status, status)
    assert np.isnan(back.pose[0]).all()


MALFORMED = {
    "position": lambda dataset: dataset.drop_vars("position"),
    "position: expected dimensions": lambda dataset: dataset.rename(keypoints="joint"),
    "unit": lambda dataset: dataset.assign_attrs(unit="px"),
}


@pytest.mark.parametrize("field", MALFORMED)
def test_a_netcdf_of_something_else(xarray, tmp_path, field):  # noqa: ARG001
    MALFORMED[field](to_xarray(sample())).to_netcdf(tmp_path / "pose.nc", engine="h5netcdf")
    with pytest.raises(sk.DatasetError, match=rf"pose\.nc: {field}"):
        read_netcdf(tmp_path / "pose.nc")

"""Files in and out: calibrations, 2D detections, poses, runs, and the sample that ships with the package.

Readers raise `skelsplat.DatasetError` with the file and the field; writers replace a file whole or leave it
alone.
"""

from skelsplat.io.calibration import convert_unit, read_calibration, write_calibration
from skelsplat.io.detections import DetectionSet, read_detections, read_openpose
from skelsplat.io.poses import (
    PoseData,
    read_c3d,
    read_csv,
    read_json,
    read_netcdf,
    read_npz,
    read_pose,
    read_trc,
    to_xarray,
    write_c3d,
    write_csv,
    write_json,
    write_netcdf,
    write_npz,
    write_pose,
    write_trc,
)
from skelsplat.io.run_folder import RunFolder, read_run

__all__ = [
    "DetectionSet",
    "PoseData",
    "RunFolder",
    "convert_unit",
    "read_c3d",
    "read_calibration",
    "read_csv",
    "read_detections",
    "read_json",
    "read_netcdf",
    "read_npz",
    "read_openpose",
    "read_pose",
    "read_run",
    "read_trc",
    "to_xarray",
    "write_c3d",
    "write_calibration",
    "write_csv",
    "write_json",
    "write_netcdf",
    "write_npz",
    "write_pose",
    "write_trc",
]

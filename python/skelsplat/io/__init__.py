"""Files in and out: calibrations, 2D detections, poses, runs, and the sample that ships with the package.

Readers raise `skelsplat.DatasetError` with the file and the field; writers replace a file whole or leave it
alone, with `skelsplat.DatasetError` if the path cannot be written, and `skelsplat.InvalidInputError` with the
argument for what a format cannot hold. A package that a format needs is a `skelsplat.MissingPackageError`.
"""

from skelsplat.io.calibration import convert_unit, read_calibration, write_calibration
from skelsplat.io.detections import DetectionSet, read_detections, read_layout, read_skeleton
from skelsplat.io.poses import read_pose, write_people, write_pose
from skelsplat.io.poses._c3d import read_c3d, write_c3d
from skelsplat.io.poses._csv import read_csv, write_csv
from skelsplat.io.poses._json import read_json, write_json
from skelsplat.io.poses._npz import read_npz, write_npz
from skelsplat.io.poses._pose_data import PoseData
from skelsplat.io.poses._trc import read_trc, write_trc
from skelsplat.io.poses._xarray import read_netcdf, to_xarray, write_netcdf
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
    "read_layout",
    "read_netcdf",
    "read_npz",
    "read_pose",
    "read_run",
    "read_skeleton",
    "read_trc",
    "to_xarray",
    "write_c3d",
    "write_calibration",
    "write_csv",
    "write_json",
    "write_netcdf",
    "write_npz",
    "write_people",
    "write_pose",
    "write_trc",
]

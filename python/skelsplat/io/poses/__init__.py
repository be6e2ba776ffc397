"""Poses in files: npz and json (everything), csv (tidy), trc and c3d (motion capture), nc (movement)."""

from skelsplat.io.poses._c3d import c3d_is_y_up, read_c3d, write_c3d
from skelsplat.io.poses._csv import read_csv, write_csv
from skelsplat.io.poses._files import POSE_FORMATS, check_pose_format, pose_format, read_pose, write_pose
from skelsplat.io.poses._json import is_json_poses, read_json, to_json, write_json
from skelsplat.io.poses._marker_names import MARKER_NAMES
from skelsplat.io.poses._npz import read_npz, write_npz
from skelsplat.io.poses._pose_data import PoseData
from skelsplat.io.poses._trc import read_trc, write_trc
from skelsplat.io.poses._xarray import read_netcdf, to_xarray, write_netcdf

__all__ = [
    "MARKER_NAMES",
    "POSE_FORMATS",
    "PoseData",
    "c3d_is_y_up",
    "check_pose_format",
    "is_json_poses",
    "pose_format",
    "read_c3d",
    "read_csv",
    "read_json",
    "read_netcdf",
    "read_npz",
    "read_pose",
    "read_trc",
    "to_json",
    "to_xarray",
    "write_c3d",
    "write_csv",
    "write_json",
    "write_netcdf",
    "write_npz",
    "write_pose",
    "write_trc",
]

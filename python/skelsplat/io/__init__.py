"""Files in and out: calibrations, 2D detections, poses, and the sample that ships with the package.

Readers raise `skelsplat.DatasetError` with the file and the field; writers replace a file whole or leave it
alone.
"""

from skelsplat.io.calibration import convert_unit, read_calibration, write_calibration
from skelsplat.io.detections import DetectionSet, read_openpose
from skelsplat.io.poses import PoseData, read_npz, read_trc, write_csv, write_npz, write_trc

__all__ = [
    "DetectionSet",
    "PoseData",
    "convert_unit",
    "read_calibration",
    "read_npz",
    "read_openpose",
    "read_trc",
    "write_calibration",
    "write_csv",
    "write_npz",
    "write_trc",
]

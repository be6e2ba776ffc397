"""Poses in files: npz (everything), csv (tidy), trc (motion-capture tools)."""

from skelsplat.io.poses._csv import write_csv
from skelsplat.io.poses._npz import read_npz, write_npz
from skelsplat.io.poses._pose_data import PoseData
from skelsplat.io.poses._trc import read_trc, write_trc

__all__ = ["PoseData", "read_npz", "read_trc", "write_csv", "write_npz", "write_trc"]

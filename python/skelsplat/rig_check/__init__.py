"""What is wrong with a calibration, in words: unit, exchanged or turned cameras, frame offsets."""

from skelsplat.rig_check._check import check_rig
from skelsplat.rig_check._findings import CameraRow, Finding, RigReport

__all__ = ["CameraRow", "Finding", "RigReport", "check_rig"]

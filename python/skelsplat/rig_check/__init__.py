"""What is wrong with a calibration: unit, exchanged or rotated cameras, frame offsets."""

from skelsplat.rig_check._check import check_rig, unusual_lenses
from skelsplat.rig_check._report import CameraRow, ReadAs, RigReport

__all__ = ["CameraRow", "ReadAs", "RigReport", "check_rig", "unusual_lenses"]

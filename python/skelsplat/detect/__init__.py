"""2D detections from videos, by detectors that are optional packages.

`detect` runs a `Detector` on one video per camera and writes OpenPose JSON, which this package and Pose2Sim
read. `MediaPipe` and `RTMLib` are the detectors; any object with the members of `Detector` will do.
"""

from skelsplat.detect._detect import Detected, Detector, detect
from skelsplat.detect._detectors import MediaPipe, RTMLib

__all__ = ["Detected", "Detector", "MediaPipe", "RTMLib", "detect"]

"""2D detections: readers from detectors' files to one `DetectionSet`."""

from skelsplat.io.detections._detection_set import DetectionSet
from skelsplat.io.detections.openpose import read_openpose

__all__ = ["DetectionSet", "read_openpose"]

"""2D detections: one reader for all tools' files, found by content or by name, to one `DetectionSet`.

A format is a `DetectionFormat` in `FORMATS`, a module of this package each: a look at a file's beginning, and
readers from a folder or file of one camera, or from a file of all, to views. Cameras, frames, joints and
missing values are the same for all and live here.
"""

from skelsplat.io.detections._detection_set import DetectionSet
from skelsplat.io.detections._read import read_detections, read_openpose
from skelsplat.io.detections._registry import FORMATS

__all__ = ["FORMATS", "DetectionSet", "read_detections", "read_openpose"]

"""2D detections: one reader for all tools' files, found by content or by name, to one `DetectionSet`.

A format is a module of this package and a row in `FORMATS`: a look at a file's beginning, and readers from a
folder or file of one camera, or from a file of all, to views. Cameras, frames, joints and missing values are
the same for all and live here. What is wrong with a file is a `DatasetError` with its path and field, what is
wrong with an argument an `InvalidInputError`.
"""

from skelsplat.io.detections._match import camera_called, cameras_called
from skelsplat.io.detections._read import DetectionSet, read_detections, read_openpose
from skelsplat.io.detections._registry import FORMATS

__all__ = [
    "FORMATS",
    "DetectionSet",
    "camera_called",
    "cameras_called",
    "read_detections",
    "read_openpose",
]

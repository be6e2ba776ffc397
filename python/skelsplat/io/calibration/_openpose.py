"""OpenPose's camera parameters: a folder with one OpenCV XML file per camera, metres.

``CameraMatrix`` 3×4 is world → camera [R | t], ``Intrinsics`` 3×3, ``Distortion`` n×1 in OpenCV's order. The
camera's name is that of its file. The image size is not in the files.
"""

from __future__ import annotations

from skelsplat.exceptions import DatasetError
from skelsplat.io._fields import Field
from skelsplat.io._files import natural
from skelsplat.io.calibration._entries import lens_of
from skelsplat.io.calibration._format import Parsed, RawCamera, Source
from skelsplat.io.calibration._opencv import matrices_of_xml

_ROOT = "opencv_storage"


def matches(source: Source) -> bool:
    """Whether a folder has XML files, or a file has OpenCV's root."""
    if source.is_folder:
        return any(file.suffix.lower() == ".xml" for file in source.files)
    return source.xml is not None and source.xml.tag == _ROOT


def parse(source: Source) -> Parsed:
    """Return the camera of every file, 2.xml before 10.xml."""
    files = [f for f in source.files if f.suffix.lower() == ".xml"] if source.is_folder else [source.path]
    if not files:
        raise DatasetError(source.path, "files", "one XML file per camera", "none")
    return Parsed([_camera(Source(file)) for file in sorted(files, key=lambda f: natural(f.stem))], "m")


def _camera(source: Source) -> RawCamera:
    root = source.xml
    if root is None or root.tag != _ROOT:
        actual = "no XML" if root is None else f"<{root.tag}>"
        raise DatasetError(source.path, "root", f"<{_ROOT}>, as OpenCV writes it", actual)
    entry = Field(source.path, "", matrices_of_xml(source.path, root))
    pose = entry["CameraMatrix"].numbers((3, 4))
    return RawCamera(
        name=source.path.stem,
        K=entry["Intrinsics"].numbers((3, 3)),
        R=pose[:, :3],
        t=pose[:, 3],
        distortion=lens_of(entry["Distortion"]),
        size=None,
    )

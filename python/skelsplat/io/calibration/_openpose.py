"""OpenPose's camera parameters: a folder with one OpenCV XML file per camera, metres.

``CameraMatrix`` 3×4 is world → camera [R | t], ``Intrinsics`` 3×3, ``Distortion`` n×1 in OpenCV's order. The
camera's name is that of its file. The image size is not in the files.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io.calibration._fields import Entry
from skelsplat.io.calibration._raw import CalibrationFormat, Parsed, RawCamera
from skelsplat.io.calibration._source import Source

if TYPE_CHECKING:
    import xml.etree.ElementTree as ET

    from skelsplat.io.calibration._raw import Options

_ROOT = "opencv_storage"


def _matches(source: Source) -> bool:
    if source.is_folder:
        return any(file.suffix.lower() == ".xml" for file in source.files)
    return source.xml is not None and source.xml.tag == _ROOT


def _parse(source: Source, options: Options) -> Parsed:  # noqa: ARG001
    files = [f for f in source.files if f.suffix.lower() == ".xml"] if source.is_folder else [source.path]
    if not files:
        raise DatasetError(source.path, "files", "one XML file per camera", "none")
    return Parsed([_camera(Source(file)) for file in sorted(files, key=_natural)], "m")


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort key that puts 2.xml before 10.xml."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.stem)]


def _camera(source: Source) -> RawCamera:
    root = source.xml
    if root is None or root.tag != _ROOT:
        actual = "no XML" if root is None else f"<{root.tag}>"
        raise DatasetError(source.path, "root", f"<{_ROOT}>, as OpenCV writes it", actual)
    entry = Entry(source.path, "", {child.tag: _matrix(source.path, child) for child in root if len(child)})
    pose = entry.numbers("CameraMatrix", (3, 4))
    return RawCamera(
        table=source.path.name,
        name=source.path.stem,
        K=entry.numbers("Intrinsics", (3, 3)),
        R=pose[:, :3],
        t=pose[:, 3],
        distortion=entry.distortion("Distortion"),
        fisheye=False,
        size=None,
    )


def _matrix(path: Path, node: ET.Element) -> Any:
    """Rows × columns of an ``opencv-matrix``."""
    parts = {child.tag: (child.text or "").split() for child in node}
    try:
        shape = int(parts["rows"][0]), int(parts["cols"][0])
        values = [float(value) for value in parts["data"]]
    except (KeyError, IndexError, ValueError) as error:
        raise DatasetError(path, node.tag, "a matrix with rows, cols and data", repr(error)) from error
    if len(values) != shape[0] * shape[1]:
        raise DatasetError(path, node.tag, f"{shape[0]}×{shape[1]} numbers", f"{len(values)} numbers")
    return np.reshape(values, shape).tolist()


OPENPOSE = CalibrationFormat(
    "openpose", "folder of OpenPose XML files, one per camera", _matches, _parse, frozenset({"size"})
)

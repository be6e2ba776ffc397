"""The four cameras of Human3.6M, and ``camera-parameters.json``.

``{"intrinsics": {camera: {"calibration_matrix", "distortion": [k1, k2, p1, p2, k3]}},
"extrinsics": {subject: {camera: {"R", "t"}}}}``; mm, world to camera. The file does not say how large the
images are. In the file that is passed around, p1 and p2 are exchanged relative to VideoPose3D's list (at most
2.4 px in the images); it is read as it stands, and `skelsplat.datasets.check` says which fits the detections.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from skelsplat._skelsplat import Camera
from skelsplat.cameras import CameraRig
from skelsplat.datasets._files import FloatArray, load_json, numbers, require
from skelsplat.datasets._rig import build_camera, build_rig
from skelsplat.exceptions import DatasetError

CAMERAS = ("54138969", "55011271", "58860488", "60457274")
"""In the order of every format."""

FILE = "camera-parameters.json"

_SIZES = {name: (1000, 1002 if name in ("54138969", "60457274") else 1000) for name in CAMERAS}


def camera(
    path: Path, field: str, name: str, parts: tuple[FloatArray, FloatArray, FloatArray, FloatArray]
) -> Camera:
    """Return the camera `name` with K, R, t and distortion, or raise `DatasetError`."""
    K, R, t, distortion = parts
    return build_camera(path, field, K=K, R=R, t=t, distortion=distortion, size=_SIZES[name], name=name)


def find_cameras(root: Path, given: Path | None) -> Path:
    """Return where the cameras' file is, or should be."""
    if given is not None:
        return given / FILE if given.is_dir() else given
    places = [folder / FILE for folder in (root / "cameras", root, root.parent / "cameras", root.parent)]
    return next((place for place in places if place.is_file()), places[0])


class Parameters:
    """The content of ``camera-parameters.json``.

    Raises
    ------
    DatasetError
        If the file is missing or malformed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._content: Any = load_json(path)
        require(path, "", self._content, "intrinsics")
        require(path, "", self._content, "extrinsics")

    def rig(self, subject: str) -> CameraRig:
        """Return the four cameras as they stood for a subject.

        Raises
        ------
        DatasetError
            If one is missing or its values make no camera.
        """
        return build_rig(self.path, [self._camera(subject, name) for name in CAMERAS], "mm")

    def _camera(self, subject: str, name: str) -> Camera:
        path, inside, outside = self.path, f"intrinsics.{name}", f"extrinsics.{subject}"
        lens = require(path, "intrinsics", self._content["intrinsics"], name)
        placed = require(
            path, outside, require(path, "extrinsics", self._content["extrinsics"], subject), name
        )
        outside = f"{outside}.{name}"
        t = numbers(path, f"{outside}.t", _flat(require(path, outside, placed, "t")), (3,))
        return camera(
            path,
            outside,
            name,
            (
                numbers(
                    path,
                    f"{inside}.calibration_matrix",
                    require(path, inside, lens, "calibration_matrix"),
                    (3, 3),
                ),
                numbers(path, f"{outside}.R", require(path, outside, placed, "R"), (3, 3)),
                t,
                numbers(path, f"{inside}.distortion", _flat(require(path, inside, lens, "distortion")), (5,)),
            ),
        )


def _flat(value: Any) -> Any:
    """Turn a column ``[[x], [y], [z]]`` or a row ``[[x, y, z]]`` into ``[x, y, z]``."""
    if isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        return [entry for row in value for entry in row]
    return value


def check_views(path: Path, field: str, count: int) -> None:
    """Raise `DatasetError` unless there are four views."""
    if count != len(CAMERAS):
        raise DatasetError(path, field, f"{len(CAMERAS)} cameras ({', '.join(CAMERAS)})", count)

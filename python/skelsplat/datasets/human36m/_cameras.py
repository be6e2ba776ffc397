"""The four cameras of Human3.6M, and ``camera-parameters.json``.

In the file that is passed around, p1 and p2 are exchanged relative to VideoPose3D's list (at most
2.4 px in the images); it is read as it stands, and `skelsplat.datasets.check` says which fits the detections.
"""

from __future__ import annotations

from pathlib import Path

from skelsplat.cameras import CameraRig
from skelsplat.datasets._rig import read_quietly
from skelsplat.exceptions import DatasetError, InvalidInputError

CAMERAS = ("54138969", "55011271", "58860488", "60457274")
"""In the order of every format."""

FILE = "camera-parameters.json"

SIZES = {name: (1000, 1002 if name in ("54138969", "60457274") else 1000) for name in CAMERAS}


def find_cameras(root: Path, given: Path | None) -> Path:
    """Return where the cameras' file is, or should be."""
    if given is not None:
        return given / FILE if given.is_dir() else given
    places = [folder / FILE for folder in (root / "cameras", root, root.parent / "cameras", root.parent)]
    return next((place for place in places if place.is_file()), places[0])


def read_rig(path: Path, subject: str) -> CameraRig:
    """Return the four cameras of ``camera-parameters.json`` as they stood for a subject, mm.

    Raises `DatasetError` if the file is missing or malformed, or lacks the subject or a camera.
    """
    try:
        rig = read_quietly(path, "human36m", subject=subject)
    except InvalidInputError as error:
        raise DatasetError(path, "extrinsics", f"the subject {subject}", error) from error
    for name in CAMERAS:
        if name not in rig.names:
            raise DatasetError(
                path, f"extrinsics.{subject}.{name}", "a camera", f"only {', '.join(rig.names)}"
            )
    return CameraRig([rig[name] for name in CAMERAS], rig.unit)

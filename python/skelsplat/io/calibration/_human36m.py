"""Human3.6M's ``camera-parameters.json``: millimetres, world → camera.

``intrinsics`` has per camera ``calibration_matrix`` 3×3 and ``distortion`` (k1, k2, p1, p2, k3);
``extrinsics`` has per subject and camera ``R`` 3×3 and ``t`` 3×1. The image sizes are those of the data set:
two cameras have 1002 lines, two 1000.
"""

from __future__ import annotations

from skelsplat.exceptions import InvalidInputError
from skelsplat.io._fields import Field
from skelsplat.io.calibration._entries import lens_of
from skelsplat.io.calibration._format import Parsed, RawCamera, Source

# (width, height) of the videos
_SIZES = {
    "54138969": (1000, 1002),
    "55011271": (1000, 1000),
    "58860488": (1000, 1000),
    "60457274": (1000, 1002),
}


def matches(source: Source) -> bool:
    """Whether a document has the two tables."""
    return "intrinsics" in source.json and "extrinsics" in source.json


def parse(source: Source, subject: str | None) -> Parsed:
    """Return the cameras of a subject."""
    document = source.json
    if not isinstance(document.value, dict):
        raise document.error("intrinsics and extrinsics per camera", type(document.value).__name__)
    intrinsics, extrinsics = document["intrinsics"].table(), document["extrinsics"].table()
    poses = extrinsics[_subject(extrinsics, subject)].table()
    if not poses.value:
        raise poses.error("a camera", "none")
    cameras = [_camera(intrinsics[name].table(), poses[name].table(), name) for name in poses.value]
    return Parsed(cameras, "mm")


def _subject(extrinsics: Field, subject: str | None) -> str:
    """Return whose extrinsics: cameras were moved between subjects, so of several one must be named."""
    known = list(extrinsics.value)
    if subject is None and len(known) == 1:
        return str(known[0])
    if subject not in known:
        got = "none" if subject is None else repr(subject)
        expected = f"one of {', '.join(known)} for {extrinsics.path}"
        raise InvalidInputError(f"subject: expected {expected}, got {got}")
    return str(subject)


def _camera(intrinsics: Field, pose: Field, name: str) -> RawCamera:
    return RawCamera(
        name=name,
        K=intrinsics["calibration_matrix"].numbers((3, 3)),
        R=pose["R"].numbers((3, 3)),
        t=pose["t"].numbers((3,)),
        distortion=lens_of(intrinsics["distortion"]),
        size=_SIZES.get(name),
    )

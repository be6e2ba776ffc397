"""Human3.6M's ``camera-parameters.json``: millimetres, world → camera.

``intrinsics`` has per camera ``calibration_matrix`` 3×3 and ``distortion`` (k1, k2, p1, p2, k3);
``extrinsics`` has per subject and camera ``R`` 3×3 and ``t`` 3×1. The image sizes are those of the data set:
two cameras have 1002 lines, two 1000.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io.calibration._fields import Entry
from skelsplat.io.calibration._raw import CalibrationFormat, Parsed, RawCamera

if TYPE_CHECKING:
    from skelsplat.io.calibration._raw import Options
    from skelsplat.io.calibration._source import Source

# (width, height) of the videos
_SIZES = {
    "54138969": (1000, 1002),
    "55011271": (1000, 1000),
    "58860488": (1000, 1000),
    "60457274": (1000, 1002),
}


def _matches(source: Source) -> bool:
    document = source.json
    return isinstance(document, dict) and {"intrinsics", "extrinsics"} <= document.keys()


def _parse(source: Source, options: Options) -> Parsed:
    document = source.json
    if not isinstance(document, dict):
        raise DatasetError(
            source.path, "document", "intrinsics and extrinsics per camera", type(document).__name__
        )
    top = Entry(source.path, "", document)
    intrinsics, extrinsics = top.entry("intrinsics"), top.entry("extrinsics")
    subject = _subject(extrinsics, options.subject)
    poses = extrinsics.entry(subject)
    if not poses.values:
        raise poses.error("", "a camera", "none")
    return Parsed([_camera(intrinsics.entry(name), poses.entry(name), name) for name in poses.values], "mm")


def _subject(extrinsics: Entry, subject: str | None) -> str:
    """Whose extrinsics: cameras were moved between subjects, so one must be named if there are several."""
    known = list(extrinsics.values)
    if subject is None and len(known) == 1:
        return str(known[0])
    if subject not in known:
        got = "none" if subject is None else repr(subject)
        raise InvalidInputError(
            f"subject: expected one of {', '.join(known)} for {extrinsics.path}, got {got}"
        )
    return str(subject)


def _camera(intrinsics: Entry, pose: Entry, name: str) -> RawCamera:
    return RawCamera(
        table=pose.key,
        name=name,
        K=intrinsics.numbers("calibration_matrix", (3, 3)),
        R=pose.numbers("R", (3, 3)),
        t=pose.numbers("t", (3,)),
        distortion=intrinsics.distortion("distortion"),
        fisheye=False,
        size=_SIZES.get(name),
    )


HUMAN36M = CalibrationFormat(
    "human36m",
    "Human3.6M camera-parameters.json",
    _matches,
    _parse,
    frozenset({"subject", "size"}),
)

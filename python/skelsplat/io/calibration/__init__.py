"""Camera calibrations: one reader for all formats, found by content or by name.

A format is a `CalibrationFormat` in `FORMATS`: a test on the file's text, and a parser from text to
`RawCamera`. Names, units and the building of cameras are the same for all and live here.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import skelsplat as sk
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._files import read_text
from skelsplat.io.calibration._anipose import ANIPOSE
from skelsplat.io.calibration._unit import check_unit
from skelsplat.io.calibration._write import write_calibration

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from skelsplat.io.calibration._raw import CalibrationFormat, RawCamera

__all__ = ["FORMATS", "read_calibration", "write_calibration"]

FORMATS: dict[str, CalibrationFormat] = {ANIPOSE.name: ANIPOSE}


def read_calibration(
    path: str | os.PathLike[str], *, unit: str | None = None, format: str | None = None
) -> sk.CameraRig:
    """Read a calibration file into a rig, cameras in the order of the file.

    Parameters
    ----------
    path : path
        The calibration file.
    unit : "mm", "cm" or "m"
        The length unit of the file's translations. Calibration files do not state it, so it must be given.
    format : str, optional
        A key of `FORMATS` (``"anipose"``: TOML of Anipose, Pose2Sim, FreeMoCap and Caliscope's export); found
        from the content when left out.

    Returns
    -------
    CameraRig
        Its lengths are in `unit`.

    Raises
    ------
    InvalidInputError
        If `unit` is missing (the message names the likely one) or unknown, or `format` is unknown.
    DatasetError
        If the file is missing or malformed; names the table and key.

    Warns
    -----
    UserWarning
        If the cameras would stand less than 5 cm or more than 100 m apart in the given unit.
    """
    source = Path(path)
    text = read_text(source)
    raw = _find_format(source, text, format).parse(source, text)
    _check_names(source, raw)
    known_unit = check_unit(source, [camera.centre() for camera in raw], unit)
    return sk.CameraRig([_build(source, camera) for camera in raw], unit=known_unit)


def _find_format(path: Path, text: str, name: str | None) -> CalibrationFormat:
    known = ", ".join(FORMATS)
    if name is not None:
        if name not in FORMATS:
            raise InvalidInputError(f"format: expected one of {known}, got {name!r}")
        return FORMATS[name]
    for candidate in FORMATS.values():
        if candidate.matches(text):
            return candidate
    raise DatasetError(path, "content", f"a calibration in a known format ({known})", "something else")


def _check_names(path: Path, cameras: Sequence[RawCamera]) -> None:
    name, count = Counter(camera.name for camera in cameras).most_common(1)[0]
    if count > 1:
        raise DatasetError(
            path, "name", "a different name for every camera", f"{count} cameras named {name!r}"
        )


def _build(path: Path, raw: RawCamera) -> sk.Camera:
    try:
        return sk.Camera(
            raw.K,
            raw.R,
            raw.t,
            distortion=raw.distortion,
            fisheye=raw.fisheye,
            size=raw.size,
            name=raw.name,
        )
    except InvalidInputError as error:
        field, _, rest = str(error).partition(": expected ")
        expected, _, actual = rest.partition(", got ")
        raise DatasetError(path, field, expected, actual) from error

"""Camera calibrations: one reader for all formats, found by content or by name.

A format is a `CalibrationFormat` in ``FORMATS`` of its module: a test on a file or folder, and a parser to
`RawCamera`. Names, units, image sizes and the building of cameras are the same for all and live here.
"""

from __future__ import annotations

import os
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._atomic import atomic_write, atomic_write_text
from skelsplat._budget import MOST_CAMERAS, MOST_NAME, opened, within_memory
from skelsplat.cameras import MM_PER_UNIT, altered
from skelsplat.exceptions import DatasetError, InvalidInputError, one_of
from skelsplat.findings import FindingWarning
from skelsplat.io._files import of_file
from skelsplat.io.calibration import _binary, _json, _opencv, _toml, _xml
from skelsplat.io.calibration._format import CalibrationFormat, RawCamera, Source
from skelsplat.io.calibration._unit import check_unit

__all__ = ["FORMATS", "convert_unit", "find_format", "read_calibration", "write_calibration"]

# in the order in which they are tried: Anipose's TOML is what no other format claims
FORMATS: dict[str, CalibrationFormat] = {
    known.name: known for module in (_json, _xml, _opencv, _binary, _toml) for known in module.FORMATS
}
_WRITTEN = {".toml": "anipose", ".json": "json", ".npz": "npz"}
# of files that may be calibrations in a folder, and how many are looked at
_SUFFIXES = (".toml", ".json", ".xml", ".txt", ".xcp", ".yml", ".yaml", ".npz", ".mat", ".pickle", ".pkl")
_MOST_FILES = 50


def read_calibration(
    path: str | os.PathLike[str],
    *,
    unit: str | None = None,
    format: str | None = None,
    camera_type: str | None = None,
    subject: str | None = None,
    size: tuple[int, int] | Mapping[str, tuple[int, int]] | None = None,
    binning: float | None = None,
) -> sk.CameraRig:
    """Read a calibration into a rig, cameras in the order of the file.

    Parameters
    ----------
    path : path
        The calibration file, the folder where a format is one, or a folder with one calibration.
    unit : "mm", "cm" or "m"
        The length unit of the file's translations. It must be given for the formats that do not say it:
        ``anipose`` (unless this package wrote the file) and ``easymocap``. For the others it may be left out;
        one that contradicts the format is an error.
    format : str, optional
        Found from the content when left out. A key of `FORMATS`, whose ``about`` and ``unit`` say what
        writes it and in which unit.
    camera_type : str, optional
        Which cameras of a file with several kinds: for Panoptic ``"hd"`` (default), ``"vga"``, …; for
        Qualisys and Vicon the video cameras (default); ``"all"``.
    subject : str, optional
        Human3.6M: whose extrinsics, such as ``"S9"``.
    size : (width, height) or mapping from camera name to it, optional
        Size of the images, for formats that do not say it: OpenPose, and EasyMocap without ``H_`` and ``W_``.
        (Nothing else will do: twice the principal point, as some programs assume, is wrong for most images.)
    binning : float, optional
        Qualisys: sensor pixels per image pixel, where videos have fewer lines than the sensor.

    Returns
    -------
    CameraRig
        Its lengths are in `unit`, or in the format's.

    Raises
    ------
    InvalidInputError
        If `unit` is missing (the message names the likely one), unknown or contradicts the format, `format`
        is unknown, or an option does not go with the format or is missing.
    DatasetError
        If the file is missing or malformed; names file and field.

    Warns
    -----
    UserWarning
        If the cameras would stand less than 5 cm or more than 100 m apart in the given unit; if a camera of a
        TOML has no lens coefficients; if a Qualisys camera's view was turned; if Vicon's lens model could not
        be followed to 0.1 px.
    """
    with within_memory(Path(path)):
        source, chosen = _find(Source(path), format)
    options = {"camera_type": camera_type, "subject": subject, "size": size, "binning": binning}
    _check_options(chosen, options)
    # a number beyond all others is refused with its camera
    with within_memory(source.path), np.errstate(over="ignore", invalid="ignore"):
        parsed = chosen.parse(source, **{name: options[name] for name in chosen.options if name != "size"})
    _check_amount(source.path, parsed.cameras)
    for finding in parsed.findings:
        warnings.warn(FindingWarning(finding), stacklevel=2)
    _check_names(source.path, parsed.cameras)
    cameras = [_build(source.path, camera, _size(source.path, camera, size)) for camera in parsed.cameras]
    known_unit = check_unit(source.path, cameras, unit, stated=parsed.unit)
    return sk.CameraRig(cameras, unit=known_unit)


def find_format(path: str | os.PathLike[str]) -> str | None:
    """Return the key of the format that a file or folder has; None if it is no calibration.

    A file that cannot be read, or begins like JSON, XML or TOML and is broken, and a folder with several
    calibrations are a `DatasetError`.
    """
    found = _found(Source(path), None)
    return None if found is None else found[1].name


def _recognised(source: Source) -> str | None:
    return next((known.name for known in FORMATS.values() if known.matches(source)), None)


def _find(source: Source, name: str | None) -> tuple[Source, CalibrationFormat]:
    """Return the calibration, in a folder or not, and its format."""
    known = sorted(FORMATS)
    one_of("format", name, (None, *known))
    found = _found(source, name)
    if found is None:
        from skelsplat.io._kinds import seems  # which imports this module

        if not source.is_folder:
            with opened(source.path):  # of a binary one nothing was read yet
                pass
        unknown = "a folder without one" if source.is_folder else "something else"
        actual = seems(source.path) or unknown
        expected = f"a calibration in a known format ({', '.join(known)})"
        raise DatasetError(source.path, "content", expected, actual)
    return found


def _found(source: Source, name: str | None) -> tuple[Source, CalibrationFormat] | None:
    """Return a source in a format, or the only file of a folder that is one; a named format is believed."""
    form = _recognised(source) if name is None or source.is_folder else None
    inside = _among(source, name) if form is None else {}
    if len(inside) > 1:
        names = ", ".join(one.path.name for one in inside)
        raise DatasetError(source.path, "content", "a folder with one calibration, or the file itself", names)
    if inside:
        return next(iter(inside.items()))
    return None if name is form is None else (source, FORMATS[name or form or ""])


def _among(source: Source, name: str | None) -> dict[Source, CalibrationFormat]:
    """Return the calibrations among a folder's files, of this format if one is named.

    A broken file is passed over; so is a folder with so many files that they are detections.
    """
    files = [path for path in source.files if path.suffix.lower() in _SUFFIXES]
    found = {}
    for one in map(Source, files if len(files) <= _MOST_FILES else []):
        try:
            form = _recognised(one)
            if form == "anipose" and not _toml.has_cameras(one):
                continue
        except DatasetError:
            continue
        if form is not None and name in (None, form):
            found[one] = FORMATS[form]
    return found


def _check_options(chosen: CalibrationFormat, options: Mapping[str, Any]) -> None:
    for name, value in options.items():
        if value is not None and name not in chosen.options:
            raise InvalidInputError(f"{name}: expected none for {chosen.name} files, got {value!r}")
    binning = options["binning"]
    if binning is not None and not (np.isfinite(binning) and binning >= 1.0):
        raise InvalidInputError(f"binning: expected a number of at least 1, got {binning!r}")


def _check_names(path: Path, cameras: Sequence[RawCamera]) -> None:
    name, count = Counter(camera.name for camera in cameras).most_common(1)[0]
    if count > 1:
        actual = f"{count} cameras named {name!r}"
        raise DatasetError(path, "name", "a different name for every camera", actual)
    blank = [camera.name for camera in cameras if not camera.name.strip()]
    if blank:
        raise DatasetError(path, "name", "a name for every camera", repr(blank[0]))


def _check_amount(path: Path, cameras: Sequence[RawCamera]) -> None:
    if not cameras:
        raise DatasetError(path, "cameras", "at least one camera", "none")
    longest = max(len(camera.name) for camera in cameras)
    if longest > MOST_NAME or len(cameras) > MOST_CAMERAS:
        actual = f"{len(cameras)} cameras with names of at most {longest} characters"
        expected = f"at most {MOST_CAMERAS} cameras with names of at most {MOST_NAME} characters"
        raise DatasetError(path, "cameras", expected, actual)


def _size(
    path: Path, camera: RawCamera, given: tuple[int, int] | Mapping[str, tuple[int, int]] | None
) -> tuple[int, int]:
    if isinstance(given, Mapping):
        given = given.get(camera.name)
    if camera.size is None:
        if given is None:
            expected = f"the images' (width, height) for camera {camera.name!r}"
            raise InvalidInputError(
                f"size: expected {expected}, because {path} does not contain it, got none"
            )
        return given
    if given is not None and tuple(given) != camera.size:
        width, height = camera.size
        expected = f"none or ({width}, {height}), the size of camera {camera.name!r} in {path}"
        raise InvalidInputError(f"size: expected {expected}, got {tuple(given)}")
    return camera.size


def _build(path: Path, raw: RawCamera, size: tuple[int, int]) -> sk.Camera:
    try:
        return sk.Camera(
            raw.K, raw.R, raw.t, distortion=raw.distortion, fisheye=raw.fisheye, size=size, name=raw.name
        )
    except InvalidInputError as error:
        raise of_file(path, error) from error


def convert_unit(rig: sk.CameraRig, unit: str) -> sk.CameraRig:
    """Return the same cameras with lengths in another unit.

    Raises
    ------
    InvalidInputError
        If the unit is not mm, cm or m.
    """
    one_of("unit", unit, MM_PER_UNIT)
    factor = rig.mm_per_unit / MM_PER_UNIT[unit]
    cameras = [altered(camera, t=np.asarray(camera.t) * factor) for camera in rig]
    return sk.CameraRig(cameras, unit=unit)


def write_calibration(
    path: str | os.PathLike[str],
    rig: sk.CameraRig,
    *,
    format: str | None = None,
    note: str | None = None,
    adjusted: bool = False,
) -> None:
    """Write `rig` as Anipose TOML, which Pose2Sim, FreeMoCap and Caliscope also read, or as JSON or npz.

    Numbers are written with all their digits. JSON and npz give the same rig back. So does TOML but for two
    things: rotations, stored as three numbers in this format, may differ in the last digit, and a camera
    without distortion comes back with zeros. TOML has no place for the unit: it is noted under ``metadata``,
    where this package looks and other programs do not. Pose2Sim takes metres, FreeMoCap millimetres
    (`convert_unit`).

    Parameters
    ----------
    path : path
        File to write; replaced whole or, on an error, left as it was.
    rig : CameraRig
    format : {"anipose", "json", "npz"}, optional
        Found from the suffix (``.toml``, ``.json``, ``.npz``) when left out.
    note : str, optional
        Where the cameras come from: the first line of TOML, a comment; ``"note"`` in JSON and npz. It is not
        read again.
    adjusted : bool
        In TOML, states that detections of a recording adjusted these cameras, so that Anipose does not adjust
        them again (`skelsplat.run.adjust_cameras`).

    Raises
    ------
    InvalidInputError
        If the format is unknown, or left out with another suffix.
    DatasetError
        If the path cannot be written.
    """
    suffix = Path(path).suffix.lower()
    chosen = _WRITTEN.get(suffix) if format is None else format
    if chosen not in _WRITTEN.values():
        expected = f"one of {', '.join(_WRITTEN.values())}, or a path in {', '.join(_WRITTEN)}"
        raise InvalidInputError(f"format: expected {expected}, got {format or suffix or 'no suffix'!r}")
    if chosen == "npz":
        with atomic_write(path) as stream:
            noted: dict[str, Any] = {} if note is None else {"note": np.array(note)}
            np.savez(stream, **_json.to_arrays(rig), **noted)
    else:
        text = _json.to_json(rig, note) if chosen == "json" else _toml.to_toml(rig, note, adjusted=adjusted)
        atomic_write_text(path, text)

"""Camera calibrations: one reader for all formats, found by content or by name.

A format is a `CalibrationFormat` in ``FORMATS`` of its module: a test on a file or folder, and a parser to
`RawCamera`. Names, units, image sizes and the building of cameras are the same for all and live here.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

import skelsplat as sk
from skelsplat._atomic import atomic_write, atomic_write_text
from skelsplat._budget import MOST_CAMERAS, MOST_NAME, opened, within_memory
from skelsplat._words import metric, size_text
from skelsplat.cameras import MM_PER_UNIT, altered
from skelsplat.exceptions import DatasetError, InvalidInputError, one_of
from skelsplat.findings import Finding, Remedy, Subject, warn
from skelsplat.io.calibration import _binary, _json, _opencv, _plain, _toml, _xml
from skelsplat.io.calibration._format import CalibrationFormat, RawCamera, Source
from skelsplat.io.detections._match import reads_alike

__all__ = ["FORMATS", "convert_unit", "find_format", "read_calibration", "write_calibration"]

Size: TypeAlias = tuple[int, int]

# in the order in which they are tried: Anipose's TOML is what no other format claims
FORMATS: dict[str, CalibrationFormat] = {
    known.name: known for module in (_json, _plain, _xml, _opencv, _binary, _toml) for known in module.FORMATS
}
WRITTEN = {".toml": "anipose", ".json": "json", ".npz": "npz"}
# of files that may be calibrations in a folder, and how many are looked at
_SUFFIXES = (".toml", ".json", ".xml", ".txt", ".xcp", ".yml", ".yaml", ".npz", ".mat", ".pickle", ".pkl")
_MOST_FILES = 50
# how far apart cameras are, from a macro rig on a table to a stadium: outside it the unit is wrong rather
# than the rig unusual; and on a table or in a room: a unit that alone puts them so far apart is likely
_PLAUSIBLE_MM, _USUAL_MM = (50.0, 100_000.0), (100.0, 15_000.0)


def read_calibration(
    path: str | os.PathLike[str],
    *,
    unit: str | None = None,
    format: str | None = None,
    camera_type: str | None = None,
    subject: str | None = None,
    size: Size | Mapping[str, Size] | None = None,
    binning: float | None = None,
    without: Collection[str] = (),
) -> sk.CameraRig:
    """Read a calibration into a rig, cameras in the order of the file.

    Parameters
    ----------
    path : path
        The calibration file, the folder where a format is one, or a folder with one calibration.
    unit : "mm", "cm" or "m"
        The length unit of the file's translations. It must be given for the formats that do not say it:
        ``anipose`` (unless this package wrote the file), ``easymocap``, ``4d-association``, ``colmap``,
        ``matrices`` and ``opencv-stereo``. For the others it may be left out; one that contradicts the format
        is an error.
    format : str, optional
        A key of `FORMATS`; found from the content when left out.
    camera_type : str, optional
        Which cameras of a file with several kinds: for Panoptic ``"hd"`` (default), ``"vga"``, …; for
        Qualisys and Vicon the video cameras (default); ``"all"``.
    subject : str, optional
        Human3.6M: whose extrinsics, such as ``"S9"``.
    size : (width, height) or mapping from camera name to it, optional
        Size of the images, for formats that do not say it, such as OpenPose's.
    binning : float, optional
        Qualisys: sensor pixels per image pixel, where videos have fewer lines than the sensor.
    without : collection of str
        Names of cameras that nobody needs, written as loosely as those of detections: if the file cannot be
        read with them, it is read without, with a note.

    Returns
    -------
    CameraRig
        Its lengths are in `unit`, or in the format's. What was assumed, and cameras less than 5 cm or more
        than 100 m apart, are a `UserWarning`.

    Raises
    ------
    InvalidInputError
        If `unit` is missing (the message names the likely one) or contradicts the format, or an option is
        unknown, does not go with the format or is missing.
    DatasetError
        If the file is missing or malformed; names file and field.
    """
    options = {"camera_type": camera_type, "subject": subject, "size": size, "binning": binning}
    # a number beyond all others is refused with its camera
    with within_memory(Path(path)), np.errstate(over="ignore", invalid="ignore"):
        source, chosen = _find(Source(path), format)
        _check_options(chosen, options)
        try:
            rig, stated = _parsed(source, chosen, options)
        except (DatasetError, InvalidInputError):
            if not without:
                raise
            source = Source(source.path, lambda name: any(reads_alike(name, text) for text in without))
            rig, stated = _parsed(source, chosen, options)
            names = tuple(dict.fromkeys(source.skipped))
            words = f"{source.path}: {', '.join(names)}: cannot be read, left out."
            whom = Subject(cameras=names, files=(str(source.path),))
            warn(Finding("calibration_read_as", "note", whom, {"unread": True}, sentence=words))
    return replace(rig, unit=_checked_unit(source.path, rig, unit, stated))


def _parsed(
    source: Source, chosen: CalibrationFormat, options: Mapping[str, Any]
) -> tuple[sk.CameraRig, str | None]:
    """Return the cameras of a source, lengths as in the file, and the unit if it is stated."""
    parsed, stated = chosen.parse(source, **{key: options[key] for key in chosen.options if key != "size"})
    if not 0 < len(parsed) <= MOST_CAMERAS:
        raise DatasetError(source.path, "cameras", f"1 to {MOST_CAMERAS} cameras", f"{len(parsed)}")
    for raw in parsed:
        if not raw.name.strip() or len(raw.name) > MOST_NAME:
            raise DatasetError(source.path, "name", f"names of 1 to {MOST_NAME} characters", raw.name[:40])
    sizes = [_size(source.path, raw, options["size"]) for raw in parsed]
    try:
        clocks = {raw.name: raw.clock for raw in parsed}
        of_rig = ("clock", "joint_sigma")
        bare = [{name: value for name, value in vars(raw).items() if name not in of_rig} for raw in parsed]
        cameras = [sk.Camera(**{**one, "size": wh}) for one, wh in zip(bare, sizes, strict=True)]
        return sk.CameraRig(cameras, clocks=clocks, joint_sigma=parsed[0].joint_sigma), stated
    except InvalidInputError as error:
        raise DatasetError.of_argument(source.path, error) from error


def find_format(path: str | os.PathLike[str]) -> str | None:
    """Return the key of the format that a file or folder has; None if it is no calibration.

    A broken file and a folder with several calibrations are a `DatasetError`.
    """
    found = _found(Source(path), None)
    return None if found is None else found[1].name


def _find(source: Source, name: str | None) -> tuple[Source, CalibrationFormat]:
    """Return the calibration, in a folder or not, and its format."""
    one_of("format", name, (None, *sorted(FORMATS)))
    found = _found(source, name)
    if found is None:
        from skelsplat.io._kinds import seems  # which imports this module

        if not source.is_folder:
            with opened(source.path):  # of a binary one nothing was read yet
                pass
        actual = seems(source.path) or ("a folder without one" if source.is_folder else "something else")
        expected = f"a calibration in a known format ({', '.join(sorted(FORMATS))})"
        raise DatasetError(source.path, "content", expected, actual)
    return found


def _found(source: Source, name: str | None) -> tuple[Source, CalibrationFormat] | None:
    """Return a source in a format, or the only file of a folder that is one; a named format is believed.

    In a folder a broken file is passed over; so is a folder with so many files that they are detections.
    """
    named = None if name is None else (source, FORMATS[name])
    form = _recognised(source) if named is None or source.is_folder else None
    if form is not None:
        return named or (source, form)
    files = [Source(path) for path in source.files if path.suffix.lower() in _SUFFIXES]
    inside = []
    for file in files if len(files) <= _MOST_FILES else []:
        with suppress(DatasetError):
            form = _recognised(file)
            if form is not None and name in (None, form.name):
                inside.append((file, form))
    if len(inside) > 1:
        names = ", ".join(file.path.name for file, _ in inside)
        raise DatasetError(source.path, "content", "a folder with one calibration, or the file itself", names)
    return inside[0] if inside else named


def _recognised(source: Source) -> CalibrationFormat | None:
    return next((known for known in FORMATS.values() if known.matches(source)), None)


def _check_options(chosen: CalibrationFormat, options: Mapping[str, Any]) -> None:
    for name, value in options.items():
        if value is not None and name not in chosen.options:
            shown = size_text(value) if isinstance(value, tuple) else repr(value)
            raise InvalidInputError(f"{name}: expected none for {chosen.name} files, got {shown}")
    binning = options["binning"]
    if binning is not None and not (np.isfinite(binning) and binning >= 1.0):
        raise InvalidInputError(f"binning: expected a number of at least 1, got {binning!r}")


def _size(path: Path, camera: RawCamera, given: Size | Mapping[str, Size] | None) -> Size:
    """Return the size of a camera's images, which is in the file or else given."""
    if isinstance(given, Mapping):
        given = given.get(camera.name)
    if camera.size is None and given is None:
        expected = f"the width and height of the images of camera {camera.name!r}"
        raise InvalidInputError(f"size: expected {expected}, because {path} does not contain it, got none")
    if given is not None and camera.size is not None and camera.size != tuple(given):
        expected = f"none or {size_text(camera.size)}, the size of camera {camera.name!r} in {path}"
        raise InvalidInputError(f"size: expected {expected}, got {size_text(given)}")
    return camera.size or given  # type: ignore[return-value]


def _checked_unit(path: Path, rig: sk.CameraRig, unit: str | None, stated: str | None) -> str:
    """Return the unit, given or `stated` by the file; warn if the cameras' spread makes it implausible."""
    centres = np.stack([camera.centre for camera in rig])
    spread = max(float(np.linalg.norm(centre - centres, axis=-1).max()) for centre in centres)
    if stated is not None and unit not in (None, stated):
        raise InvalidInputError(f'unit: expected none or "{stated}", the unit of {path}, got {unit!r}')
    unit = stated or unit
    if unit is None:
        raise InvalidInputError(f'unit: expected "mm", "cm" or "m" for {path}, got none; {_hint(spread)}')
    one_of("unit", unit, MM_PER_UNIT)
    mm = spread * MM_PER_UNIT[unit]
    if spread > 0.0 and not _PLAUSIBLE_MM[0] <= mm <= _PLAUSIBLE_MM[1]:
        numbers = {"metres": mm / 1000.0, "unit": unit, "spread": spread, "hint": _hint(spread)}
        words = f"{path}: unit: if it is {unit}, the cameras are {metric(mm)} apart; {numbers['hint']}"
        remedy = tuple(Remedy("unit", name) for name in _usual(spread) if stated is None)
        warn(Finding("unit_wrong", "warning", Subject(files=(str(path),)), numbers, remedy, sentence=words))
    return unit


def _hint(spread: float) -> str:
    """Return which unit is likely, if only one is, and what each would mean."""
    if spread == 0.0:
        return "one camera gives no hint of it"
    usual = _usual(spread)
    mm = {name: metric(spread * MM_PER_UNIT[name]) for name in usual or MM_PER_UNIT}
    meanings = " or ".join(f'{far} in "{name}"' for name, far in mm.items())
    so = f'so "{usual[0]}" is likely' if len(usual) == 1 else f"that is {meanings}"
    return f"the largest distance between cameras is {spread:.4g} in the file, {so}"


def _usual(spread: float) -> list[str]:
    """Return the units in which cameras so far apart would be on a table or in a room."""
    return [name for name, mm in MM_PER_UNIT.items() if _USUAL_MM[0] <= spread * mm <= _USUAL_MM[1]]


def convert_unit(rig: sk.CameraRig, unit: str) -> sk.CameraRig:
    """Return the same cameras with lengths in another unit: mm, cm or m."""
    one_of("unit", unit, MM_PER_UNIT)
    factor = rig.mm_per_unit / MM_PER_UNIT[unit]
    cameras = [altered(one, t=np.asarray(one.t) * factor) for one in rig]
    return replace(rig, cameras=cameras, unit=unit, joint_sigma=factor * rig.joint_sigma)


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
        Where the cameras come from: a comment in TOML; ``"note"`` in JSON and npz. It is not read again.
    adjusted : bool
        In TOML, states that detections of a recording adjusted these cameras, so that Anipose does not.
    """
    suffix = Path(path).suffix.lower()
    chosen = WRITTEN.get(suffix) if format is None else format
    if chosen not in WRITTEN.values():
        expected = f"one of {', '.join(WRITTEN.values())}, or a path in {', '.join(WRITTEN)}"
        raise InvalidInputError(f"format: expected {expected}, got {format or suffix or 'no suffix'!r}")
    if chosen == "npz":
        noted: dict[str, Any] = {} if note is None else {"note": np.array(note)}
        with atomic_write(path) as stream:
            np.savez(stream, **_json.to_arrays(rig), **noted)
    else:
        text = _json.to_json(rig, note) if chosen == "json" else _toml.to_toml(rig, note, adjusted=adjusted)
        atomic_write_text(path, text)

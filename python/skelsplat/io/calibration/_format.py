"""What a calibration format is: how its files are opened, into what they are parsed, what entries share."""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeAlias

import numpy as np

from skelsplat._arrays import Array
from skelsplat._atomic import opening
from skelsplat._budget import check_document, parse_toml, read_text
from skelsplat._fields import Field
from skelsplat.cameras import matrix_from_vector
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding, Subject, warn
from skelsplat.io._files import load_json

_PINHOLE_COUNTS = (4, 5, 8, 12, 14)
_FISHEYE_COUNT = 4
_GOOD_FIT_PX = 0.1  # a lens that is followed this well is lost in any detector's noise
_MOST_RADIANS = 4 * np.pi  # optimisers pass a turn, but not two
_BINARY = (".npz", ".npy", ".pickle", ".pkl", ".h5", ".mat")


@dataclass(frozen=True)
class RawCamera:
    """One camera as its file gives it, lengths in the file's unit."""

    name: str
    K: Array  # (3, 3) pixels
    R: Array  # (3, 3) world → camera, to the digits of the file
    t: Array  # (3,) world → camera
    distortion: Array | None = None  # (n,) in OpenCV's order
    size: tuple[int, int] | None = None  # width and height in pixels; None if the format has no place for it
    fisheye: bool = False


Parsed: TypeAlias = tuple[Sequence[RawCamera], str | None]
"""The cameras of a file, and their unit (mm, cm or m) if format or file says it."""


@dataclass(frozen=True)
class CalibrationFormat:
    """A format: `matches` looks at a source, `parse` turns it into cameras and warns of what it assumes.

    `about` says what writes it, `unit` the unit of its lengths, "" if the file does not say it. `options`
    names the arguments of `read_calibration` that it takes; any other that is given is refused. `parse` gets
    them by name, but for `size`, which is the same for all formats.
    """

    name: str
    about: str
    unit: str
    matches: Callable[[Source], bool]
    parse: Callable[..., Parsed]
    options: tuple[str, ...] = ()


class Source:
    """One path; its text and what the text parses to are read once, when they are first asked for."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self.is_folder = self.path.is_dir()
        self.suffix = self.path.suffix.lower()

    @cached_property
    def files(self) -> list[Path]:
        """The files of a folder by name, hidden ones left out; empty for a file."""
        if not self.is_folder:
            return []
        with opening(self.path, "a readable folder", "folder"):
            return sorted(p for p in self.path.iterdir() if p.is_file() and not p.name.startswith("."))

    @cached_property
    def text(self) -> str:
        """The file as text; empty for a folder and for files that are binary by their suffix."""
        return "" if self.is_folder or self.suffix in _BINARY else read_text(self.path)

    @cached_property
    def start(self) -> str:
        """The first 4096 characters without leading blanks."""
        return self.text.lstrip()[:4096]

    @cached_property
    def json(self) -> Field:
        """The JSON object; None as its value if the text does not begin like one."""
        begins = self.start.startswith("{") and self.suffix != ".toml"
        return Field(self.path, "", load_json(self.path, "a calibration", self.text) if begins else None)

    @cached_property
    def xml(self) -> ET.Element | None:
        """The root of the XML document; None if the text does not begin like one."""
        if not self.start.startswith("<"):
            return None
        check_document(self.path, self.text)
        if "<!DOCTYPE" in self.text:  # an entity can stand for gigabytes
            raise DatasetError(self.path, "XML", "a document without a DOCTYPE", "one with it")
        try:
            return ET.fromstring(self.text)
        except ET.ParseError as error:
            raise DatasetError(self.path, "XML", "a well-formed XML document", str(error)) from error

    @cached_property
    def toml(self) -> Field:
        """The TOML document, or `DatasetError`."""
        return Field(self.path, "", parse_toml(self.path, self.text))


def camera_of(
    entry: Field,
    name: str | None = None,
    *,
    K: str = "K",
    R: str | Array = "R",
    t: str = "t",
    lens: str | None = None,
    size: str | None = None,
    fisheye: bool = False,
) -> RawCamera:
    """Return the camera of an entry, under these names; a rotation may be given as a matrix."""
    return RawCamera(
        name=entry["name"].text() if name is None else name,
        K=entry[K].numbers((3, 3)),
        R=entry[R].numbers((3, 3)) if isinstance(R, str) else R,
        t=entry[t].numbers((3,)),
        distortion=None if lens is None else lens_of(entry[lens], fisheye=fisheye),
        size=None if size is None else entry[size].size(),
        fisheye=fisheye,
    )


def lens_of(field: Field, *, fisheye: bool = False) -> Array | None:
    """Return lens coefficients in a number that OpenCV has; None if the file says null."""
    if field.is_missing:  # a misspelt key must not pass for a camera without a lens
        raise field.error("lens coefficients, zeros for no lens", "none")
    if field.value is None:
        return None
    values = field.numbers(None)
    # FreeMoCap pads the four fisheye coefficients with a zero
    if fisheye and values.size == _FISHEYE_COUNT + 1 and values[-1] == 0.0:
        values = values[:_FISHEYE_COUNT]
    counts = (_FISHEYE_COUNT,) if fisheye else _PINHOLE_COUNTS
    if values.size not in counts:
        expected = f"{' or '.join(map(str, counts))} {'fisheye' if fisheye else 'lens'} coefficients"
        raise field.error(expected, f"{values.size} of them")
    return values


def matrix_of(fx: float, fy: float, cx: float, cy: float) -> Array:
    """Return K (3, 3) of focal lengths and principal point, pixels."""
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def rotation_of(field: Field) -> Array:
    """Return the rotation that a field holds as a matrix, by rows, or as a vector (Rodrigues, radians)."""
    value = field.value
    rows = value if isinstance(value, list) and len(value) > 1 else []
    if len(rows) == 9:
        return field.numbers((9,)).reshape(3, 3)
    if any(isinstance(row, list) and len(row) > 1 for row in rows):
        return field.numbers((3, 3))
    vector = field.numbers((3,))
    if math.hypot(*vector) > _MOST_RADIANS:
        expected = f"a rotation vector in radians, of a length of at most {_MOST_RADIANS:.3g}"
        raise field.error(expected, f"{field.shown}, as in degrees")
    return matrix_from_vector(vector)


def cameras_of(path: Path, names: Sequence[str]) -> Subject:
    """Return cameras of a file, as what a finding concerns."""
    return Subject(cameras=tuple(names), files=(str(path),))


def warn_of_no_lens(path: Path, names: Sequence[str]) -> None:
    """Warn that a file has no lens coefficients for these cameras, if there are any."""
    words = f"{path}: no distortions for {', '.join(names)}: assumed to have no lens distortion."
    if names:
        warn(Finding("lens_assumed", "note", cameras_of(path, names), sentence=words))


def warn_of_fit(path: Path, errors: dict[str, float], how: str) -> None:
    """Warn that lenses or skew of cameras are followed with errors in px, largest in the corners."""
    names = [name for name, error in errors.items() if error > _GOOD_FIT_PX]
    worst = max(errors.values(), default=0.0)
    words = f"{path}: {', '.join(names)}: {how} to {worst:.2g} px at worst."
    if names:
        warn(Finding("lens_assumed", "note", cameras_of(path, names), {"error_px": worst}, sentence=words))

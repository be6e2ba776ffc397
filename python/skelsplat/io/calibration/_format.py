"""What a calibration format is: how its files are opened, into what they are parsed, what entries share."""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat._atomic import opening
from skelsplat._budget import check_depth, check_document, parse_toml, read_text
from skelsplat.cameras import matrix_from_vector
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding, Subject
from skelsplat.io._fields import Field
from skelsplat.io._files import load_json

PINHOLE_COUNTS = (4, 5, 8, 12, 14)
_FISHEYE_COUNT = 4
_MOST_PIXELS = 2**31 - 1
GOOD_FIT_PX = 0.1
"""A lens that is followed this well is lost in any detector's noise."""
_MOST_RADIANS = 4 * np.pi  # optimisers pass a turn, but not two
_BINARY = (".npz", ".npy", ".pickle", ".pkl", ".h5", ".mat")


@dataclass(frozen=True)
class RawCamera:
    """One camera as its file gives it, lengths in the file's unit."""

    name: str
    K: Array  # (3, 3) pixels
    R: Array  # (3, 3) world → camera, to the digits of the file
    t: Array  # (3,) world → camera
    distortion: Array | None  # (n,) in OpenCV's order
    size: tuple[int, int] | None  # width and height in pixels; None if the format has no place for it
    fisheye: bool = False


@dataclass(frozen=True)
class Parsed:
    """The cameras of a file, their unit (mm, cm or m) if format or file says it, and what to warn of."""

    cameras: Sequence[RawCamera]
    unit: str | None = None
    findings: Sequence[Finding] = ()


def cameras_of(path: Path, names: Sequence[str]) -> Subject:
    """Return cameras of a file, as what a finding concerns."""
    return Subject(cameras=tuple(names), files=(str(path),))


def approximated(path: Path, names: Sequence[str], error_px: float, how: str) -> Finding:
    """Return the note that lenses or skew of cameras are followed with an error, largest in the corners."""
    words = f"{path}: {', '.join(names)}: {how} to {error_px:.2g} px at worst."
    return Finding("lens_assumed", "note", cameras_of(path, names), {"error_px": error_px}, sentence=words)


def lens_assumed(path: Path, names: Sequence[str]) -> Finding:
    """Return the note that a file has no lens coefficients for some cameras."""
    words = f"{path}: no distortions for {', '.join(names)}: assumed to have no lens distortion."
    return Finding("lens_assumed", "note", cameras_of(path, names), sentence=words)


@dataclass(frozen=True)
class CalibrationFormat:
    """A format: `matches` looks at a source, `parse` turns it into at least one camera.

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

    @property
    def suffix(self) -> str:
        """The last suffix in lower case, such as ``".json"``."""
        return self.path.suffix.lower()

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
        """The JSON document; None as its value if the text does not begin like one."""
        begins = self.start.startswith(("{", "[")) and self.suffix != ".toml"
        if not begins or _is_toml_header(self.start):
            return Field(self.path, "", None)
        return Field(self.path, "", load_json(self.path, "a calibration", self.text))

    @cached_property
    def xml(self) -> ET.Element | None:
        """The root of the XML document; None if the text does not begin like one."""
        if not self.start.startswith("<"):
            return None
        check_document(self.path, self.text)
        if "<!DOCTYPE" in self.text:  # an entity can stand for gigabytes
            raise DatasetError(self.path, "XML", "a document without a DOCTYPE", "one with it")
        try:
            root = ET.fromstring(self.text)
        except ET.ParseError as error:
            raise DatasetError(self.path, "XML", "a well-formed XML document", str(error)) from error
        check_depth(self.path, "XML", root)
        return root

    @cached_property
    def toml(self) -> dict[str, Any]:
        """The TOML document, or `DatasetError`."""
        return parse_toml(self.path, self.text)


def _is_toml_header(start: str) -> bool:
    """Whether a text that begins with ``[`` begins with a table's name, not with a list's first value."""
    line = start.partition("\n")[0].partition("#")[0].strip()
    inside = line.removeprefix("[").removesuffix("]").strip()
    return line.startswith("[") and line.endswith("]") and inside[:1].isalpha()


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
        size=None if size is None else size_of(entry[size]),
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
    counts = (_FISHEYE_COUNT,) if fisheye else PINHOLE_COUNTS
    if values.size not in counts:
        expected = f"{' or '.join(map(str, counts))} {'fisheye' if fisheye else 'lens'} coefficients"
        raise field.error(expected, f"{values.size} of them")
    return values


def rotation_of(field: Field) -> Array:
    """Return the rotation that a field holds as a matrix or as a vector (Rodrigues, radians)."""
    value = field.value
    rows = value if isinstance(value, list) and len(value) > 1 else []
    if len(rows) == 9 or any(isinstance(row, list) and len(row) > 1 for row in rows):
        return field.numbers((3, 3))
    return rotation_matrix(field)


def rotation_matrix(field: Field) -> Array:
    """Return the rotation that a field holds as a vector, radians."""
    vector = field.numbers((3,))
    if math.hypot(*vector) > _MOST_RADIANS:
        expected = f"a rotation vector in radians, of a length of at most {_MOST_RADIANS:.3g}"
        raise field.error(expected, f"{field.shown}, as in degrees")
    return matrix_from_vector(vector)


def size_of(field: Field) -> tuple[int, int]:
    """Return a positive whole width and height."""
    size = whole_size(*field.numbers((2,)))
    if size is None:
        raise field.error("a positive whole width and height in pixels", field.shown)
    return size


def whole_size(width: float, height: float) -> tuple[int, int] | None:
    """Return a width and height that are positive, whole and those of some image; else None."""
    if not all(1 <= length <= _MOST_PIXELS and float(length).is_integer() for length in (width, height)):
        return None
    return int(width), int(height)

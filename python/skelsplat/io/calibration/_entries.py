"""What the entries of cameras have in common in different formats, and attributes of XML elements."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io._fields import Field
from skelsplat.io.calibration._format import Array, RawCamera

PINHOLE_COUNTS = (4, 5, 8, 12, 14)
_FISHEYE_COUNT = 4
_MOST_PIXELS = 2**31 - 1


def camera_of(entry: Field, *, distortion: str, size: str, fisheye: bool = False) -> RawCamera:
    """Return the camera of an entry with ``name``, ``K``, ``R``, ``t``, and these names for the rest."""
    return RawCamera(
        name=entry["name"].text(),
        K=entry["K"].numbers((3, 3)),
        R=entry["R"].numbers((3, 3)),
        t=entry["t"].numbers((3,)),
        distortion=lens_of(entry[distortion], fisheye=fisheye),
        size=size_of(entry[size]),
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


@dataclass(frozen=True)
class Element:
    """An XML element; `place` names it in messages."""

    path: Path
    place: str
    node: ET.Element

    def error(self, name: str, expected: str, actual: object) -> DatasetError:
        """Return the error for one of its attributes or children."""
        return DatasetError(self.path, f"{self.place}.{name}", expected, actual)

    def child(self, tag: str) -> Element:
        """Return the first element of that name beneath it."""
        found = self.node.find(tag)
        if found is None:
            raise self.error(tag, f"an element <{tag.rpartition('/')[2]}>", "none")
        return Element(self.path, f"{self.place}.{tag}", found)

    def text(self, name: str) -> str:
        """Return an attribute that must be there."""
        value = self.node.get(name)
        if value is None:
            raise self.error(name, "an attribute", "nothing (it is missing)")
        return value

    def numbers(self, name: str, count: int) -> Array:
        """Return `count` finite numbers of an attribute, separated by blanks."""
        text = self.text(name)
        try:
            values = np.array([float(part) for part in text.split()])
        except ValueError:
            values = np.empty(0)
        if values.size != count or not np.isfinite(values).all():
            raise self.error(name, "a finite number" if count == 1 else f"{count} finite numbers", repr(text))
        return values

    def number(self, name: str) -> float:
        """Return the one finite number of an attribute."""
        return float(self.numbers(name, 1)[0])

"""One camera's entry in a file, read field by field, with an error that names file and field."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io.calibration._raw import RawCamera

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

PINHOLE_COUNTS = (4, 5, 8, 12, 14)
FISHEYE_COUNT = 4
_MOST_PIXELS = 2**31 - 1
_MISSING = "nothing (the key is missing)"


@dataclass(frozen=True)
class Entry:
    """A mapping in a file: `key` says where it stands, `values` what is in it."""

    path: Path
    key: str
    values: Mapping[str, Any]

    def error(self, field: str, expected: str, actual: object) -> DatasetError:
        """Return the error for one field; an empty one is the entry itself."""
        return DatasetError(self.path, ".".join(filter(None, (self.key, field))), expected, actual)

    def camera(self, *, distortion: str, size: str, fisheye: bool = False) -> RawCamera:
        """Return the camera of an entry with ``name``, ``K``, ``R``, ``t``, and these names for the rest."""
        return RawCamera(
            table=self.key,
            name=self.text("name"),
            K=self.numbers("K", (3, 3)),
            R=self.numbers("R", (3, 3)),
            t=self.numbers("t", (3,)),
            distortion=self.distortion(distortion, fisheye=fisheye),
            fisheye=fisheye,
            size=self.size(size),
        )

    def entry(self, field: str) -> Entry:
        """Return the mapping under `field`."""
        value = self.values.get(field)
        if not isinstance(value, dict):
            raise self.error(field, "a table of fields", _MISSING if value is None else _short(value))
        return Entry(self.path, ".".join(filter(None, (self.key, field))), value)

    def text(self, field: str) -> str:
        """Return the text (or whole number, as text) under `field`."""
        value = self.values.get(field)
        if isinstance(value, bool) or not isinstance(value, str | int) or value == "":
            raise self.error(field, "a text", _MISSING if value is None else _short(value))
        return str(value)

    def numbers(self, field: str, shape: tuple[int, ...] | None) -> Array:
        """Return the finite numbers under `field`.

        `shape` None is a list of any length. A column (n×1) or a row (1×n) will do for n numbers: several
        formats write vectors so.
        """
        expected = "a list of numbers" if shape is None else f"{'×'.join(map(str, shape))} numbers"
        if field not in self.values:
            raise self.error(field, expected, _MISSING)
        value = self.values[field]
        if not _is_numeric(value):
            raise self.error(field, expected, _short(value))
        try:
            array = np.asarray(value, dtype=np.float64)
        except ValueError:
            raise self.error(field, expected, "lists of different lengths") from None
        except OverflowError:  # TOML's whole numbers have no limit
            raise self.error(field, "finite numbers", _short(value)) from None
        if (shape is None or len(shape) == 1) and array.ndim == 2 and 1 in array.shape:
            array = array.ravel()
        if array.ndim != 1 if shape is None else array.shape != shape:
            raise self.error(field, expected, f"shape {'×'.join(map(str, array.shape)) or 'scalar'}")
        if not np.isfinite(array).all():
            raise self.error(field, "finite numbers", _short(value))
        return array

    def number(self, field: str) -> float:
        """Return the one finite number under `field`."""
        value = self.values.get(field)
        if isinstance(value, bool) or not isinstance(value, int | float) or not _is_finite(value):
            raise self.error(field, "a finite number", _MISSING if value is None else _short(value))
        return float(value)

    def flag(self, field: str) -> bool:
        """Return true or false; false if the field is missing."""
        value = self.values.get(field, False)
        if not isinstance(value, bool):
            raise self.error(field, "true or false", _short(value))
        return value

    def distortion(self, field: str, *, fisheye: bool = False) -> Array | None:
        """Return lens coefficients in a number that OpenCV has; None if the file says null."""
        if field not in self.values:  # a misspelt key must not pass for a camera without a lens
            raise self.error(field, "lens coefficients, zeros for no lens", "none")
        if self.values[field] is None:
            return None
        values = self.numbers(field, None)
        # FreeMoCap pads the four fisheye coefficients with a zero
        if fisheye and values.size == FISHEYE_COUNT + 1 and values[-1] == 0.0:
            values = values[:FISHEYE_COUNT]
        counts = (FISHEYE_COUNT,) if fisheye else PINHOLE_COUNTS
        if values.size not in counts:
            kind = "fisheye" if fisheye else "lens"
            raise self.error(
                field, f"{' or '.join(map(str, counts))} {kind} coefficients", f"{values.size} of them"
            )
        return values

    def size(self, field: str) -> tuple[int, int]:
        """Return a positive whole width and height."""
        width, height = self.numbers(field, (2,))
        if (
            min(width, height) < 1
            or max(width, height) > _MOST_PIXELS
            or not (width.is_integer() and height.is_integer())
        ):
            expected = "a positive whole width and height in pixels"
            raise self.error(field, expected, _short(self.values[field]))
        return int(width), int(height)


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _is_finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond any float
        return False


def _is_numeric(value: object) -> bool:
    """Whether `value` is a list whose leaves are all numbers (true and false are not)."""
    if isinstance(value, list):
        return all(_is_numeric(item) for item in value)
    return isinstance(value, int | float) and not isinstance(value, bool)

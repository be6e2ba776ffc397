"""A value in a file and its place there, checked as it is taken."""

from __future__ import annotations

import math
import sys
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat.exceptions import DatasetError, did_you_mean

FRAME_LIMIT = 2**62
"""Frame numbers and offsets are below it, so that their sum fits into 64 bits."""
_MOST_PIXELS = 2**31 - 1
_ABSENT = object()
_MISSING = "nothing (the key is missing)"


@dataclass(frozen=True)
class Field:
    """A value and where it stands, such as ``cameras[0].K``; at the top of a document `place` is empty.

    What takes the value as something raises `DatasetError` if it is something else, or its key is missing.
    """

    path: Path
    place: str
    value: Any

    def error(self, expected: object, actual: object) -> DatasetError:
        """Return the error for this value."""
        return DatasetError(self.path, self.place or "file", expected, actual)

    @property
    def is_missing(self) -> bool:
        """Whether nothing is under this key."""
        return self.value is _ABSENT

    @property
    def shown(self) -> str:
        """The value for a message, cut if long."""
        text = _MISSING if self.is_missing else "null" if self.value is None else repr(self.value)
        return text if len(text) <= 60 else f"{text[:57]}..."

    def __contains__(self, key: str) -> bool:
        return isinstance(self.value, dict) and key in self.value

    def __getitem__(self, key: str) -> Field:
        """Return what is under a key; if nothing is, the field says so when its value is taken."""
        value = self.value.get(key, _ABSENT) if isinstance(self.value, dict) else _ABSENT
        return Field(self.path, f"{self.place}.{key}" if self.place else key, value)

    def member(self, key: str, expected: str) -> Field:
        """Return what is under a key that must be there."""
        if key not in self:
            raise self[key].error(expected, _MISSING)
        return self[key]

    def first(self, *keys: str) -> Field:
        """Return what is under the first of `keys` that is there, one of which must be."""
        for key in keys:
            if key in self:
                return self[key]
        there = ", ".join(map(str, self.table().value)) or "none"
        raise self[keys[0]].error(f"one of the keys {', '.join(keys)}", f"the keys {there}")

    def entries(self, expected: str = "a list") -> list[Field]:
        """Return the entries of a list, tuple or array."""
        is_array = isinstance(self.value, np.ndarray) and self.value.ndim > 0
        values = self.value if is_array or isinstance(self.value, tuple) else self._list(expected)
        return [Field(self.path, f"{self.place}[{i}]", value) for i, value in enumerate(values)]

    def members(self) -> dict[str, Field]:
        """Return what is in a table, by key."""
        return {key: self[key] for key in self.table().value}

    def table(self, keys: Collection[str] = ()) -> Field:
        """Return this field if it holds a table (an object), of no other keys than these if there are any."""
        if not isinstance(self.value, dict):
            raise self.error("a table of fields", self.shown)
        for key in self.value if keys else ():
            if key not in keys:
                actual = f"an unknown key{did_you_mean(key, keys)}"
                raise self[key].error(f"one of {', '.join(keys)}", actual)
        return self

    def text(self) -> str:
        """Return a text, or a whole number as text."""
        if isinstance(self.value, bool) or not isinstance(self.value, str | int) or self.value == "":
            raise self.error("a text", self.shown)
        return str(self.value)

    def flag(self) -> bool:
        """Return true or false; false if the key is missing."""
        if not self.is_missing and not isinstance(self.value, bool):
            raise self.error("true or false", self.shown)
        return self.value is True

    def number(self) -> float:
        """Return a finite number."""
        if not _is_number(self.value) or not abs(self.value) <= sys.float_info.max:
            raise self.error("a finite number", self.shown)
        return float(self.value)

    def index(self) -> int:
        """Return a frame number that is not negative."""
        value = self.value
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < FRAME_LIMIT:
            raise self.error("a whole number from 0, below 2^62", self.shown)
        return value

    def size(self) -> tuple[int, int]:
        """Return a positive whole width and height."""
        size = whole_size(*self.numbers((2,)))
        if size is None:
            raise self.error("a positive whole width and height in pixels", self.shown)
        return size

    def numbers(self, shape: tuple[int, ...] | None) -> Array:
        """Return finite numbers of this shape, or a list of any length for None.

        A column (n×1) or a row (1×n) will do for n numbers: several formats write vectors so.
        """
        expected = "a list of numbers" if shape is None else f"{'×'.join(map(str, shape))} numbers"
        if not _is_numeric(self.value):
            raise self.error(expected, self.shown)
        try:
            array = np.asarray(self.value, dtype=np.float64)
        except (ValueError, OverflowError):  # rows of different lengths; TOML's whole numbers have no limit
            raise self.error(expected, self.shown) from None
        if len(shape or (0,)) == 1 and array.ndim == 2 and 1 in array.shape:
            array = array.ravel()
        if array.ndim != 1 if shape is None else array.shape != shape:
            raise self.error(expected, f"{'×'.join(map(str, array.shape)) or 'one'} of them")
        if not np.isfinite(array).all():
            raise self.error("finite numbers", self.shown)
        return array

    def array(self) -> Array:
        """Return the value as a new array of float64, C order; None is NaN, which is a number here."""
        if self.is_missing or (isinstance(self.value, np.ndarray) and self.value.dtype.kind == "c"):
            raise self.error("real numbers", self.shown)
        try:
            with np.errstate(invalid="ignore"):  # of a NaN that signals
                return np.array(self.value, dtype=np.float64, order="C")
        except (TypeError, ValueError) as error:
            raise self.error("numbers in rows of the same length", error) from error

    def array_of(self, *shape: int | str) -> Array:
        """Return the value as an `array` with this shape: a letter stands for any length."""
        array = self.array()
        given = zip(shape, array.shape, strict=False)
        if array.ndim != len(shape) or any(isinstance(want, int) and want != got for want, got in given):
            raise self.error(f"shape ({', '.join(map(str, shape))})", array.shape)
        return array

    def names(self) -> list[str]:
        """Return the texts of a list."""
        values = self._list("a list of strings")
        if not all(isinstance(value, str) for value in values):
            raise self.error("a list of strings", self.shown)
        return values

    def row(self) -> Array:
        """Return a list of numbers (n,); NaN is a number here, infinity and text are not."""
        values = self._list("a list of numbers")
        for i, value in enumerate(values):  # a plain loop, since a recording has millions
            if isinstance(value, bool) or not isinstance(value, int | float) or math.isinf(value):
                raise DatasetError(self.path, f"{self.place}[{i}]", "a number", repr(value)[:40])
        return np.array(values, dtype=np.float64)

    def rows(self, width: int) -> Array:
        """Return a list of lists of `width` numbers each, (n, width), as `row` reads them."""
        parts = []
        for line in self.entries(f"a list of lists of {width} numbers"):
            parts.append(line.row())
            if len(parts[-1]) != width:
                raise line.error(f"{width} numbers", f"{len(parts[-1])} numbers")
        return np.array(parts, dtype=np.float64).reshape(-1, width)

    def _list(self, expected: str) -> list[Any]:
        if not isinstance(self.value, list):
            raise self.error(expected, _MISSING if self.is_missing else type(self.value).__name__)
        return self.value


def whole_size(width: float, height: float) -> tuple[int, int] | None:
    """Return a width and height that are positive, whole and those of some image; else None."""
    if not all(1 <= length <= _MOST_PIXELS and float(length).is_integer() for length in (width, height)):
        return None
    return int(width), int(height)


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_numeric(value: object) -> bool:
    """Whether `value` is a list whose leaves are all numbers (true and false are not)."""
    return all(map(_is_numeric, value)) if isinstance(value, list) else _is_number(value)

"""Arrays as users have them, as the package computes with them: one reading for the whole of it.

The compiled core reads its arguments through `numbers` too, so that a mask, a ``None`` or a string means the
same to every function.
"""

from __future__ import annotations

import sys
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat.exceptions import InvalidInputError

Array: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]
Index: TypeAlias = NDArray[np.int64]

FARTHEST = 1e30
"""Largest number in data that the core computes with."""

_FLOAT64 = np.dtype(np.float64)
# NumPy makes a float64 of these: it parses text, drops the imaginary part, drops the unit.
_NO_NUMBERS = (str, bytes, complex, np.complexfloating, np.datetime64, np.timedelta64)
_EXPECTED = "expected an array of numbers, got "
# Above it not every whole number is a double.
_EXACT = 2.0**53


def numbers(value: object, name: str) -> NDArray[np.float64]:
    """Return `value` as a C-ordered, aligned float64 array of this machine's byte order.

    It is `value` itself if that is one already, else a copy. Masked entries, ``None`` and ``pandas.NA``
    become NaN. Integers and booleans are numbers; text, complex numbers, times and records are not: an
    `InvalidInputError` that names the argument, `name`.
    """
    array = value if type(value) is np.ndarray and value.dtype is _FLOAT64 else _as_float64(value, name)
    if array.flags.c_contiguous and array.flags.aligned:
        return array
    return array.copy(order="C")


def pixels(value: object, name: str) -> NDArray[np.float64]:
    """Return detections (T, M, …) as `numbers` does; a view with coordinates from 0 to 1 is an error."""
    given = numbers(value, name)
    if given.ndim > 2:
        of_views = np.moveaxis(given[..., :2], 1, 0).reshape(given.shape[1], -1)
        largest = np.fmax.reduce(np.abs(of_views), axis=1, initial=0.0)
        if ((largest > 0.0) & (largest <= 1.0)).any():
            expected = "pixels; multiply them by the image's width and height"
            raise InvalidInputError(f"{name}: expected {expected}, got coordinates from 0 to 1")
    return given


def whole_numbers(value: object, name: str) -> NDArray[np.int64]:
    """Return `value` as int64; a masked entry, a missing one or a fraction is an `InvalidInputError`."""
    array = _read(value, name)
    if array.dtype.kind in "iu" and not np.ma.is_masked(array) and (array <= np.iinfo(np.int64).max).all():
        return np.asarray(array, dtype=np.int64)
    given = numbers(array, name)
    wrong = ~((np.abs(given) <= _EXACT) & (given == np.rint(given)))
    if wrong.any():
        raise InvalidInputError(f"{name}: expected whole numbers, got {given[wrong][0]:g}")
    return given.astype(np.int64)


def flags(value: object, name: str) -> NDArray[np.bool_]:
    """Return `value` as bool; an entry that is masked, missing or 2, say, is an `InvalidInputError`."""
    given = numbers(value, name)
    wrong = (given != 0.0) & (given != 1.0)
    if wrong.any():
        raise InvalidInputError(f"{name}: expected True or False everywhere, got {given[wrong][0]:g}")
    return np.asarray(given == 1.0)


def positive(name: str, value: float, kind: str = "number") -> None:
    """Raise `InvalidInputError` unless the argument ``name`` is a number, finite and above zero."""
    try:
        is_number = not isinstance(value, (bool, np.bool_)) and numbers(value, name).ndim == 0
        given = float(value) if is_number else float("nan")
    except (TypeError, ValueError, OverflowError):
        given = float("nan")
    if not (np.isfinite(given) and given > 0) or (kind == "integer" and given != int(given)):
        raise InvalidInputError(f"{name}: expected a positive {kind}, got {value!r:.80}")


def generator(seed: int | np.random.Generator) -> np.random.Generator:
    """Return the random numbers of the argument ``seed``, a generator itself or what NumPy makes one of."""
    try:
        return np.random.default_rng(seed)
    except (TypeError, ValueError) as error:
        expected = "a whole number of at least 0, or a generator"
        raise InvalidInputError(f"seed: expected {expected}, got {seed!r:.80}") from error


def median(values: NDArray[np.float64]) -> float:
    """Return the median of the finite values; NaN if there are none."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else float("nan")


def medians(values: NDArray[np.float64], least: int = 1) -> NDArray[np.float64]:
    """Return the medians of what is finite along the last axis; NaN for fewer than `least` numbers."""
    ordered = np.sort(values, axis=-1)  # NaN last
    count = np.isfinite(values).sum(axis=-1)
    last = np.maximum(count - 1, 0)[..., None]
    low, high = (np.take_along_axis(ordered, at, axis=-1)[..., 0] for at in (last // 2, (last + 1) // 2))
    return np.where(count >= max(least, 1), (low + high) / 2, np.nan)


def corners(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the ends (…, D) of the box round points (…, N, D): ∞ and −∞ where no number is finite."""
    there = np.isfinite(points)
    low = np.where(there, points, np.inf).min(axis=-2, initial=np.inf)
    return low, np.where(there, points, -np.inf).max(axis=-2, initial=-np.inf)


def body_sizes(pose: ArrayLike) -> NDArray[np.float64]:
    """Return the diagonals (T,) of the boxes around poses (T, K, 3), in their unit; 0 for nobody."""
    low, high = corners(np.asarray(pose, dtype=np.float64))
    sizes: Array = np.linalg.norm(np.where(low <= high, high - low, 0.0), axis=-1)
    return sizes


def extents(people: ArrayLike) -> NDArray[np.float64]:
    """Return the diagonals (…,) px of the boxes around people (…, K, 2|3); 0 for nobody."""
    return body_sizes(numbers(people, "people")[..., :2])


def largest_slots(people: NDArray[np.float64], owner: NDArray[Any], n_people: int) -> NDArray[np.int64]:
    """Return the place in P of each person, (Q, T, M), from owners (T, M, P) of detections (T, M, P, N, 3).

    −1 = not detected. Of two parts of a person it is the larger.
    """
    joints = np.isfinite(people[..., 0]).sum(axis=-1)
    own = (owner == np.arange(n_people)[:, None, None, None]) & (joints > 0)
    place: NDArray[np.int64] = np.where(own, joints, 0).argmax(axis=-1)
    return np.where(own.any(axis=-1), place, -1)


def take_people(people: NDArray[np.float64], index: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the detections (…, T, M, N, D) at the places (…, T, M) of people (T, M, P, N, D); NaN for -1."""
    frame, view = np.arange(index.shape[-2])[:, None], np.arange(index.shape[-1])
    return np.where((index >= 0)[..., None, None], people[frame, view, index], np.nan)


class ArrayFields:
    """A dataclass whose fields of the type `Array` hold what `numbers` makes of what they are given."""

    def __post_init__(self) -> None:
        for name, kind in type(self).__annotations__.items():
            value = getattr(self, name)
            if kind in ("Array", "Array | None") and value is not None:
                object.__setattr__(self, name, numbers(value, name))


def _read(value: object, name: str) -> NDArray[Any]:
    """Return what NumPy makes of `value`, of any type of numbers; a masked array stays one."""
    if value is None:
        raise InvalidInputError(f"{name}: {_EXPECTED}None")
    if isinstance(value, list | tuple) and _holds_masks(value):
        value = [numbers(item, name) for item in value]
    try:
        return np.asanyarray(value)
    except MemoryError:
        raise
    except Exception as error:  # an object's own __array__ may raise anything
        raise InvalidInputError(f"{name}: {_EXPECTED}{' '.join(str(error).split())}") from error


def _holds_masks(items: list[Any] | tuple[Any, ...]) -> bool:
    """Whether nested sequences hold a masked array, whose mask NumPy would drop."""
    return any(
        isinstance(item, np.ma.MaskedArray) or (isinstance(item, list | tuple) and _holds_masks(item))
        for item in items
    )


def _as_float64(value: object, name: str) -> NDArray[np.float64]:
    """Return an array of any type of numbers as float64, NaN where it is masked or missing."""
    array = _read(value, name)
    if isinstance(array, np.ma.MaskedArray) and array.dtype.names is None:
        there = ~np.ma.getmaskarray(array)
        filled = np.full(array.shape, np.nan)
        filled[there] = _as_float64(np.asarray(array.data)[there], name)
        return filled
    if array.dtype == object:
        return _of_objects(np.asarray(array), name)
    if not np.can_cast(array.dtype, np.float64, "same_kind"):
        words = {"c": "complex numbers", "S": "text", "U": "text", "T": "text", "V": "records"}
        called = words.get(array.dtype.kind, "an array")
        raise InvalidInputError(f"{name}: {_EXPECTED}{called} ({array.dtype})")
    return np.asarray(array, dtype=np.float64, order="C")


def _of_objects(array: NDArray[np.object_], name: str) -> NDArray[np.float64]:
    """Return an array of Python objects as float64, NaN where one is missing."""
    missing = getattr(sys.modules.get("pandas"), "NA", None)
    items = [np.nan if item is None or item is missing else item for item in array.ravel()]
    for kind in set(map(type, items)):
        if issubclass(kind, _NO_NUMBERS):
            raise InvalidInputError(f"{name}: {_EXPECTED}an object of type {kind.__name__}")
    try:
        return np.array(items, dtype=np.float64).reshape(array.shape)
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"{name}: {_EXPECTED}{error}") from error

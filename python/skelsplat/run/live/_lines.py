"""A line of the input: one frame's detections, as nested lists or by the names of the cameras."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat._budget import MOST_DEPTH, depth_of
from skelsplat._skelsplat import check_people

# more than any detector's score: probably a pixel coordinate
_NO_SCORE = 100.0
# characters of a value that a message shows
_SHOWN = 60
_MISSING = [float("nan")] * 3
_PLAIN = {float, int, type(None)}


class MalformedLineError(Exception):
    """A line that cannot be answered: what was expected in it, and what it has.

    Attributes
    ----------
    frame
        The line's "frame", if it could be read.
    """

    def __init__(self, message: str, frame: Any = None) -> None:
        super().__init__(message)
        self.frame = frame

    def line(self, number: int) -> bytes:
        """Return the answer to the line: an error object."""
        record = {"frame": self.frame, "line": number, "error": self.text}
        return f"{json.dumps(record)}\n".encode()

    @property
    def text(self) -> str:
        """The message on one line."""
        return " ".join(str(self).split())


class Line(NamedTuple):
    """One line of the input: the frame's name, its detections as given, and whether to forget the past."""

    name: Any
    detections: Any
    reset: bool


class View(NamedTuple):
    """One camera's detections as given (null: none), and what messages call them."""

    value: Any
    place: str


def parsed(text: bytes) -> Line:
    """Return what a line holds.

    Raises
    ------
    MalformedLineError
        If it is no JSON, or has no detections.
    """
    record = _record(text)
    line = Line(record.get("frame"), record.get("detections"), record.get("reset", False))
    if not isinstance(line.name, int | str | None):
        try:
            json.dumps([[[line.name]]], allow_nan=False)  # as deep as in the answer, and deeper
        except (ValueError, RecursionError) as error:
            raise MalformedLineError(f"frame: expected a value of JSON, got {line.name}") from error
    if "detections" not in record:
        got = f"the keys {', '.join(record)}" if record else "no keys"
        raise MalformedLineError(f'expected an object with "detections", got {got}', line.name)
    if not isinstance(line.reset, bool):
        raise MalformedLineError(f"reset: expected true or false, got {shown(line.reset)}", line.name)
    return line


def _record(text: bytes) -> dict[str, Any]:
    if not text.strip():
        raise MalformedLineError("expected JSON, got an empty line")
    if depth_of(text) > MOST_DEPTH:
        raise MalformedLineError(f"expected JSON, got lists nested too deeply (at most {MOST_DEPTH} deep)")
    try:
        record = json.loads(text.decode("utf-8-sig"))  # Windows begins a stream with its mark
    except json.JSONDecodeError as error:
        raise MalformedLineError(f"expected JSON, got a flaw at column {error.colno}: {error.msg}") from error
    except (ValueError, RecursionError) as error:
        raise MalformedLineError(f"expected JSON, got {error}") from error
    if not isinstance(record, dict):
        raise MalformedLineError(f'expected an object with "detections", got {shown(record)}')
    return record


def by_camera(value: Any, cameras: Sequence[str]) -> list[View]:
    """Return the views in the order of the cameras, given in that order or by name.

    Raises
    ------
    MalformedLineError
        If there is not one for each, or a name is unknown.
    """
    if isinstance(value, dict):
        for name in value:
            if name not in cameras:
                raise MalformedLineError(
                    f"detections: expected the cameras {', '.join(cameras)}, got {shown(name)}"
                )
        return [View(value.get(name), f"detections[{json.dumps(name)}]") for name in cameras]
    views = listed(value, len(cameras), "detections", "cameras")
    return [View(view, f"detections[{i}]") for i, view in enumerate(views)]


def points(people: Sequence[View], joints: int) -> Array:
    """Return the detections (K, N, 2|3) of K people, NaN where missing.

    Parameters
    ----------
    people
        Each person's joints, or null.
    joints : int
        N.

    Raises
    ------
    MalformedLineError
        If a person has another number of joints, a joint is neither numbers nor null, or a number is out of
        range.
    """
    array = _at_once([person.value for person in people], joints)
    if array is None:
        nested = [_one_by_one(person, joints) for person in people]
        array = np.array(nested, dtype=np.float64).reshape(len(people), joints, 3)
    if np.isinf(array).any():
        raise MalformedLineError("detections: expected numbers, got infinity")
    array[np.isnan(array).any(axis=-1), :2] = np.nan
    if array.shape[-1] == 3:
        scores = array[..., 2]
        scores[np.isnan(scores)] = 0.0
        scores[(scores > 1.0) & (scores < _NO_SCORE)] = 1.0  # the peak of a detector's map
    try:
        check_people(array[None, :, None])
    except sk.InvalidInputError as error:
        place, _, wrong = str(error).partition(": ")
        _, k, _, j, axis = re.findall(r"\d+", place)
        raise MalformedLineError(f"{people[int(k)].place}[{j}][{axis}]: {wrong}") from error
    return array


def _at_once(people: list[Any], joints: int) -> Array | None:
    """Return the points of people (K, N, 2|3) if they are numbers and nulls in that shape."""
    try:
        if not {len(person) for person in people if person is not None} <= {joints}:
            return None
        absent = [None] * joints
        nested = [
            _MISSING if point is None else point
            for person in people
            for point in (absent if person is None else person)
        ]
        widths = set(map(len, nested))
        flat = list(chain.from_iterable(nested))
        if widths not in ({2}, {3}) or not set(map(type, flat)) <= _PLAIN:
            return None
        return np.array(flat, dtype=np.float64).reshape(len(people), joints, widths.pop())
    except (TypeError, OverflowError):  # something else than a list; a whole number beyond any float
        return None


def _one_by_one(person: View, joints: int) -> list[list[float]]:
    """Return the points with a confidence each, and an error that names the first malformed one."""
    if person.value is None:
        return [_MISSING] * joints
    every = enumerate(listed(person.value, joints, person.place, "joints"))
    return [_MISSING if point is None else _point(point, f"{person.place}[{j}]") for j, point in every]


def listed(value: Any, count: int, place: str, what: str) -> Sequence[Any]:
    """Return ``value`` if it is a list of ``count`` entries.

    Raises
    ------
    MalformedLineError
        If it is not.
    """
    if not isinstance(value, list) or len(value) != count:
        got = len(value) if isinstance(value, list) else shown(value)
        if type(value) in (int, float):
            got = f"the number {got}"  # and not the length of a list
        raise MalformedLineError(f"{place}: expected a list of {count} {what}, got {got}")
    return value


def _point(value: Any, place: str) -> list[float]:
    """Return [x, y, confidence] with NaN for null; a point without a confidence has 1."""
    numbers = isinstance(value, list) and len(value) in (2, 3) and set(map(type, value)) <= _PLAIN
    if not numbers:
        raise MalformedLineError(f"{place}: expected [x, y, confidence] or null, got {shown(value)}")
    try:
        point = [float("nan") if number is None else float(number) for number in value]
    except OverflowError:  # a whole number beyond any float
        raise MalformedLineError(f"{place}: expected finite numbers, got {shown(value)}") from None
    return point if len(point) == 3 else [*point, 1.0]


def shown(value: Any) -> str:
    """Return a value as messages quote it."""
    try:
        text = json.dumps(value)
    except RecursionError:
        text = "nested lists"
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."

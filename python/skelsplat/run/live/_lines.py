"""A line of the input: one frame's detections, as nested lists or by the names of the cameras.

Every function raises `MalformedLineError`, which names the place in the line, if what it reads is malformed.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
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
    """Return what a line holds."""
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
    try:
        record = json.loads(text.decode("utf-8-sig"))  # Windows begins a stream with its mark
    except (ValueError, RecursionError) as error:
        raise MalformedLineError(f"expected JSON, got a flaw: {error}") from error
    if not isinstance(record, dict):
        raise MalformedLineError(f'expected an object with "detections", got {shown(record)}')
    return record


def by_camera(value: Any, cameras: Sequence[str]) -> list[View]:
    """Return the views in the order of the cameras, given in that order or by name."""
    if isinstance(value, dict):
        for name in value:
            if name not in cameras:
                raise MalformedLineError(
                    f"detections: expected the cameras {', '.join(cameras)}, got {shown(name)}"
                )
        return [View(value.get(name), f"detections[{json.dumps(name)}]") for name in cameras]
    views = _listed(value, len(cameras), "detections", "cameras")
    return [View(view, f"detections[{i}]") for i, view in enumerate(views)]


def one_person(views: Sequence[View], joints: int) -> Array:
    """Return the detections (M, N, 2|3) of one person, NaN where missing."""
    try:
        return _points(views, joints)
    except MalformedLineError:
        for value, place in views:
            if isinstance(value, list) and any(map(_is_person, value)) and not any(map(_is_point, value)):
                expected = "the joints of one person (people follows several)"
                raise MalformedLineError(f"{place}: expected {expected}, got {len(value)} people") from None
        raise


def several_people(views: Sequence[View], joints: int) -> Array:
    """Return the people (M, P, N, 2|3) of a line, NaN where a camera has fewer than P."""
    people = [_people_of(view) for view in views]
    found = _points([person for view in people for person in view], joints)
    counts = [len(view) for view in people]
    padded = np.full((len(views), max(counts), *found.shape[1:]), np.nan)
    padded[np.arange(max(counts)) < np.array(counts)[:, None]] = found
    return padded


def _people_of(view: View) -> list[View]:
    """Return the people of a view: those of a list, one alone, or none."""
    value = view.value
    if value is None:
        return []
    if not isinstance(value, list):
        expected = "a list of people, the joints of one, or null"
        raise MalformedLineError(f"{view.place}: expected {expected}, got {shown(value)}")
    if any(map(_is_person, value)):
        return [View(person, f"{view.place}[{k}]") for k, person in enumerate(value)]
    empty = all(entry is None or _is_nothing(entry) for entry in value)
    return [] if empty else [view]


def _is_person(value: Any) -> bool:
    """Tell whether an entry of a view is a person's joints, some of them detected, and not a joint."""
    return isinstance(value, list) and any(isinstance(joint, list) for joint in value)


def _is_point(value: Any) -> bool:
    """Tell whether an entry of a view is a detected joint."""
    return isinstance(value, list) and any(isinstance(number, int | float) for number in value)


def _is_nothing(entry: Any) -> bool:
    """Tell whether an entry is a person or a joint of nulls."""
    return isinstance(entry, list) and bool(entry) and all(number is None for number in entry)


def _points(people: Sequence[View], joints: int) -> Array:
    """Return the detections (K, N, 2|3) of K people, NaN where missing."""
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
    every = enumerate(_listed(person.value, joints, person.place, "joints"))
    return [_MISSING if point is None else _point(point, f"{person.place}[{j}]") for j, point in every]


def _listed(value: Any, count: int, place: str, what: str) -> Sequence[Any]:
    """Return ``value`` if it is a list of ``count`` entries."""
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

"""Poses over lines of JSON, in the form that ``live --help`` and docs/howto/live.md describe."""

from __future__ import annotations

import json
import re
import time
from collections import deque
from collections.abc import Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Mask
from skelsplat._skelsplat import REJECTED_WEIGHT, check_people
from skelsplat.io.poses._json import to_json

_NO_SCORE = 100.0  # more than any detector's score: probably a pixel coordinate
_SHOWN = 60  # characters of a value that a message shows
_MISSING = [float("nan")] * 3
_PLAIN = {float, int, type(None)}
_KEPT = 100_000  # latencies: an hour at 30 Hz


class MalformedLineError(Exception):
    """A line that cannot be answered: what was expected in it, and what it has."""

    def __init__(self, message: str, frame: Any = None) -> None:
        super().__init__(" ".join(message.split()))  # on one line
        self.frame = frame  # the line's "frame", if it could be read

    def line(self, number: int) -> bytes:
        """Return the answer to the line: an error object."""
        return f"{json.dumps({'frame': self.frame, 'line': number, 'error': str(self)})}\n".encode()


class Session:
    """A refiner over lines; with ``people``, "all" or so many at most, at ``fps``, a tracker.

    With a lag, a line that is not yet answered has ``{"waiting": frames}``, and one that resets the session
    first has the answers of the frames that wait.
    """

    def __init__(
        self,
        rig: sk.CameraRig,
        layout: sk.Layout,
        config: sk.RefineConfig,
        *,
        fps: float | None = None,
        lag: int = 0,
        people: str | int | None = None,
    ) -> None:
        self._cameras, self._joints, self._lag = rig.names, layout.n_joints, lag
        self._solved = self._skipped = 0
        self._begin = self._end = 0.0  # of the first answer and the last
        self._latencies: deque[float] = deque(maxlen=_KEPT)  # ms
        self._waiting: deque[Any] = deque()  # names of frames
        self._ids: tuple[int, ...] = ()
        self._tracker = None
        if people is None or fps is None:
            self._refiner = sk.Refiner(rig, layout=layout, fps=fps, lag=lag, config=config)
        else:
            most = None if people == "all" else int(people)
            self._tracker = sk.Tracker(rig, layout=layout, fps=fps, max_people=most, config=config)

    def answer(self, text: bytes) -> bytes:
        """Return the lines that the session owes after the line ``text``: one, or more where it resets.

        A `MalformedLineError` if the line is malformed: it is counted as skipped and changes nothing.
        """
        begin = time.perf_counter()
        name = None
        try:
            record = _record(text)
            name, reset = record.get("frame"), record.get("reset", False)
            views = _by_camera(record["detections"], self._cameras)
            if self._tracker is None:
                return self._of_one(name, _points(views, self._joints), reset, begin)
            return self._of_all(self._tracker, name, _people(views, self._joints), reset, begin)
        except (MalformedLineError, sk.SkelSplatError) as error:
            self._skipped += 1
            frame = error.frame if isinstance(error, MalformedLineError) and name is None else name
            raise MalformedLineError(str(error), frame) from error

    def rest(self) -> bytes:
        """Return the lines of the frames that wait for later ones, at the end of the input."""
        lines = []
        missing = np.full((len(self._cameras), self._joints, 2), np.nan)
        if self._waiting:
            for _ in range(self._lag - len(self._waiting)):  # fewer frames than the lag
                self._refiner.step(missing)
        while self._waiting:
            begin = time.perf_counter()
            lines.append(self._next(self._refiner.step(missing), begin))
        return b"".join(lines)

    def summary(self) -> str:
        """Return how many lines were solved and malformed, how fast, and percentiles of the latest."""
        lines = f"lines solved {self._solved}, malformed {self._skipped}"
        if not self._solved:
            return lines
        median, most, longest = np.percentile(self._latencies, (50, 99, 100))
        rate = self._solved / max(self._end - self._begin, 1e-9)
        latency = f"latency in ms: median {median:.3f}, 99% {most:.3f}, longest {longest:.3f}"
        return f"{lines}; {rate:.0f} per second; {latency}"

    def _of_one(self, name: Any, detections: Array, reset: bool, begin: float) -> bytes:
        before = b""
        if reset:
            before = self.rest()
            self._refiner.reset()
        result = self._refiner.step(detections)
        self._waiting.append(name)
        waiting = len(self._waiting)
        return before + (self._next(result, begin) if waiting > self._lag else b'{"waiting": %d}\n' % waiting)

    def _next(self, result: sk.Refinement, begin: float) -> bytes:
        return self._line({"frame": self._waiting.popleft(), **_person(result)}, begin)

    def _of_all(self, tracker: sk.Tracker, name: Any, people: Array, reset: bool, begin: float) -> bytes:
        if reset:
            tracker.reset()
        found = tracker.step(people)
        before, self._ids = self._ids, tracker.ids
        record = {
            "frame": name,
            "people": [self._tracked(person) for person in found],
            "ended": [number for number in before if number not in self._ids],
            "unassigned": self._unassigned(people, found),
        }
        return self._line(record, begin)

    def _line(self, record: dict[str, Any], begin: float) -> bytes:
        """Return the line of an answer, with its latency."""
        text = json.dumps(record, allow_nan=False)[:-1]
        self._end = time.perf_counter()
        self._begin = self._begin if self._solved else begin
        self._solved += 1
        self._latencies.append(1000.0 * (self._end - begin))
        return f'{text}, "latency_ms": {self._latencies[-1]:.4f}}}\n'.encode()

    def _tracked(self, person: sk.Person) -> dict[str, Any]:
        """Return a person's fields: those of one alone, and per camera what was used of its detections."""
        weights = person.refinement.view_weights
        seen: Mask = np.isfinite(weights)
        rejected: Mask = weights < REJECTED_WEIGHT
        mean = np.where(seen, weights, 0.0).sum(axis=1) / np.maximum(seen.sum(axis=1), 1)
        views = {}
        for i, slots in enumerate(zip(person.slots.tolist(), person.more_slots.tolist(), strict=True)):
            own = [slot for slot in slots if slot >= 0]
            if own:
                used = {"detections": own, "weight": round(float(mean[i]), 4)}
                views[self._cameras[i]] = {**used, "rejected": np.flatnonzero(rejected[i]).tolist()}
        return {"id": person.id, **_person(person.refinement), "views": views}

    def _unassigned(self, people: Array, found: list[sk.Person]) -> dict[str, list[int]]:
        """Return, by camera, the places of detected people who are nobody's."""
        free: Mask = ~np.isnan(people[..., 0]) & (people[..., 2] > 0.0)
        left: Mask = np.array(free.any(axis=-1))
        rows = np.arange(len(left))
        for person in found:
            for slots in (person.slots, person.more_slots):
                left[rows[slots >= 0], slots[slots >= 0]] = False
        return {self._cameras[i]: np.flatnonzero(left[i]).tolist() for i in np.flatnonzero(left.any(axis=1))}


def _person(result: sk.Refinement) -> dict[str, Any]:
    """Return the JSON fields of one person in one frame."""

    def sigma(covariance: Array) -> Any:
        return to_json(np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)), by_joint=True)

    bars = {"error_bar": sigma(result.error_bar), "scatter": sigma(result.uncertainty)}
    status = result.joint_status.tolist()
    return {"pose": to_json(result.pose, by_joint=True), **bars, "joint_status": status}


class _View(NamedTuple):
    """Detections of a camera, or of a person there, as given (null: none), and what messages call them."""

    value: Any
    place: str


def _record(text: bytes) -> dict[str, Any]:
    """Return a line as an object with "detections", a "frame" that JSON can hold, and a "reset" of a bool."""
    if not text.strip():
        raise MalformedLineError("expected JSON, got an empty line")
    try:
        record = json.loads(text.decode("utf-8-sig"))  # Windows begins a stream with its mark
    except (ValueError, RecursionError) as error:
        raise MalformedLineError(f"expected JSON, got a flaw: {error}") from error
    if not isinstance(record, dict):
        raise MalformedLineError(f'expected an object with "detections", got {_shown(record)}')
    name = record.get("frame")
    try:
        json.dumps([[[name]]], allow_nan=False)  # as deep as in the answer, and deeper
    except (ValueError, RecursionError) as error:
        raise MalformedLineError(f"frame: expected a value of JSON, got {name}") from error
    if "detections" not in record:
        got = f"the keys {', '.join(record)}" if record else "no keys"
        raise MalformedLineError(f'expected an object with "detections", got {got}', name)
    if not isinstance(record.get("reset", False), bool):
        raise MalformedLineError(f"reset: expected true or false, got {_shown(record['reset'])}", name)
    return record


def _by_camera(value: Any, cameras: Sequence[str]) -> list[_View]:
    """Return the views in the order of the cameras, given in that order or by name."""
    if isinstance(value, dict):
        unknown = next((name for name in value if name not in cameras), None)
        if unknown is not None:
            expected = f"expected the cameras {', '.join(cameras)}"
            raise MalformedLineError(f"detections: {expected}, got {_shown(unknown)}")
        return [_View(value.get(name), f"detections[{json.dumps(name)}]") for name in cameras]
    views = _listed(value, len(cameras), "detections", "cameras")
    return [_View(view, f"detections[{i}]") for i, view in enumerate(views)]


def _people(views: Sequence[_View], joints: int) -> Array:
    """Return the people (M, P, N, 3) of a line, NaN where a camera has fewer than P."""
    people = []
    for value, place in views:
        if not isinstance(value, list | None):
            raise MalformedLineError(f"{place}: expected a list of people or null, got {_shown(value)}")
        alone = any(map(_is_joint, value or []))
        each = [_View(person, f"{place}[{k}]") for k, person in enumerate(value or [])]
        people.append([_View(value, place)] if alone else each)
    found = _points(list(chain.from_iterable(people)), joints)
    counts = [len(view) for view in people]
    padded = np.full((len(views), max(counts), *found.shape[1:]), np.nan)
    padded[np.arange(max(counts)) < np.array(counts)[:, None]] = found
    return padded


def _is_joint(entry: Any) -> bool:
    """Whether an entry of a view is a joint, and the view one person without a list of people."""
    return isinstance(entry, list) and len(entry) in (2, 3) and not any(isinstance(x, list) for x in entry)


def _points(people: Sequence[_View], joints: int) -> Array:
    """Return the detections (K, N, 3) of K people, NaN where missing; without a confidence it is 1."""
    absent = [None] * joints
    values = [absent if person.value is None else person.value for person in people]
    try:
        whole = {len(points) for points in values} <= {joints}
        nested = [
            _MISSING if point is None else point if len(point) == 3 else [*point, 1.0]
            for points in values
            for point in points
        ]
        flat = list(chain.from_iterable(nested))
        whole = whole and set(map(len, nested)) <= {3} and set(map(type, flat)) <= _PLAIN
        array = np.array(flat, dtype=np.float64) if whole else None
    except (TypeError, OverflowError):  # something else than a list; a whole number beyond any float
        array = None
    if array is None:
        raise _malformed(people, joints)
    array = array.reshape(len(people), joints, 3)
    if np.isinf(array).any():
        raise MalformedLineError("detections: expected numbers, got infinity")
    array[np.isnan(array).any(axis=-1), :2] = np.nan
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


def _malformed(people: Sequence[_View], joints: int) -> MalformedLineError:
    """Return the error that names the first malformed joint of people."""
    for value, place in people:
        for j, point in enumerate([] if value is None else _listed(value, joints, place, "joints")):
            is_list = isinstance(point, list) and len(point) in (2, 3)
            if point is not None and not (is_list and set(map(type, point)) <= _PLAIN):
                expected = "expected [x, y, confidence] or null"
                return MalformedLineError(f"{place}[{j}]: {expected}, got {_shown(point)}")
    return MalformedLineError("detections: expected numbers, got one beyond any float")


def _listed(value: Any, count: int, place: str, what: str) -> Sequence[Any]:
    """Return ``value`` if it is a list of ``count`` entries."""
    if not isinstance(value, list) or len(value) != count:
        got = f"one of {len(value)}" if isinstance(value, list) else _shown(value)
        raise MalformedLineError(f"{place}: expected a list of {count} {what}, got {got}")
    return value


def _shown(value: Any) -> str:
    """Return a value as messages quote it."""
    try:
        text = json.dumps(value)
    except RecursionError:
        text = "nested lists"
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."

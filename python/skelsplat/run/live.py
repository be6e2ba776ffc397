"""Refinement over lines of JSON, detections in and poses out, in the form that ``live --help`` describes.

>>> session = Session(rig, layout, sk.RefineConfig(n_threads=1))  # doctest: +SKIP
>>> session.answer(b'{"frame": 7, "detections": [[[812.5, 400.1, 0.9], ...], ...]}')  # doctest: +SKIP
"""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat.io.poses._json import to_json

_PERCENTILES = (50, 90, 99, 99.9)
# more than any detector's score: probably a pixel coordinate
_NO_SCORE = 100.0
# characters of a line that a message shows
_SHOWN = 40


class MalformedLineError(Exception):
    """A line that cannot be answered: what was expected in it, and what it has."""


class Session:
    """A refiner with its latencies: one line in, one line out, with a lag some lines later.

    Parameters
    ----------
    rig, layout, config, fps, lag
        As for `skelsplat.Refiner`.
    """

    def __init__(
        self,
        rig: sk.CameraRig,
        layout: sk.Layout,
        config: sk.RefineConfig,
        *,
        fps: float | None = None,
        lag: int = 0,
    ) -> None:
        self._refiner = sk.Refiner(rig, layout=layout, fps=fps, lag=lag, config=config)
        self._size = (len(rig), layout.n_joints)
        self._lag = lag
        self._waiting: deque[Frame] = deque()
        self._latencies_ms: list[float] = []
        self._skipped = 0
        self._begun = self._ended = 0.0

    def answer(self, line: bytes) -> bytes | None:
        """Return the lines that the session owes after ``line``: usually one, None for none.

        With a lag the first lines have no answer, and a line that resets the session first has those of the
        frames that wait.

        Raises
        ------
        MalformedLineError
            If the line is malformed; it is counted as skipped.
        """
        begin = time.perf_counter()
        try:
            frame = parse_line(line, *self._size)
            if frame is None:
                return None
            json_name(frame.name)
            before = self.rest() if frame.reset else None
            if frame.reset:
                self._refiner.reset()
            result = self._refiner.step(frame.detections)
        except sk.SkelSplatError as error:
            self._skipped += 1
            raise MalformedLineError(str(error)) from error
        except MalformedLineError:
            self._skipped += 1
            raise
        self._waiting.append(frame)
        return b"".join(filter(None, [before, self._answered(result, begin)])) or None

    def rest(self) -> bytes | None:
        """Return the lines of the frames that wait for later ones, at the end of the input."""
        lines = []
        missing = np.full((*self._size, 2), np.nan)
        if self._waiting:
            for _ in range(self._lag - len(self._waiting)):  # fewer frames than the lag
                self._refiner.step(missing)
        while self._waiting:
            begin = time.perf_counter()
            lines.append(self._answered(self._refiner.step(missing), begin, last=True))
        return b"".join(filter(None, lines)) or None

    def _answered(self, result: sk.Refinement, begin: float, *, last: bool = False) -> bytes | None:
        if not last and len(self._waiting) <= self._lag:
            return None
        text = answer_text(self._waiting.popleft(), result)
        self._ended = time.perf_counter()
        self._begun = self._begun or begin
        self._latencies_ms.append(1000.0 * (self._ended - begin))
        return f'{text}, "latency_ms": {self._latencies_ms[-1]:.4f}}}\n'.encode()

    def summary(self) -> str:
        """Return how many lines were answered and skipped, how fast, and the percentiles of the latency."""
        count = len(self._latencies_ms)
        answered = f"lines answered {count}, skipped {self._skipped}"
        if not count:
            return answered
        values = np.percentile(self._latencies_ms, _PERCENTILES)
        parts = [f"{share:g}% {value:.3f}" for share, value in zip(_PERCENTILES, values, strict=True)]
        rate = count / max(self._ended - self._begun, 1e-9)
        longest = f"longest {max(self._latencies_ms):.3f}"
        return f"{answered}; {rate:.0f} per second; latency in ms: {', '.join(parts)}, {longest}"


class Frame(NamedTuple):
    """One line of the input: its name, detections (M, N, 2|3), and whether to discard the previous pose."""

    name: Any
    detections: Array
    reset: bool


def parse_line(line: bytes, cameras: int, joints: int) -> Frame | None:
    """Return what a line holds, None for a blank one.

    Raises
    ------
    MalformedLineError
        If it is no JSON, has no detections, or not those of ``cameras`` cameras and ``joints`` joints.
    """
    if not line.strip():
        return None
    try:
        record = json.loads(line.decode("utf-8-sig"))  # Windows begins a stream with its mark
    except json.JSONDecodeError as error:
        raise MalformedLineError(f"expected JSON, got at column {error.colno}: {error.msg}") from error
    except (ValueError, RecursionError) as error:
        raise MalformedLineError(f"expected JSON, got {error}") from error
    if not isinstance(record, dict) or "detections" not in record:
        got = f"the keys {', '.join(record)}" if isinstance(record, dict) else json.dumps(record)[:_SHOWN]
        raise MalformedLineError(f'expected an object with "detections", got {got}')
    reset = record.get("reset", False)
    if not isinstance(reset, bool):
        raise MalformedLineError(f"reset: expected true or false, got {json.dumps(reset)}")
    return Frame(record.get("frame"), _detections(record["detections"], cameras, joints), reset)


def _detections(value: Any, cameras: int, joints: int) -> Array:
    try:
        array = np.array(value)
    except ValueError:  # entries of different lengths, among them null for a joint or a camera
        array = np.array(None)
    if array.dtype.kind not in "fi" or array.shape not in ((cameras, joints, 2), (cameras, joints, 3)):
        array = np.array(_without_nulls(value, cameras, joints))
    array = array.astype(np.float64, copy=False)
    if np.isinf(array).any():
        raise MalformedLineError("detections: expected numbers, got infinity")
    array[np.isnan(array).any(axis=-1), :2] = np.nan
    if array.shape[-1] == 3:
        scores = array[..., 2]
        scores[np.isnan(scores)] = 0.0
        scores[(scores > 1.0) & (scores < _NO_SCORE)] = 1.0  # the peak of a detector's map
    return array


def _without_nulls(value: Any, cameras: int, joints: int) -> list[list[list[float]]]:
    """Return the nested lists with NaN instead of null."""
    missing = [float("nan")] * 3
    views = []
    for i, view in enumerate(_listed(value, cameras, "detections", "cameras")):
        if view is None:
            views.append([missing] * joints)
            continue
        points = _listed(view, joints, f"detections[{i}]", "joints")
        views.append(
            [missing if p is None else _point(p, f"detections[{i}][{j}]") for j, p in enumerate(points)]
        )
    return views


def _listed(value: Any, count: int, place: str, what: str) -> Sequence[Any]:
    if not isinstance(value, list) or len(value) != count:
        got = len(value) if isinstance(value, list) else _shown(value)
        raise MalformedLineError(f"{place}: expected a list of {count} {what}, got {got}")
    return value


def _point(value: Any, place: str) -> list[float]:
    """Return [x, y, confidence] with NaN for null; a point without a confidence has 1."""
    numbers = isinstance(value, list) and len(value) in (2, 3) and all(map(_is_number, value))
    if not numbers:
        raise MalformedLineError(f"{place}: expected [x, y, confidence] or null, got {_shown(value)}")
    try:
        point = [float("nan") if number is None else float(number) for number in value]
    except OverflowError:  # a whole number beyond any float
        raise MalformedLineError(f"{place}: expected finite numbers, got {_shown(value)}") from None
    return point if len(point) == 3 else [*point, 1.0]


def _is_number(value: Any) -> bool:
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))


def _shown(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def json_name(name: Any) -> None:
    """Reject a frame's name that is NaN or infinite, which JSON cannot represent.

    Raises
    ------
    MalformedLineError
        If it is.
    """
    try:
        json.dumps(name, allow_nan=False)
    except ValueError as error:
        raise MalformedLineError(f"frame: expected a value of JSON, got {name}") from error


def answer_text(frame: Frame, result: sk.Refinement) -> str:
    """Return the answer to a frame as a JSON object without its closing brace."""
    bar, scatter = (
        to_json(np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)), by_joint=True)
        for covariance in (result.error_bar, result.uncertainty)
    )
    record = {
        "frame": frame.name,
        "pose": to_json(result.pose, by_joint=True),
        "error_bar": bar,
        "scatter": scatter,
        "joint_status": result.joint_status.tolist(),
    }
    return json.dumps(record, allow_nan=False)[:-1]

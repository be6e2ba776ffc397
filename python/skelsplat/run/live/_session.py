"""A session: lines in, lines out, and how long each took. Here for one person."""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections import deque
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat.io.poses._json import to_json
from skelsplat.run.live._latencies import Latencies
from skelsplat.run.live._lines import Line, MalformedLineError, View, by_camera, parsed, points

_PERCENTILES = (50, 90, 99, 99.9)


class Session(ABC):
    """What answers lines, with its latencies."""

    def __init__(self, rig: sk.CameraRig, layout: sk.Layout) -> None:
        self._cameras, self._joints = rig.names, layout.n_joints
        self._latencies = Latencies()
        self._skipped = 0
        self._begun = self._ended = 0.0

    def answer(self, text: bytes) -> bytes | None:
        """Return the lines that the session owes after the line ``text``: usually one, None for none.

        Raises
        ------
        MalformedLineError
            If the line is malformed; it is counted as skipped and changes nothing.
        """
        begin = time.perf_counter()
        line = None
        try:
            line = parsed(text)
            return self._solved(line, begin)
        except (MalformedLineError, sk.SkelSplatError) as error:
            self._skipped += 1
            malformed = error if isinstance(error, MalformedLineError) else MalformedLineError(str(error))
            if line is not None:
                malformed.frame = line.name
            raise malformed from error

    @abstractmethod
    def _solved(self, line: Line, begin: float) -> bytes | None:
        """Return the lines owed after this one, which was read at ``begin``."""

    def rest(self) -> bytes | None:
        """Return the lines of the frames that wait for later ones, at the end of the input."""
        return None

    def _timed(self, text: str, begin: float) -> bytes:
        """Return the line of an object without its closing brace, with its latency."""
        self._ended = time.perf_counter()
        self._begun = self._begun or begin
        latency_ms = 1000.0 * (self._ended - begin)
        self._latencies.add(latency_ms)
        return f'{text}, "latency_ms": {latency_ms:.4f}}}\n'.encode()

    def summary(self) -> str:
        """Return how many lines were solved and malformed, how fast, and percentiles of all latencies."""
        count = self._latencies.count
        lines = f"lines solved {count}, malformed {self._skipped}"
        if not count:
            return lines
        values = self._latencies.percentiles(_PERCENTILES)
        parts = [f"{share:g}% {value:.3f}" for share, value in zip(_PERCENTILES, values, strict=True)]
        rate = count / max(self._ended - self._begun, 1e-9)
        latencies = f"{', '.join(parts)}, longest {self._latencies.longest_ms:.3f}"
        return f"{lines}; {rate:.0f} per second; latency in ms: {latencies}"


class OnePerson(Session):
    """A refiner over lines, with a lag an answer some lines later.

    With a lag the first lines have no answer, and a line that resets the session first has those of the
    frames that wait.

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
        super().__init__(rig, layout)
        self._refiner = sk.Refiner(rig, layout=layout, fps=fps, lag=lag, config=config)
        self._lag = lag
        self._waiting: deque[Any] = deque()  # names of frames

    def _solved(self, line: Line, begin: float) -> bytes | None:
        views = by_camera(line.detections, self._cameras)
        detections = _of_one(views, self._joints)
        before = self.rest() if line.reset else None
        if line.reset:
            self._refiner.reset()
        result = self._refiner.step(detections)
        self._waiting.append(line.name)
        return b"".join(filter(None, [before, self._answered(result, begin)])) or None

    def rest(self) -> bytes | None:
        lines = []
        missing = np.full((len(self._cameras), self._joints, 2), np.nan)
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
        record = {"frame": self._waiting.popleft(), **person_record(result)}
        return self._timed(json.dumps(record, allow_nan=False)[:-1], begin)


def _of_one(views: list[View], joints: int) -> Array:
    try:
        return points(views, joints)
    except MalformedLineError:
        for value, place in views:
            if isinstance(value, list) and any(map(is_person, value)) and not any(map(is_point, value)):
                expected = "the joints of one person (several: use --people)"
                raise MalformedLineError(f"{place}: expected {expected}, got {len(value)} people") from None
        raise


def is_person(value: Any) -> bool:
    """Tell whether an entry of a view is a person's joints, some of them detected, and not a joint."""
    return isinstance(value, list) and any(isinstance(joint, list) for joint in value)


def is_point(value: Any) -> bool:
    """Tell whether an entry of a view is a detected joint."""
    return isinstance(value, list) and any(isinstance(number, int | float) for number in value)


def person_record(result: sk.Refinement) -> dict[str, Any]:
    """Return the JSON fields of one person in one frame."""
    bar, scatter = (to_json(sigmas(each), by_joint=True) for each in (result.error_bar, result.uncertainty))
    return {
        "pose": to_json(result.pose, by_joint=True),
        "error_bar": bar,
        "scatter": scatter,
        "joint_status": result.joint_status.tolist(),
    }


def sigmas(covariance: Array) -> Array:
    """Return the standard deviations per axis (…, 3) of covariances (…, 3, 3)."""
    return np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))

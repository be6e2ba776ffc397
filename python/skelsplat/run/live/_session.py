"""A session: lines in, lines out, for one person or several, and how long each took."""

from __future__ import annotations

import json
import time
from collections import deque
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Mask
from skelsplat._skelsplat import REJECTED_WEIGHT
from skelsplat.io.poses._json import to_json
from skelsplat.run.live._latencies import Latencies
from skelsplat.run.live._lines import Line, MalformedLineError, by_camera, one_person, parsed, several_people


class Session:
    """A refiner over lines, or with ``people`` a tracker.

    With a lag the first lines have no answer, and a line that resets the session first has those of the
    frames that wait.

    Parameters
    ----------
    rig, layout, config, fps, lag
        As for `skelsplat.Refiner`.
    people : "all" or int, optional
        Follow everybody, or so many at most, at ``fps`` and without a lag; None: one person.
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
        self._cameras, self._joints = rig.names, layout.n_joints
        self._latencies = Latencies()
        self._skipped = 0
        self._lag = lag
        self._waiting: deque[Any] = deque()  # names of frames
        self._ids: tuple[int, ...] = ()
        self._tracker = None
        if people is None or fps is None:
            self._refiner = sk.Refiner(rig, layout=layout, fps=fps, lag=lag, config=config)
        else:
            most = None if people == "all" else int(people)
            self._tracker = sk.Tracker(rig, layout=layout, fps=fps, max_people=most, config=config)

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
            return self._of_one(line, begin) if self._tracker is None else self._of_all(line, begin)
        except (MalformedLineError, sk.SkelSplatError) as error:
            self._skipped += 1
            malformed = error if isinstance(error, MalformedLineError) else MalformedLineError(str(error))
            if line is not None:
                malformed.frame = line.name
            raise malformed from error

    def rest(self) -> bytes | None:
        """Return the lines of the frames that wait for later ones, at the end of the input."""
        lines = []
        missing = np.full((len(self._cameras), self._joints, 2), np.nan)
        if self._waiting:
            for _ in range(self._lag - len(self._waiting)):  # fewer frames than the lag
                self._refiner.step(missing)
        while self._waiting:
            begin = time.perf_counter()
            lines.append(self._next(self._refiner.step(missing), begin))
        return b"".join(lines) or None

    def summary(self) -> str:
        """Return how many lines were solved and malformed, how fast, and percentiles of all latencies."""
        lines = f"lines solved {self._latencies.count}, malformed {self._skipped}"
        return f"{lines}; {self._latencies}" if self._latencies.count else lines

    def _of_one(self, line: Line, begin: float) -> bytes | None:
        detections = one_person(by_camera(line.detections, self._cameras), self._joints)
        before = None
        if line.reset:
            before = self.rest()
            self._refiner.reset()
        result = self._refiner.step(detections)
        self._waiting.append(line.name)
        own = self._next(result, begin) if len(self._waiting) > self._lag else None
        return b"".join(filter(None, [before, own])) or None

    def _next(self, result: sk.Refinement, begin: float) -> bytes:
        return self._line({"frame": self._waiting.popleft(), **_person(result)}, begin)

    def _of_all(self, line: Line, begin: float) -> bytes:
        tracker = self._tracker
        assert tracker is not None
        people = several_people(by_camera(line.detections, self._cameras), self._joints)
        if line.reset:
            tracker.reset()
        found = tracker.step(people)
        before, self._ids = self._ids, tracker.ids
        record = {
            "frame": line.name,
            "people": [self._tracked(person) for person in found],
            "ended": [number for number in before if number not in self._ids],
            "unassigned": self._unassigned(people, found),
        }
        return self._line(record, begin)

    def _line(self, record: dict[str, Any], begin: float) -> bytes:
        """Return the line of an answer, with its latency."""
        text = json.dumps(record, allow_nan=False)[:-1]
        return f'{text}, "latency_ms": {self._latencies.add(begin, time.perf_counter()):.4f}}}\n'.encode()

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
        free: Mask = ~np.isnan(people[..., 0])
        if people.shape[-1] == 3:
            free &= people[..., 2] > 0.0
        left: Mask = np.array(free.any(axis=-1))
        rows = np.arange(len(left))
        for person in found:
            for slots in (person.slots, person.more_slots):
                left[rows[slots >= 0], slots[slots >= 0]] = False
        return {self._cameras[i]: np.flatnonzero(left[i]).tolist() for i in np.flatnonzero(left.any(axis=1))}


def _person(result: sk.Refinement) -> dict[str, Any]:
    """Return the JSON fields of one person in one frame."""
    bar, scatter = (
        to_json(np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1)), by_joint=True)
        for covariance in (result.error_bar, result.uncertainty)
    )
    return {
        "pose": to_json(result.pose, by_joint=True),
        "error_bar": bar,
        "scatter": scatter,
        "joint_status": result.joint_status.tolist(),
    }

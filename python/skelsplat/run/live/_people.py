"""A session for several people, who is who included."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Mask
from skelsplat._skelsplat import REJECTED_WEIGHT
from skelsplat.run.live._lines import Line, MalformedLineError, View, by_camera, points, shown
from skelsplat.run.live._session import Session, is_person, person_record


class SeveralPeople(Session):
    """A tracker over lines.

    Parameters
    ----------
    rig, layout, config, fps, max_people
        As for `skelsplat.Tracker`.
    """

    def __init__(
        self,
        rig: sk.CameraRig,
        layout: sk.Layout,
        config: sk.RefineConfig,
        *,
        fps: float,
        max_people: int | None = None,
    ) -> None:
        super().__init__(rig, layout)
        self._tracker = sk.Tracker(rig, layout=layout, fps=fps, max_people=max_people, config=config)
        self._ids: tuple[int, ...] = ()

    def _solved(self, line: Line, begin: float) -> bytes:
        people = self._people(line.detections)
        if line.reset:
            self._tracker.reset()
        found = self._tracker.step(people)
        before, self._ids = self._ids, self._tracker.ids
        record = {
            "frame": line.name,
            "people": [self._record(person) for person in found],
            "ended": [number for number in before if number not in self._ids],
            "unassigned": self._unassigned(people, found),
        }
        return self._timed(json.dumps(record, allow_nan=False)[:-1], begin)

    def _people(self, value: Any) -> Array:
        """Return the people (M, P, N, 2|3) of a line, NaN where a camera has fewer than P."""
        views = [_listed(view) for view in by_camera(value, self._cameras)]
        found = points([person for view in views for person in view], self._joints)
        counts = [len(view) for view in views]
        people = np.full((len(views), max(counts), *found.shape[1:]), np.nan)
        people[np.arange(max(counts)) < np.array(counts)[:, None]] = found
        return people

    def _record(self, person: sk.Person) -> dict[str, Any]:
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
        return {"id": person.id, **person_record(person.refinement), "views": views}

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


def _listed(view: View) -> list[View]:
    """Return the people of a view: those of a list, one alone, or none."""
    value = view.value
    if value is None:
        return []
    if not isinstance(value, list):
        expected = "a list of people, the joints of one, or null"
        raise MalformedLineError(f"{view.place}: expected {expected}, got {shown(value)}")
    if any(map(is_person, value)):
        return [View(person, f"{view.place}[{k}]") for k, person in enumerate(value)]
    if all(entry is None or _is_nothing(entry) for entry in value):
        return []
    return [view]


def _is_nothing(entry: Any) -> bool:
    """Tell whether an entry is a person or a joint of nulls."""
    return isinstance(entry, list) and bool(entry) and all(number is None for number in entry)

"""Clocks of cameras, offset and rate: detections between two frames of a camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skelsplat._arrays import Array, Index, Mask, numbers, positive
from skelsplat.exceptions import InvalidInputError

# Parts of a figure's extent: figures of two frames whose joints are farther apart, in the median, are of
# different people; a joint that moves by more against its figure was detected elsewhere, and is not moved.
_SAME = 0.5
_STEADY = 0.25
_SAME_RATE = 5e-4  # by which the rates of one recording may differ; 29.97 and 30 differ by twice that
_FAR = 2**62  # frames: further than any are apart
_EXACT = 1e-6  # frames: so near to one of a camera's, an instant is that frame


@dataclass(frozen=True, slots=True)
class Clock:
    """How a camera counts: its frame f is frame ``first`` + (f − first + offset) / pace of the recording."""

    offset: float = 0.0  # frames of the camera
    pace: float = 1.0  # frames of the camera in one of the recording, at least 1
    first: int = 0  # the number from which recording and cameras count

    def numbers(self, own: Index) -> Index:
        """Return the frames of the recording that frames of the camera tell, ascending."""
        whole, rest = parted(self.offset)
        if self.pace == 1.0:
            return own + whole
        steps = np.rint((own + whole - self.first + rest) / self.pace)
        found = np.unique(steps.astype(np.int64) + self.first)
        return found[self.between(found, own)[0]]

    def places(self, numbers: Index) -> tuple[Index, Array]:
        """Return where frames of the recording are in the camera's count: rounded, and the rest, −½ to ½."""
        whole, rest = parted(self.offset)
        if self.pace == 1.0:
            return numbers - whole, np.full(len(numbers), -rest)
        steps = (numbers - self.first) * self.pace
        near, parts = np.rint(steps), steps - np.rint(steps) - rest
        near, parts = near + np.rint(parts), parts - np.rint(parts)
        return near.astype(np.int64) + self.first - whole, np.where(np.abs(parts) < _EXACT, 0.0, parts)

    def between(self, numbers: Index, known: Index) -> tuple[Mask, Index, Index, Array]:
        """Return between which of its ``known`` frames a camera has frames of the recording.

        For each: whether the camera has it, the nearest known frame, the one on its other side (the nearest
        itself next to a gap), and how far it is from the first to the second, up to ½.
        """
        near, rest = self.places(numbers)
        if not len(known):
            return np.zeros(len(near), dtype=np.bool_), near, near, rest
        step = int(np.diff(known).min(initial=_FAR))
        below = known[np.maximum(np.searchsorted(known, near, side="right") - 1, 0)]
        above = known[np.minimum(np.searchsorted(known, near), len(known) - 1)]
        own = np.where(np.abs(near - below + rest) <= np.abs(near - above + rest), below, above)
        away = near - own + rest
        there = own == near if self.pace == 1.0 or step == _FAR else np.abs(away) <= step / 2
        beside = own + np.sign(away).astype(np.int64) * step
        beside = np.where(there & np.isin(beside, known), beside, own)
        return there, own, beside, np.abs(away) / step


def one_rate(rates: Sequence[float]) -> float | None:
    """Return the frame rate that all cameras have; None if they differ or there are none."""
    known = list(rates)
    return known[0] if known and 0.0 < max(known) <= (1 + _SAME_RATE) * min(known) else None


def common_rate(rates: Sequence[float]) -> tuple[float, list[float]]:
    """Return the rate of a recording, that of its slowest camera, and the pace of each camera."""
    slowest = one_rate(rates)
    if slowest is not None:
        return slowest, [1.0] * len(rates)
    return min(rates), [rate / min(rates) for rate in rates]


def parted(offset: float) -> tuple[int, float]:
    """Return an offset in frames as a whole number and a rest, −½ to ½."""
    whole = round(offset)
    return whole, offset - whole


def rounded(offset: float) -> float:
    """Return an offset as it is told and asked for: in hundredths of a frame, a whole number as an int."""
    offset = round(offset, 2)
    return int(offset) if offset == int(offset) else offset


def between(people: Sequence[Array], others: Sequence[Array], part: float) -> list[Array]:
    """Return people (N, 3) of a frame as they are a part of the way to another frame, ``part`` up to ½.

    Figures nearest to each other in both directions are the same person. Who or what is found in one of the
    frames alone stays where it is, and so does a joint that jumps: half the way to a wrong detection is wrong
    too, and its confidence is the smaller of both. A joint at exactly (0, 0) is none, as some detectors write
    it.
    """
    return [
        person if other is None else _moved(person, others[other], part)
        for person, other in zip(people, _nearest(people, others), strict=True)
    ]


def shifted(view: Array, clock: float, pace: float = 1.0, steps: int | None = None) -> Array:
    """Return detections (T, …, N, 3) of people with those that a camera's clock ``clock`` frames ahead has.

    The camera's frame f · ``pace`` + ``clock`` is frame f of the others, of which there are ``steps``, or T;
    NaN where it has none.
    """
    count = len(view) if steps is None else steps
    out = np.full((count, *view.shape[1:]), np.nan)
    there, own, beside, parts = Clock(-clock, pace).between(np.arange(count), np.arange(len(view)))
    out[there] = view[own[there]]
    for t in np.flatnonzero(own != beside):
        mine, others = (list(view[f].reshape(-1, *view.shape[-2:])) for f in (own[t], beside[t]))
        out[t] = np.reshape(between(mine, others, parts[t]), view.shape[1:])
    return out


def in_step(seen: Array, clocks: Mapping[int, float]) -> Array:
    """Return views of detections (T, M, …), by their places and clocks, at one time each, (T, M', …)."""
    return np.stack([shifted(seen[:, i], clock) for i, clock in clocks.items()], axis=1)


def retimed(detections: Sequence[ArrayLike], fps: Sequence[float]) -> tuple[Array, float]:
    """Return the detections of cameras with different frame rates at one time each, and their rate.

    That of the slowest camera: none of its detections is made up, or counts twice. The others' are moved in a
    straight line from the nearest frame towards the next one; those that are missing there, or that jump,
    stay.

    Parameters
    ----------
    detections : sequence of (T_i, …, N, 2|3)
        Of each camera, all frames from the same instant on, NaN where missing; people may be in any order.
    fps : sequence of float
        Frames per second, of each camera.

    Returns
    -------
    (T, M, …, N, 2|3), float
        For every function that takes detections, with its ``fps``. NaN after the end of a camera.
    """
    views = [numbers(view, f"detections[{i}]") for i, view in enumerate(detections)]
    if not views or len(views) != len(fps):
        raise InvalidInputError(f"fps: expected one of each camera, {len(views)}, got {len(fps)}")
    for i, rate in enumerate(fps):
        positive(f"fps[{i}]", rate)
    for i, view in enumerate(views):
        if view.ndim < 3 or view.shape[1:] != views[0].shape[1:] or view.shape[-1] not in (2, 3):
            expected = "(T, …, N, 2 or 3), but for T that of all cameras"
            raise InvalidInputError(f"detections[{i}]: expected shape {expected}, got {view.shape}")
    rate, paces = common_rate(fps)
    ends = [Clock(pace=pace).numbers(np.arange(len(view))) for view, pace in zip(views, paces, strict=True)]
    steps = 1 + int(max((end[-1] for end in ends if len(end)), default=-1))
    found = [shifted(view, 0.0, pace, steps) for view, pace in zip(views, paces, strict=True)]
    return np.stack(found, axis=1), rate


def _nearest(people: Sequence[Array], others: Sequence[Array]) -> list[int | None]:
    """Return for each of the people who of the others is the same person; None for nobody."""
    if not (people and others):
        return [None] * len(people)
    apart = np.array([[_apart(person, other) for other in others] for person in people])
    forth, back = apart.argmin(axis=1), apart.argmin(axis=0)
    return [int(q) if back[q] == p and apart[p, q] <= _SAME else None for p, q in enumerate(forth)]


def _apart(person: Array, other: Array) -> float:
    """Return the median distance of two figures' joints in extents of the first; inf without any."""
    known = _placed(person) & _placed(other)
    distance = np.hypot(*(other - person)[known, :2].T)
    return float(np.median(distance)) / _extent(person) if known.any() else np.inf


def _extent(person: Array) -> float:
    """Return the diagonal of the box around a figure, pixels, at least 1."""
    seen = person[_placed(person), :2]
    return max(1.0, float(np.hypot(*(seen.max(axis=0) - seen.min(axis=0)))))


def _placed(person: Array) -> Mask:
    """Return which joints of a figure are somewhere, (N,)."""
    there: Mask = np.isfinite(person[:, :2]).all(axis=1) & (person[:, :2] != 0.0).any(axis=1)
    return there


def _moved(person: Array, other: Array, part: float) -> Array:
    """Return the joints of a person a part of the way to those of the same person in another frame."""
    step = other - person
    known = _placed(person) & _placed(other)
    own = step[:, :2] - np.median(step[known, :2], axis=0)
    steady = known & (np.hypot(*own.T) <= _STEADY * _extent(person))
    places = person[:, :2] + part * step[:, :2]
    moved = np.concatenate([places, np.minimum(person[:, 2:], other[:, 2:])], axis=1)
    kept: Array = np.where(steady[:, None], moved, person)
    return kept

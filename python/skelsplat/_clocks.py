"""Clocks that differ by parts of a frame: detections between two frames of a camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from skelsplat._arrays import Array, Mask

# Parts of a figure's extent: figures of two frames whose joints are farther apart, in the median, are of
# different people; a joint that moves by more against its figure was detected elsewhere, and is not moved.
_SAME = 0.5
_STEADY = 0.25


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
    too. A joint at exactly (0, 0) is none, as some detectors write it.
    """
    return [
        person if other is None else _moved(person, others[other], part)
        for person, other in zip(people, _nearest(people, others), strict=True)
    ]


def shifted(view: Array, clock: float) -> Array:
    """Return detections (T, …, N, 3) of people with those that a camera's clock ``clock`` frames ahead has.

    The camera's frame f + ``clock`` is frame f of the others; NaN beyond the ends of the recording.
    """
    whole, rest = parted(clock)
    steps = len(view)
    out = np.full(view.shape, np.nan)
    for t in range(max(0, -whole), min(steps, steps - whole)):
        own, beside = t + whole, t + whole + (1 if rest > 0 else -1)
        known = rest != 0 and 0 <= beside < steps
        if known:
            mine, others = (list(view[f].reshape(-1, *view.shape[-2:])) for f in (own, beside))
            out[t] = np.reshape(between(mine, others, abs(rest)), view.shape[1:])
        else:
            out[t] = view[own]
    return out


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
    moved: Array = np.where(steady[:, None], person + part * step, person)
    return moved

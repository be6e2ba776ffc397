"""Which person to follow among those detected."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import skelsplat as sk
from skelsplat import _crowd as crowd
from skelsplat import association

if TYPE_CHECKING:
    import numpy.typing as npt

    from skelsplat._crowd import Crowd

    Array = npt.NDArray[np.float64]
    Index = npt.NDArray[np.int64]
    Mask = npt.NDArray[np.bool_]

# A person counts as detected with this many joints of this confidence; others are not considered.
_MIN_JOINTS, _MIN_CONFIDENCE = 4, 0.2
# Share of the frames with several people in two views or more from which these people are examined.
_CROWDED = 0.1


def check_person(person: str | int) -> None:
    """Raise `InvalidInputError` unless it is ``consistent``, ``largest`` or a number."""
    if person not in ("consistent", "largest") and not str(person).isdecimal():
        raise sk.InvalidInputError(f"person: expected consistent, largest or a number, got {person!r}")


def pick_places(
    people: Array, rig: sk.CameraRig, person: str, layout: sk.Layout | None = None
) -> tuple[Index, Mask]:
    """Return one person's indices (T, M) in P, -1 for none, and the mask (T, M) of views without a match.

    None matches in a view in which people are detected, and in another as well, but not the person the views
    agree on. The largest person, or one chosen by number, always matches.

    Parameters
    ----------
    people : (T, M, P, N, 3)
        All detections; NaN where missing. The order in P is the detector's.
    rig
        The M cameras.
    person
        ``"consistent"``: the person the views agree on; ``"largest"``: the largest in each image; a
        number: the one at that index in each file, from 0.
    layout
        Also finds a person whose left and right are swapped in a view.

    Raises
    ------
    InvalidInputError
        If no file has a person at that index.
    """
    if person == "consistent":
        _, index = association.choose_person(
            people, rig, layout=layout, min_confidence=_MIN_CONFIDENCE, min_joints=_MIN_JOINTS
        )
        there = count_people(people) > 0
        return index, there & (index < 0) & (there.sum(axis=1, keepdims=True) >= 2)
    never = np.zeros(people.shape[:2], dtype=bool)
    if person == "largest":
        return association.extents(people).argmax(axis=2), never
    if int(person) >= people.shape[2]:
        raise sk.InvalidInputError(
            f"person: expected less than {people.shape[2]} (the most people in a file), got {person}"
        )
    return np.full(people.shape[:2], int(person), dtype=np.int64), never


def look_around(
    people: Array, index: Index, rig: sk.CameraRig, person: str, layout: sk.Layout | None = None
) -> Crowd | None:
    """Return who is visible apart from the person of ``index`` (T, M), and whether this mixes people.

    None where hardly any frame has several people in two views. Long recordings are sampled.

    Parameters
    ----------
    people, rig, person, layout
        As for `pick_places`.
    """
    several = (count_people(people) >= 2).sum(axis=1) >= 2
    if several.mean() < _CROWDED:
        return None
    steps = crowd.sampled(len(people))
    chosen = index[steps]
    found, poses = association.separate_people(
        people[steps],
        rig,
        first=chosen if person == "consistent" else None,
        layout=layout,
        min_confidence=_MIN_CONFIDENCE,
        min_joints=_MIN_JOINTS,
    )
    return crowd.describe(people[steps], chosen, found, poses, crowd.gates_px(rig), steps)


def count_people(people: Array) -> Index:
    """Count those in every view, (T, M), who have enough joints of enough confidence."""
    sure = np.isfinite(people[..., :2]).all(axis=-1) & (people[..., 2] >= _MIN_CONFIDENCE)
    count: Index = (sure.sum(axis=-1) >= min(_MIN_JOINTS, people.shape[3])).sum(axis=2)
    return count

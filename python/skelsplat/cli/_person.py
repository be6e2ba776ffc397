"""Whom to follow: the choice that ``--person`` makes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import skelsplat as sk
from skelsplat import association

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]
    Mask = npt.NDArray[np.bool_]

# Somebody is detected who has so many joints of so much confidence; others take no part in the choice.
_MIN_JOINTS, _MIN_CONFIDENCE = 4, 0.2


def pick_person(
    people: Array, rig: sk.CameraRig, person: str, layout: sk.Layout | None = None
) -> tuple[Array, Mask]:
    """Return one person's detections (T, M, N, 3) among ``people`` (T, M, P, N, 3), and where nobody fitted.

    Nobody fits, (T, M), in a view in which somebody is detected, and in another as well, but not the person
    on whom the views agree; whoever is the largest or asked for by number fits.

    Parameters
    ----------
    people
        Everybody's detections; NaN where missing. The order in P is the detector's.
    rig
        The M cameras.
    person
        ``"consistent"``: the one on whom the views agree; ``"largest"``: the largest in each image; a
        number: the one at that place of each file, counted from 0.
    layout
        Lets a person stand in a view with left and right exchanged.

    Raises
    ------
    InvalidInputError
        If no file has a person at the place asked for.
    """
    if person == "consistent":
        chosen, index = association.choose_person(
            people, rig, layout=layout, min_confidence=_MIN_CONFIDENCE, min_joints=_MIN_JOINTS
        )
        there = _somebody(people)
        return chosen, there & (index < 0) & (there.sum(axis=1, keepdims=True) >= 2)
    never = np.zeros(people.shape[:2], dtype=bool)
    if person == "largest":
        place = association.extents(people).argmax(axis=2)
        largest: Array = np.take_along_axis(people, place[:, :, None, None, None], axis=2)[:, :, 0]
        return largest, never
    if int(person) >= people.shape[2]:
        raise sk.InvalidInputError(
            f"person: expected less than {people.shape[2]} (the most people in a file), got {person}"
        )
    numbered: Array = people[:, :, int(person)]
    return numbered, never


def _somebody(people: Array) -> Mask:
    """Whether anybody is detected in a view, (T, M)."""
    sure = np.isfinite(people[..., :2]).all(axis=-1) & (people[..., 2] >= _MIN_CONFIDENCE)
    found: Mask = (sure.sum(axis=-1) >= min(_MIN_JOINTS, people.shape[3])).any(axis=2)
    return found

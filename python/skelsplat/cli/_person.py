"""Whom to follow: the choice that ``--person`` makes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import skelsplat as sk
from skelsplat import association

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]


def pick_person(people: Array, rig: sk.CameraRig, person: str, layout: sk.Layout | None = None) -> Array:
    """Return the detections (T, M, N, 3) of one person among ``people`` (T, M, P, N, 3).

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
        return association.choose_person(people, rig, layout=layout)[0]
    if person == "largest":
        place = association.extents(people).argmax(axis=2)
        largest: Array = np.take_along_axis(people, place[:, :, None, None, None], axis=2)[:, :, 0]
        return largest
    if int(person) >= people.shape[2]:
        raise sk.InvalidInputError(
            f"--person: expected less than {people.shape[2]} (the most people in a file), got {person}"
        )
    numbered: Array = people[:, :, int(person)]
    return numbered

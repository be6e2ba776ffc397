"""Which person in each view is the one to follow: everybody is followed over time, and one is taken."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

import skelsplat as sk
from skelsplat import _skelsplat
from skelsplat._arrays import Array, Index, Mask, extents, medians, numbers, take_people
from skelsplat._people import most_people, people_uncompared
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import warn

__all__ = ["choose_person", "extents", "separate_people", "take_people"]

# Of two people in as many views that agree as well, the larger in the images is first.
_SIZE = 1e-3
# Distance of a figure from its body, as a part of the image's diagonal, at which it counts by exp(−½).
_AGREE = 0.03
_MOST_PEOPLE = 4
# How fast people move is judged at this rate if none is given: that of most video.
_FPS = 25.0


def choose_person(
    people: npt.ArrayLike,
    cameras: sk.CameraRig | Sequence[sk.Camera],
    *,
    layout: sk.Layout | None = None,
    fps: float | None = None,
) -> tuple[Array, Index]:
    """Follow one person through all views and frames: of everybody the one whom the views see most.

    People are followed as `skelsplat.track` does, but in any unit, of any size, and however briefly. A view
    counts as far as its figure agrees with the others'; of two people equal in that, the larger is chosen.
    Before the chosen one appears and once they are gone, it is the next.

    Parameters
    ----------
    people : (T, M, P, K, 3)
        Pixels of the original images and confidence; NaN where nobody or nothing is. The order in P is free.
    cameras : CameraRig or sequence of Camera
        M ≥ 2 of them.
    layout, fps : optional
        Without a layout, nobody can be seen with left and right exchanged. The usual rate is 25 per second.

    Returns
    -------
    detections : (T, M, K, 3)
        The chosen person; NaN in a view or frame where there is none.
    index : (T, M) int
        Their place in P, -1 for none.

    Raises
    ------
    InvalidInputError
        If shapes do not fit, a confidence is outside [0, 1], or there are fewer than two cameras. A warning
        says if there are too many people: the search of a frame ends after a fixed amount of work.
    """
    everyone = checked_people(people, cameras)
    index = separate_people(everyone, cameras, layout=layout, fps=fps)[0]
    return take_people(everyone, index), index


def separate_people(
    people: npt.ArrayLike,
    cameras: sk.CameraRig | Sequence[sk.Camera],
    *,
    layout: sk.Layout | None = None,
    fps: float | None = None,
) -> Index:
    """Tell apart up to four people on whom two views or more agree, and return their places (Q, T, M) in P.

    The one whom `choose_person` takes is first; who comes second is chosen in the same way among the others.
    A body detected twice is one person. The place is -1 where no view shows the person; only the first of
    the Q ≥ 1 may be in no view at all. Arguments and errors are those of `choose_person`.
    """
    everyone = checked_people(people, cameras)
    found, cut = told_apart(everyone, cameras, layout, fps)
    if cut.any():
        warn(people_uncompared(int(cut.sum()), most_people(everyone)))
    return found


def told_apart(
    everyone: Array,
    cameras: sk.CameraRig | Sequence[sk.Camera],
    layout: sk.Layout | None,
    fps: float | None = None,
    before: int = 0,
) -> tuple[Index, Mask]:
    """Return the places (Q, T, M) of `separate_people`, and the frames (T,) in which not all were compared.

    Whoever is in the first ``before`` frames comes first.
    """
    if layout is not None and layout.n_joints != everyone.shape[3]:
        raise InvalidInputError(f"layout: expected one of {everyone.shape[3]} joints, got {layout.n_joints}")
    refiner = _skelsplat.Refiner(cameras, layout=layout)
    people, cut = _skelsplat.people_identities(refiner, layout, everyone, _FPS if fps is None else fps)
    diagonal = np.array([np.hypot(*camera.size) for camera in cameras])
    shares = extents(everyone) / diagonal[:, None]

    def seen(person: tuple[int, Index]) -> tuple[int, float]:
        """Count the views that see a person, early and in all; in all, as far as they agree on the body."""
        first, slots = person
        t, m = np.nonzero(slots >= 0)
        early = int(np.count_nonzero(slots[: max(0, before - first)] >= 0))
        figures = take_people(everyone[first : first + len(slots)], slots)[..., :2]
        body = sk.project(np.asarray(sk.triangulate(figures, cameras, method="dlt")), cameras)
        off = medians(np.linalg.norm(np.moveaxis(body, 0, 1) - figures, axis=-1)) / diagonal
        agree = np.exp(-0.5 * (off / _AGREE) ** 2)
        return early, float(np.nansum(agree) + _SIZE * shares[first + t, m, slots[t, m]].sum())

    rest = sorted(people, key=seen, reverse=True) if len(people) > 1 else people
    found = [np.full(everyone.shape[:2], -1)]
    while rest and len(found) <= _MOST_PEOPLE:
        rest, index = _one(rest, everyone.shape[:2])
        found.append(index)
    return np.stack(found[1:] or found), cut


def _one(
    people: Sequence[tuple[int, Index]], shape: tuple[int, ...]
) -> tuple[list[tuple[int, Index]], Index]:
    """Return the places (T, M) of the first person, and of others where there is none; and who is left."""
    index, free, rest = np.full(shape, -1), np.ones(shape[0], dtype=bool), []
    for first, slots in people:
        own = slice(first, first + len(slots))
        here = free[own, None]
        index[own] = np.where(here, slots, index[own])
        left = np.where(here, -1, slots)
        free[own] = False
        if (left >= 0).any():
            rest.append((first, left))
    return rest, index


def checked_people(
    people: npt.ArrayLike, cameras: Sequence[sk.Camera], values: tuple[int, ...] = (3,)
) -> Array:
    """Return people (T, M, P, K, 2 | 3) of two cameras or more, or raise `InvalidInputError`."""
    array, count = numbers(people, "people"), len(cameras)
    if count < 2:
        raise InvalidInputError(f"cameras: expected at least two, got {count}")
    fits = array.ndim == 5 and array.shape[1] == count and array.shape[4] in values
    if not fits or 0 in array.shape[2:4]:
        expected = f"shape (T, {count}, P, K, 3) for {count} cameras"
        raise InvalidInputError(f"people: expected {expected}, got {array.shape}")
    return with_confidences(array) if array.shape[4] == 3 else array


def with_confidences(people: Array) -> Array:
    """Return people (..., 3) with confidences slightly above 1 as 1, or raise `InvalidInputError`."""
    _skelsplat.check_people(people)
    above = (people > 1.0) & [False, False, True]
    return np.where(above, 1.0, people) if above.any() else people

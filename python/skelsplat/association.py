"""Which person in each view is the one to follow: chosen by agreement between the views.

Two people in two views are a hypothesis: triangulated, projected into every view and compared with everybody
there. The hypotheses of consecutive frames are then linked so that one person is followed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

import skelsplat as sk
from skelsplat._arrays import Array, Index, Mask, corners, medians, numbers, take_people
from skelsplat._people import most_people, people_uncompared
from skelsplat._skelsplat import check_people, people_chosen
from skelsplat.cameras import mm_per_unit
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import warn
from skelsplat.layouts import mirror_images

__all__ = ["choose_person", "extents", "separate_people", "take_people"]

MIN_CONFIDENCE = 0.2  # joints below it do not take part in the choice; they are still returned
MIN_JOINTS = 4  # that must be in common for a comparison (all K, if K is smaller)
_GATE = 0.03  # largest median reprojection error, of the image's diagonal: 66 px at 1920×1080
_KEPT = 8  # hypotheses of a frame that stay in the running when frames are linked
_SWITCH_COST = 2.0  # changing to someone else once must pay for itself: worth two views of one frame
_SWITCH_MM = 1000.0  # such a step between frames is to someone else; a runner covers 0.4 m in 1/25 s
_SAME_BODY = 0.25  # of a body's size: who is nearer to someone else is the same body, detected twice
_MOST_PEOPLE = 4


def choose_person(
    people: npt.ArrayLike, cameras: sk.CameraRig | Sequence[sk.Camera], *, layout: sk.Layout | None = None
) -> tuple[Array, Index]:
    """Follow one person through all views and frames.

    In every frame the hypothesis that explains people in the most views is best, then the one with the
    smaller median reprojection error, then the larger person. Going over to someone else more than 1 m away
    costs as much as two unexplained views, so that a person stays chosen when another is briefly seen better.

    Parameters
    ----------
    people : (T, M, P, K, 3)
        Pixels of the original images and confidence; NaN where nobody or nothing is. The order in P is free.
        Joints of a confidence below 0.2 do not take part in the choice; they are still returned.
    cameras : CameraRig or sequence of Camera
        M ≥ 2 of them. A plain sequence is taken to be in mm.
    layout : Layout, optional
        Lets a person stand in a view with left and right exchanged, which the solver can set right.

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
    index, cut = chosen_places(everyone, cameras, layout)
    if cut.any():
        warn(people_uncompared(int(cut.sum()), most_people(everyone)))
    return take_people(everyone, index), index


def chosen_places(
    everyone: Array, cameras: sk.CameraRig | Sequence[sk.Camera], layout: sk.Layout | None
) -> tuple[Index, Mask]:
    """Return the places (T, M) of `choose_person`, and the frames (T,) in which not all were compared."""
    joints = everyone.shape[3]
    if layout is not None and layout.n_joints != joints:
        raise InvalidInputError(f"layout: expected one of {joints} joints, got {layout.n_joints}")
    pairs = () if layout is None else layout.left_right
    index, cut = people_chosen(
        cameras,
        everyone,
        [_GATE * float(np.hypot(*camera.size)) for camera in cameras],
        min_confidence=MIN_CONFIDENCE,
        min_joints=min(MIN_JOINTS, joints),
        mirror=mirror_images(joints, pairs).tolist(),
        most=_KEPT,
        worse=2 * _SWITCH_COST,  # going over to the best of a frame and back costs no more
        switch_cost=_SWITCH_COST,
        switch_step=_SWITCH_MM / mm_per_unit(cameras),
    )
    return index, cut


def separate_people(
    people: npt.ArrayLike,
    cameras: sk.CameraRig | Sequence[sk.Camera],
    *,
    layout: sk.Layout | None = None,
    first: Index | None = None,
) -> Index:
    """Tell apart up to four people on whom two views or more agree, and return their places (Q, T, M) in P.

    The one whom `choose_person` takes is first; everybody else is chosen in the same way among the detections
    that are left. A body detected twice is one person: who is nearer to an earlier one than a quarter of that
    body's size is left out. Where somebody is in no view, the place is -1; nobody of the Q ≥ 1 but the first
    is without any. ``first`` (T, M) are the first person's places, if they are known; the other arguments and
    errors are those of `choose_person`.
    """
    everyone = checked_people(people, cameras)
    index = choose_person(everyone, cameras, layout=layout)[1] if first is None else first
    rest, found, poses = everyone.copy(), [index], [_triangulated(everyone, index, cameras)]
    while len(found) < _MOST_PEOPLE:
        steps, views = np.nonzero(index >= 0)
        rest[steps, views, index[steps, views]] = np.nan
        index, _ = chosen_places(rest, cameras, layout)
        if (index < 0).all():
            break
        pose = _triangulated(everyone, index, cameras)
        apart = [medians(np.linalg.norm(pose - other, axis=-1)) for other in poses]
        same = np.any(np.stack(apart) < _SAME_BODY * np.stack([*map(body_sizes, poses)]), axis=0)
        if not same[(index >= 0).any(axis=1)].all():
            found.append(np.where(same[:, None], -1, index))
            poses.append(np.where(same[:, None, None], np.nan, pose))
    return np.stack(found)


def _triangulated(people: Array, index: Index, cameras: sk.CameraRig | Sequence[sk.Camera]) -> Array:
    return np.asarray(sk.triangulate(take_people(people, index), cameras, method="dlt"))


def body_sizes(pose: npt.ArrayLike) -> Array:
    """Return the diagonals (T,) of the boxes around poses (T, K, 3), in their unit; 0 for nobody."""
    sizes: Array = np.linalg.norm(_box(np.asarray(pose, dtype=np.float64)), axis=-1)
    return sizes


def extents(people: npt.ArrayLike) -> Array:
    """Return the diagonals (…,) px of the boxes around people (…, K, 2|3); 0 for nobody."""
    box = _box(numbers(people, "people")[..., :2])
    return np.hypot(box[..., 0], box[..., 1])


def _box(points: Array) -> Array:
    """Sides of the boxes around points (..., K, D), (..., D); 0 where there are none."""
    low, high = corners(points)
    return np.where(low <= high, high - low, 0.0)


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
    check_people(people)
    above = (people > 1.0) & [False, False, True]
    return np.where(above, 1.0, people) if above.any() else people

"""Which person in each view is the one to follow: chosen by agreement between the views.

Two people in two views are a hypothesis: triangulated, projected into every view and compared with everybody
who stands there. The right pair explains people in many views; a pair of two different people, or of a
bystander whom few cameras see, does not. The hypotheses of consecutive frames are then linked so that one
person is followed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

import skelsplat as sk
from skelsplat._arrays import Array, Index, Mask, medians, numbers
from skelsplat._skelsplat import check_people
from skelsplat.cameras import mm_per_unit
from skelsplat.exceptions import InvalidInputError
from skelsplat.layouts import mirror_images

# bounds the memory of a step: distances held at once, 8 bytes each
_CHUNK = 4_000_000
# hypotheses of a frame that stay in the running when frames are linked
_KEPT = 8
# changing to someone else once must pay for itself: worth two views of one frame
_SWITCH_COST = 2.0
# a step from frame to frame of this length counts as someone else; a runner covers 0.4 m in 1/25 s
_SWITCH_MM = 1000.0
# two equal explanations are told apart by size
_SIZE_COST = 1e-3
# of a body's size: who is nearer to someone else than this is the same body, detected twice
_SAME_BODY = 0.25


def choose_person(
    people: npt.ArrayLike,
    cameras: sk.CameraRig | Sequence[sk.Camera],
    *,
    layout: sk.Layout | None = None,
    min_confidence: float = 0.2,
    gate: float = 0.03,
    min_joints: int = 4,
) -> tuple[Array, Index]:
    """Follow one person through all views and frames.

    In every frame the hypothesis that explains people in the most views is best, then the one with the
    smaller median reprojection error, then the larger person. A view is explained by the person with the
    smallest median reprojection error, if that is below the gate. Over the frames, going over to someone else
    more than 1 m away costs as much as two unexplained views, so that a person stays chosen when another is
    briefly seen better.

    Parameters
    ----------
    people : (T, M, P, K, 3)
        Pixels of the original images and confidence; NaN where nobody or nothing is. The order in P is free.
    cameras : CameraRig or sequence of Camera
        M ≥ 2 of them. A plain sequence is taken to be in mm.
    layout : Layout, optional
        Lets a person stand in a view with left and right exchanged, which the solver can set right.
    min_confidence : float
        Joints below it do not take part in the choice; they are still returned.
    gate : float
        Largest median reprojection error, as a part of the image's diagonal: 0.03 is 66 px at 1920×1080.
    min_joints : int
        Joints that must be in common for a comparison (all K, if K is smaller).

    Returns
    -------
    detections : (T, M, K, 3)
        The chosen person; NaN in a view or frame where there is none.
    index : (T, M) int
        Their place in P, -1 for none.

    Raises
    ------
    InvalidInputError
        If the shapes do not fit, a confidence is outside [0, 1], or there are fewer than two cameras.
    """
    everyone = _check(people, cameras)
    steps, views, _, joints, _ = everyone.shape
    usable = np.where(everyone[..., 2:] >= min_confidence, everyone, np.nan)
    diagonals = np.array([np.hypot(*camera.size) for camera in cameras])
    shares = extents(usable) / diagonals[:, None]
    evidence = _Evidence(
        usable, shares, cameras, gate * diagonals, min(min_joints, joints), _mirrored(layout, joints)
    )
    candidates = evidence.candidates()
    path = _link(candidates, mm_per_unit(cameras))
    index = np.full((steps, views), -1, dtype=np.int64)
    index[candidates.step[path]] = candidates.index[path]
    return take_people(everyone, index), index


def separate_people(
    people: npt.ArrayLike,
    cameras: sk.CameraRig | Sequence[sk.Camera],
    *,
    first: Index | None = None,
    most: int = 4,
    layout: sk.Layout | None = None,
    min_confidence: float = 0.2,
    min_joints: int = 4,
) -> tuple[Index, Array]:
    """Tell apart the people on whom two views or more agree, the one whom `choose_person` takes first.

    Everybody else is chosen in the same way among the detections that are left. A body detected twice is one
    person: who is nearer to an earlier one than a quarter of that body's size is left out.

    Parameters
    ----------
    people, cameras, layout, min_confidence, min_joints
        As for `choose_person`.
    first : (T, M) int, optional
        The first person's places in P, -1 for none, if they are known.
    most : int
        Stop after so many people.

    Returns
    -------
    index : (Q, T, M) int
        Everybody's place in P, -1 for none. Nobody of the Q ≥ 1 but the first is without any place.
    pose : (Q, T, K, 3)
        Their joints, triangulated; NaN where unknown.

    Raises
    ------
    InvalidInputError
        As `choose_person`.
    """
    everyone = _check(people, cameras)
    options: dict[str, Any] = {"layout": layout, "min_confidence": min_confidence, "min_joints": min_joints}
    index = choose_person(everyone, cameras, **options)[1] if first is None else first
    rest, found, poses = everyone.copy(), [index], [_triangulated(everyone, index, cameras)]
    while len(found) < most:
        steps, views = np.nonzero(index >= 0)
        rest[steps, views, index[steps, views]] = np.nan
        index = choose_person(rest, cameras, **options)[1]
        if (index < 0).all():
            break
        pose = _triangulated(everyone, index, cameras)
        same = np.logical_or.reduce([_same_body(pose, other) for other in poses])
        if not same[(index >= 0).any(axis=1)].all():
            found.append(np.where(same[:, None], -1, index))
            poses.append(np.where(same[:, None, None], np.nan, pose))
    return np.stack(found), np.stack(poses)


def take_people(people: Array, index: Index) -> Array:
    """Return the detections (T, M, K, 3) at the places (T, M) of ``people`` (T, M, P, K, 3); NaN for -1."""
    taken = np.take_along_axis(people, np.maximum(index, 0)[:, :, None, None, None], axis=2)[:, :, 0]
    return np.where((index >= 0)[..., None, None], taken, np.nan)


def _triangulated(people: Array, index: Index, cameras: sk.CameraRig | Sequence[sk.Camera]) -> Array:
    return np.asarray(sk.triangulate(take_people(people, index), cameras, method="dlt"))


def _same_body(pose: Array, other: Array) -> Mask:
    """Whether two people (T, K, 3) are one body, (T,); not where one of them is unknown."""
    apart = medians(np.linalg.norm(pose - other, axis=-1))
    return apart < _SAME_BODY * body_sizes(other)


def body_sizes(pose: npt.ArrayLike) -> Array:
    """Return the diagonals (T,) of the boxes around poses (T, K, 3), in their unit; 0 for nobody."""
    sizes: Array = np.linalg.norm(_box(np.asarray(pose, dtype=np.float64)), axis=-1)
    return sizes


def extents(people: npt.ArrayLike) -> Array:
    """Return the diagonal in px of everybody's bounding box; 0 for nobody.

    Parameters
    ----------
    people : (..., K, 2|3)
        Pixels; NaN where missing.
    """
    box = _box(numbers(people, "people")[..., :2])
    return np.hypot(box[..., 0], box[..., 1])


def _box(points: Array) -> Array:
    """Sides of the boxes around points (..., K, D), (..., D); 0 where there are none."""
    there: Mask = np.isfinite(points)
    high = np.where(there, points, -np.inf).max(axis=-2)
    low = np.where(there, points, np.inf).min(axis=-2)
    return np.where(there.any(axis=-2), high - low, 0.0)


def _check(people: npt.ArrayLike, cameras: Sequence[sk.Camera]) -> Array:
    array = numbers(people, "people")
    if len(cameras) < 2:
        raise InvalidInputError(f"cameras: expected at least two, got {len(cameras)}")
    if array.ndim != 5 or array.shape[1] != len(cameras) or array.shape[4] != 3 or 0 in array.shape[2:4]:
        expected = f"shape (T, {len(cameras)}, P, K, 3) for {len(cameras)} cameras"
        raise InvalidInputError(f"people: expected {expected}, got {array.shape}")
    return with_confidences(array)


def with_confidences(people: Array) -> Array:
    """Return people (..., 3) with confidences slightly above 1 as 1, or raise `InvalidInputError`."""
    check_people(people)
    if not (people[..., 2] > 1.0).any():
        return people
    return np.where((people > 1.0) & [False, False, True], 1.0, people)


def _mirrored(layout: sk.Layout | None, joints: int) -> Index:
    """Place of every joint's mirror image, (K,)."""
    if layout is None:
        return np.arange(joints)
    if layout.n_joints != joints:
        raise InvalidInputError(f"layout: expected one of {joints} joints, got {layout.n_joints}")
    return mirror_images(joints, layout.left_right)


@dataclass(frozen=True)
class _Candidates:
    """Different ways to choose people, several per frame, in the order of their frames.

    A cost is the unexplained views + the median error as a part of the gate (below 1) + a little for being
    small.
    """

    step: Index  # (C,) of the frame
    index: Index  # (C, M) person per view, -1 for none
    cost: Array  # (C,)
    pose: Array  # (C, K, 3) world

    def take(self, rows: Index) -> _Candidates:
        return _Candidates(self.step[rows], self.index[rows], self.cost[rows], self.pose[rows])


@dataclass(frozen=True)
class _Evidence:
    """What it takes to weigh hypotheses."""

    people: Array  # (T, M, P, K, 3) usable detections
    shares: Array  # (T, M, P) their extent as a part of the image's diagonal
    cameras: sk.CameraRig | Sequence[sk.Camera]
    gates: Array  # (M,) largest median reprojection error, px
    min_joints: int  # that must be in common for a comparison
    mirrored: Index  # (K,) place of every joint's mirror image

    def candidates(self) -> _Candidates:
        """Weigh all hypotheses; of each frame the best few different ones are kept."""
        pairs = self._pairs()
        _, views, places, joints, _ = self.people.shape
        size = max(1, _CHUNK // (views * places * joints * 3))
        parts = [self._weigh(pairs[at : at + size]) for at in range(0, max(1, len(pairs)), size)]
        step, index, cost, pose = (np.concatenate(column) for column in zip(*parts, strict=True))
        return _best_few(_Candidates(step, index, cost, pose))

    def _pairs(self) -> Index:
        """Hypotheses (H, 5): frame, view, person, other view, other person."""
        enough = np.isfinite(self.people[..., :2]).all(axis=-1).sum(axis=-1) >= self.min_joints
        found = [np.empty((0, 5), dtype=np.int64)]
        for i, j in combinations(range(self.people.shape[1]), 2):
            t, a, b = np.nonzero(enough[:, i, :, None] & enough[:, j, None, :])
            found.append(np.stack([t, np.full_like(t, i), a, np.full_like(t, j), b], axis=1))
        rows = np.concatenate(found)
        return rows[np.argsort(rows[:, 0], kind="stable")]

    def _weigh(self, pairs: Index) -> tuple[Index, Index, Array, Array]:
        """Frame (C,), person per view (C, M), cost (C,) and pose (C, K, 3) of the hypotheses that hold."""
        if not len(pairs):
            views, joints = self.people.shape[1], self.people.shape[3]
            return pairs[:, 0], np.empty((0, views), dtype=np.int64), np.empty(0), np.empty((0, joints, 3))
        step, pose = pairs[:, 0], self._triangulate(pairs)
        error = self._errors(step, pose)
        index = error.argmin(axis=2)
        error = error.min(axis=2)
        explained = error < 1.0
        index[~explained] = -1
        count = explained.sum(axis=1)
        cost = (
            explained.shape[1]
            - count
            + medians(np.where(explained, error, np.nan))
            + _SIZE_COST * (1.0 - self._size(step, index))
        )
        holds = np.flatnonzero(count >= 2)
        return step[holds], index[holds], cost[holds], pose[holds]

    def _triangulate(self, pairs: Index) -> Array:
        """Poses (H, K, 3) of the pairs, each from its two views alone."""
        step, i, a, j, b = pairs.T
        rows = np.arange(len(pairs))
        seen = np.full((len(pairs), self.people.shape[1], *self.people.shape[3:]), np.nan)
        seen[rows, i] = self.people[step, i, a]
        seen[rows, j] = self.people[step, j, b]
        return np.asarray(sk.triangulate(seen, self.cameras, method="dlt"))

    def _errors(self, step: Index, pose: Array) -> Array:
        """Median reprojection error as a part of the gate, (H, M, P); infinite without common joints."""
        pixels = np.moveaxis(np.asarray(sk.project(pose, self.cameras)), 0, 1)
        people = self.people[step][..., :2]

        def median(seen: Array) -> Array:
            offset = seen - pixels[:, :, None]
            distance = np.hypot(offset[..., 0], offset[..., 1])
            error = medians(distance, self.min_joints) / self.gates[:, None]
            return np.where(np.isnan(error), np.inf, error)

        if (self.mirrored == np.arange(len(self.mirrored))).all():
            return median(people)
        return np.minimum(median(people), median(people[:, :, :, self.mirrored]))

    def _size(self, step: Index, index: Index) -> Array:
        """How large the people are in the images, (H,): mean extent as a part of the diagonal, below 1."""
        own = self.shares[step[:, None], np.arange(index.shape[1]), index]
        shown = np.where(index >= 0, own, 0.0)
        mean: Array = shown.sum(axis=1) / np.maximum((index >= 0).sum(axis=1), 1)
        return mean


def _best_few(candidates: _Candidates) -> _Candidates:
    """Keep, frame by frame, the cheapest of each choice of people, and of those the cheapest few."""
    order = np.lexsort((candidates.cost, candidates.step))
    kept: list[int] = []
    seen: dict[int, set[tuple[int, ...]]] = {}
    for row in order.tolist():
        choices = seen.setdefault(int(candidates.step[row]), set())
        choice = tuple(candidates.index[row].tolist())
        if len(choices) < _KEPT and choice not in choices:
            choices.add(choice)
            kept.append(row)
    return candidates.take(np.array(kept, dtype=np.int64))


def _link(candidates: _Candidates, mm_per_unit: float) -> Index:
    """Rows of the chosen candidates, one per frame that has any: the cheapest sequence in all.

    Dynamic programming over the frames, last frame first in the result.
    """
    groups = _groups(candidates.step)
    total = candidates.cost.copy()
    came_from = np.full(len(total), -1, dtype=np.int64)
    for before, now in pairwise(groups):
        ways = total[before][:, None] + _switch_costs(candidates.pose, before, now, mm_per_unit)
        came_from[now] = before[ways.argmin(axis=0)]
        total[now] += ways.min(axis=0)
    path: list[int] = []
    row = int(groups[-1][total[groups[-1]].argmin()]) if groups else -1
    while row >= 0:
        path.append(row)
        row = int(came_from[row])
    return np.array(path, dtype=np.int64)


def _groups(steps: Index) -> list[Index]:
    """Rows of each frame; `steps` is ascending."""
    if not len(steps):
        return []
    return list(np.split(np.arange(len(steps)), np.flatnonzero(np.diff(steps)) + 1))


def _switch_costs(pose: Array, before: Index, now: Index, mm_per_unit: float) -> Array:
    """Cost of going from each candidate of a frame to each of the next, (B, A)."""
    step = np.linalg.norm(pose[before][:, None] - pose[now][None], axis=-1) * mm_per_unit
    moved = np.nan_to_num(medians(step), nan=_SWITCH_MM)
    return _SWITCH_COST * np.minimum(moved / _SWITCH_MM, 1.0) ** 2

"""Scores of several tracked people against the truth: who was found, how well, and under how many names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from skelsplat._arrays import Array, Index, Mask, flags, positive, whole_numbers
from skelsplat._optional import require
from skelsplat.exceptions import InvalidInputError
from skelsplat.metrics._joints import Endpoint, as_poses, pcp, present

Track = tuple[int, ArrayLike, ArrayLike]


@dataclass(frozen=True, slots=True, eq=False)
class TrackScores:
    """What `track_scores` returns; Q true people, T frames.

    A *person-frame* is one true person in one frame. Ratios of nothing are NaN.
    """

    matched: Index  #: (Q, T), identity of the estimate matched to each person; −1 = none.
    error_mm: Array  #: (Q, T), mean joint distance of the matched pair; NaN = none.
    mpjpe_mm: float  #: Mean of `error_mm`.
    n_truth: int  #: Person-frames to be found.
    n_estimates: int  #: Estimates that count.
    precision: float  #: Matched pairs as a share of the estimates.
    recall: float  #: Matched pairs as a share of the person-frames.
    identity_switches: int  #: How often a person is matched to another identity than the one before.
    fragmentations: int  #: How often a person is lost and found again while present.
    mota: float  #: 1 − (missed + false + switches) / `n_truth`.
    idf1: float  #: F1 of the person-frames under the best one-to-one assignment of identities to people.
    pcp: Array | None  #: (Q,), share of correct parts, 0 for whom nobody is found; None without limbs.

    def __repr__(self) -> str:
        return (
            f"TrackScores({self.n_truth} person-frames, precision {100 * self.precision:.1f} %, "
            f"recall {100 * self.recall:.1f} %, mpjpe {self.mpjpe_mm:.1f} mm, "
            f"{self.identity_switches} identity switches, IDF1 {100 * self.idf1:.1f} %)"
        )


def track_scores(
    tracks: Sequence[Track],
    truth: ArrayLike,
    *,
    optional: ArrayLike | None = None,
    gate_mm: float = 500.0,
    limbs: Sequence[tuple[Endpoint, Endpoint]] | None = None,
    alpha: float = 0.5,
) -> TrackScores:
    """Score tracked people; needs SciPy, the extra ``evaluation``.

    The distance of an estimate from a person is the mean over the joints that both have; pairs up to
    `gate_mm` may be matched. Errors, precision, recall and PCP are of the assignment of least total distance
    in each frame by itself. Identities are those of CLEAR MOT (Bernardin & Stiefelhagen 2008): a pair of
    the frame before stays matched while it is within the gate, and the rest is assigned. IDF1 is that of
    Ristani et al. 2016.

    `tracks` are an identity ≥ 0, frames (F,), which index `truth`, and poses (F, N, 3) mm, all NaN = none; an
    identity may be given in several pieces. In `truth` (Q, T, N, 3) mm a person without any joint is absent.
    Person-frames that are `optional` (Q, T) need not be found: neither they nor estimates matched to them
    count. `limbs` and `alpha` are as in `skelsplat.metrics.pcp`; the published figures of Shelf and Campus
    take the nearest estimate instead of the assigned one, at any distance.
    """
    positive("gate_mm", gate_mm)
    people = as_poses(truth, "truth")
    if people.ndim != 4:
        raise InvalidInputError(f"truth: expected shape (Q, T, N, 3), got {people.shape}")
    waived = np.zeros(people.shape[:2], dtype=bool) if optional is None else flags(optional, "optional")
    if waived.shape != people.shape[:2]:
        raise InvalidInputError(f"optional: expected shape {people.shape[:2]}, got {waived.shape}")
    counted = present(people).any(axis=-1) & ~waived
    names, poses = _by_identity(tracks, people.shape[1:])
    distance = _distances(poses, people, gate_mm)  # (T, E, Q)
    index = np.full(counted.shape, -1, dtype=np.int64)
    error = np.full(counted.shape, np.nan)
    for t, cost in enumerate(distance):
        row, column = cheapest_pairs(cost).T
        index[column, t], error[column, t] = row, cost[row, column]
    hits, n_truth = int(((index >= 0) & counted).sum()), int(counted.sum())
    n_estimates = int(present(poses).any(axis=-1).sum()) - int(((index >= 0) & waived).sum())
    switches, fragments = _changes(_followed(distance), counted)
    wrong = (n_truth - hits) + (n_estimates - hits) + switches
    return TrackScores(
        matched=np.where(index >= 0, np.append(names, -1)[index], -1),
        error_mm=error,
        mpjpe_mm=float(error[counted & (index >= 0)].mean()) if hits else float("nan"),
        n_truth=n_truth,
        n_estimates=n_estimates,
        precision=share(hits, n_estimates),
        recall=share(hits, n_truth),
        identity_switches=switches,
        fragmentations=fragments,
        mota=1.0 - share(wrong, n_truth),
        idf1=_idf1(distance, counted, index, waived, n_estimates),
        pcp=None if limbs is None else _pcp(index, poses, people, counted, limbs, alpha),
    )


def share(part: float, whole: float) -> float:
    return part / whole if whole else float("nan")


def _by_identity(tracks: Sequence[Track], shape: tuple[int, ...]) -> tuple[Index, Array]:
    """Identities (E,) and poses (E, T, N, 3), NaN where there is none."""
    names = sorted({int(name) for name, _, _ in tracks})
    if names and names[0] < 0:
        raise InvalidInputError(f"tracks: expected identities >= 0, got {names[0]}")
    poses = np.full((len(names), *shape), np.nan)
    for k, (name, frames, pose) in enumerate(tracks):
        when, given = whole_numbers(frames, f"tracks[{k}]: frames"), as_poses(pose, f"tracks[{k}]: pose")
        if when.ndim != 1 or given.shape != (len(when), *shape[1:]):
            expected = f"a pose (F, {shape[1]}, 3) for F frames"
            raise InvalidInputError(f"tracks[{k}]: expected {expected}, got {given.shape} for {when.shape}")
        if ((when < 0) | (when >= shape[0])).any():
            raise InvalidInputError(f"tracks[{k}]: expected frames from 0 to {shape[0] - 1}, got {when}")
        own = poses[names.index(int(name))]
        if len(np.unique(when)) < len(when) or present(own[when]).any():
            raise InvalidInputError(f"tracks[{k}]: expected identity {name} once in a frame, got it twice")
        own[when] = given
    return np.array(names, dtype=np.int64), poses


def _distances(poses: Array, people: Array, gate_mm: float) -> Array:
    """Mean joint distance (T, E, Q) of what both have; infinite beyond the gate or without common joints."""
    gap = np.linalg.norm(poses[:, None] - people[None], axis=-1)
    common = ~np.isnan(gap)
    total, count = np.where(common, gap, 0.0).sum(axis=-1), common.sum(axis=-1)
    mean = np.where(count > 0, total / np.maximum(count, 1), np.inf)
    return np.where(mean <= gate_mm, mean, np.inf).transpose(2, 0, 1)


def cheapest_pairs(cost: Array) -> Index:
    """Rows and columns (K, 2) of the most pairs of finite cost, of these the least costly in total."""
    assign = require("scipy.optimize", "scores of tracked people", "evaluation").linear_sum_assignment
    allowed = np.isfinite(cost)
    if not allowed.any():
        return np.empty((0, 2), dtype=np.int64)
    # A forbidden pair costs more than all allowed ones together could save.
    dear = cost[allowed].max() + (np.ptp(cost[allowed]) + 1.0) * (min(cost.shape) + 1)
    pairs = np.stack(assign(np.where(allowed, cost, dear)), axis=1)
    kept: Index = pairs[allowed[pairs[:, 0], pairs[:, 1]]]
    return kept


def _followed(distance: Array) -> Index:
    """Estimate that follows each person (Q, T), −1 = none: a pair is kept while it is within the gate."""
    n_frames, _, n_people = distance.shape
    out = np.full((n_people, n_frames), -1, dtype=np.int64)
    last = np.full(n_people, -1, dtype=np.int64)
    for t, cost in enumerate(distance):
        rest = cost.copy()
        for q in np.flatnonzero(last >= 0):
            if np.isfinite(cost[last[q], q]):
                out[q, t] = last[q]
                rest[last[q]], rest[:, q] = np.inf, np.inf
        row, column = cheapest_pairs(rest).T
        out[column, t] = row
        last = out[:, t]
    return out


def _changes(followed: Index, counted: Mask) -> tuple[int, int]:
    """Identity switches and fragmentations, in the frames in which the people count."""
    switches = fragments = 0
    for own, frames in zip(followed, counted, strict=True):
        states = own[frames]
        names = states[states >= 0]
        switches += int((names[1:] != names[:-1]).sum())
        fragments += int((np.diff(np.flatnonzero(states >= 0)) > 1).sum())
    return switches, fragments


def _idf1(distance: Array, counted: Mask, index: Index, waived: Mask, n_estimates: int) -> float:
    """F1 of the person-frames that are found under the best one-to-one assignment of identities to people.

    An estimate that its frame alone matches to an optional person-frame (`index`, `waived`) counts if it is
    found under that assignment.
    """
    there = np.isfinite(distance) & counted.T[:, None]  # (T, E, Q)
    row, column = cheapest_pairs(-there.sum(axis=0).astype(np.float64)).T
    found = np.zeros(there.shape[:2], dtype=bool)
    found[:, row] = there[:, row, column]
    person, frame = np.nonzero((index >= 0) & waived)
    n_estimates += int(found[frame, index[person, frame]].sum())
    return share(2 * int(found.sum()), int(counted.sum()) + n_estimates)


def _pcp(
    index: Index,
    poses: Array,
    people: Array,
    counted: Mask,
    limbs: Sequence[tuple[Endpoint, Endpoint]],
    alpha: float,
) -> Array:
    """Share of correct parts of each person, (Q,)."""
    found = np.full(people.shape, np.nan)
    person, frame = np.nonzero(index >= 0)
    found[person, frame] = poses[index[person, frame], frame]
    judged = np.where(counted[..., None, None], people, np.nan)
    return np.array([pcp(f, p, limbs, alpha=alpha) for f, p in zip(found, judged, strict=True)])

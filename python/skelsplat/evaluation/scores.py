"""From poses to figures: errors of one method over all cases, by column, by joint, with intervals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from skelsplat import metrics
from skelsplat._arrays import Array, Mask, generator, numbers
from skelsplat._skelsplat import Layout
from skelsplat.datasets import Take
from skelsplat.evaluation.methods import Solution
from skelsplat.evaluation.protocols import Case, Protocol
from skelsplat.exceptions import DatasetError, InvalidInputError

PCK_MM = (50, 100, 150)
RESAMPLES = 2000
_KINDS = ("absolute", "relative", "procrustes")


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean and its 95 % interval by bootstrap over takes; NaN where there is none."""

    mean: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Group:
    """Means over a column or a joint: mm, and PCP as a share; NaN where nothing counts."""

    poses: int
    absolute: float
    relative: float
    procrustes: float
    pcp: float


@dataclass(frozen=True, slots=True)
class Scores:
    """Figures of one method."""

    method: str
    absolute_poses: int  #: poses whose absolute error counts
    poses: int  #: all poses
    #: absolute, relative, procrustes: MPJPE, mm, over all joints with a position; the others are `missing`.
    absolute: Estimate
    relative: Estimate
    procrustes: Estimate
    median: float  #: of the absolute joint errors, mm
    pck: Mapping[int, float]  #: by threshold, mm: share of the joints at most so far off; missing are not
    pcp: float  #: share of correct parts; NaN if the protocol has none
    missing: float  #: share of the joints that the method leaves without a position
    acceleration: float  #: error of it, m/s², where frames are consecutive and their rate is known; else NaN
    ms_per_pose: float  #: wall time of the method alone
    columns: Mapping[str, Group]  #: by column of the protocol
    joints: Mapping[str, Group]  #: by joint of the layout


FIGURES: Mapping[str, Callable[[Scores], float]] = {
    "poses": lambda s: s.poses,
    "absolute_mm": lambda s: s.absolute.mean,
    "absolute_low_mm": lambda s: s.absolute.low,
    "absolute_high_mm": lambda s: s.absolute.high,
    "relative_mm": lambda s: s.relative.mean,
    "procrustes_mm": lambda s: s.procrustes.mean,
    "median_mm": lambda s: s.median,
    **{f"pck_{mm}": partial(lambda s, mm: s.pck[mm], mm=mm) for mm in PCK_MM},
    "pcp": lambda s: s.pcp,
    "missing": lambda s: s.missing,
    "acceleration_m_s2": lambda s: s.acceleration,
    "ms_per_pose": lambda s: s.ms_per_pose,
}
"""The figures that are written about a method, over all its poses; shares are from 0 to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class _Errors:
    """Of one case: (T, N), parts (T, L); NaN where something does not count."""

    absolute: Array
    relative: Array
    procrustes: Array
    missing: Array
    acceleration: Array
    pck: Mapping[int, Array]
    parts: Array


def score(
    method: str, cases: Sequence[Case], solutions: Sequence[Solution], layout: Layout, protocol: Protocol
) -> Scores:
    """Score the poses of one method, one solution per case.

    Raises `DatasetError` if the protocol counts visible joints and a take does not say which are.
    """
    errors = [
        _errors(case, solution.pose, layout, protocol)
        for case, solution in zip(cases, solutions, strict=True)
    ]
    poses = sum(len(case.take) for case in cases)
    columns = {
        key: _group([e for e, case in zip(errors, cases, strict=True) if case.column == key])
        for key in protocol.headers(cases)
    }
    every = _group(errors)
    return Scores(
        method=method,
        absolute_poses=sum(len(case.take) for case in cases if case.absolute),
        poses=poses,
        **{kind: _estimate([getattr(e, kind) for e in errors]) for kind in _KINDS},
        median=_mean([e.absolute for e in errors], np.median),
        pck={limit: _mean([e.pck[limit] for e in errors]) for limit in PCK_MM},
        pcp=_mean([np.array([g.pcp for g in columns.values()])]) if protocol.mean_of_columns else every.pcp,
        missing=_mean([e.missing for e in errors]),
        acceleration=_mean([e.acceleration for e in errors]),
        ms_per_pose=1e3 * sum(solution.seconds for solution in solutions) / poses,
        columns=columns,
        joints={name: _group(errors, joint=j) for j, name in enumerate(layout.joints)},
    )


def _errors(case: Case, pose: Array, layout: Layout, protocol: Protocol) -> _Errors:
    take = case.take
    truth, found = take.truth * take.rig.mm_per_unit, pose * take.rig.mm_per_unit
    root = layout.root if protocol.root is None else protocol.root
    counts = _counted(take, protocol.min_visible_views)

    def absolute(values: Array) -> Array:
        return np.where(counts & case.absolute, values, np.nan)

    parts = np.full((len(take), 1), np.nan)
    if protocol.parts:
        parts = metrics.pcp(found, truth, protocol.parts, reduce="none")
    relative = metrics.root_relative_mpjpe(found, truth, root=root, reduce="none")
    return _Errors(
        absolute=absolute(metrics.mpjpe(found, truth, reduce="none")),
        relative=np.where(counts, relative, np.nan),
        procrustes=np.where(counts, metrics.pa_mpjpe(found, truth, reduce="none"), np.nan),
        missing=np.where(counts, metrics.missing_rate(found, truth, reduce="none"), np.nan),
        acceleration=absolute(_acceleration(take, found - truth)),
        pck={mm: absolute(metrics.pck(found, truth, threshold_mm=mm, reduce="none")) for mm in PCK_MM},
        parts=parts,
    )


def _acceleration(take: Take, error: Array) -> Array:
    """Lengths (T, N), m/s², of the second differences of errors (T, N, 3) mm about their middle frames."""
    out = np.full(error.shape[:2], np.nan)
    if take.fps is not None and len(take) > 2:
        follows = take.frames[2:] - take.frames[:-2] == 2
        second = np.linalg.norm(np.diff(error, n=2, axis=0), axis=-1) * take.fps**2 / 1000.0
        out[1:-1] = np.where(follows[:, None], second, np.nan)
    return out


def _counted(take: Take, least: int) -> Mask:
    """Whether each joint (T, N) counts: at least `least` views see it unoccluded."""
    if least == 0:
        return np.ones(take.truth.shape[:2], dtype=np.bool_)
    if take.visible is None:
        raise DatasetError(take.key, "visible", "which joints are occluded, to count those seen", "nothing")
    return np.asarray(take.visible.sum(axis=1) >= least)


def _group(errors: Sequence[_Errors], joint: int | None = None) -> Group:
    """Means over some cases, of all joints or of one."""
    pick = slice(None) if joint is None else slice(joint, joint + 1)
    return Group(
        poses=sum(len(e.relative) for e in errors),
        **{kind: _mean([getattr(e, kind)[:, pick] for e in errors]) for kind in _KINDS},
        pcp=_mean([e.parts for e in errors]) if joint is None else float("nan"),
    )


def _estimate(values: Sequence[Array]) -> Estimate:
    sums = [float(np.nansum(v)) for v in values]
    return Estimate(_mean(values), *mean_interval(sums, [np.count_nonzero(~np.isnan(v)) for v in values]))


def _mean(values: Sequence[Array], mean: Callable[[Array], np.floating[Any]] = np.mean) -> float:
    """Mean of what is not NaN; NaN if nothing is."""
    flat: Array = np.concatenate([np.zeros(0), *(np.ravel(v) for v in values)])
    finite = flat[~np.isnan(flat)]
    return float(mean(finite)) if finite.size else float("nan")


def mean_interval(
    sums: ArrayLike, counts: ArrayLike, *, level: float = 0.95, resamples: int = RESAMPLES, seed: int = 0
) -> tuple[float, float]:
    """Return the percentile interval of Σ sums / Σ counts when whole takes are drawn with replacement.

    This is the bootstrap over takes: frames of one take are alike, takes are not. `sums` and `counts` (S,)
    are of each take the sum of what is averaged and its count; takes that count nothing are left out.
    `level` is the share of the resampled means inside the interval. It is NaN with fewer than two takes.
    Raises `InvalidInputError` for shapes that differ.
    """
    total, number = numbers(sums, "sums"), numbers(counts, "counts")
    if total.ndim != 1 or total.shape != number.shape:
        raise InvalidInputError(f"counts: expected shape {total.shape} (S,) as sums, got {number.shape}")
    used = number > 0
    n = np.count_nonzero(used)
    if n < 2:
        return float("nan"), float("nan")
    times = generator(seed).multinomial(n, np.full(n, 1.0 / n), size=resamples)
    means = (times @ total[used]) / (times @ number[used])
    low, high = np.quantile(means, [(1.0 - level) / 2.0, (1.0 + level) / 2.0])
    return float(low), float(high)

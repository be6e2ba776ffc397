"""Shares of joints, limbs or poses that meet a criterion, each from 0 to 1."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike

from skelsplat._arrays import Array, Mask, numbers
from skelsplat.exceptions import InvalidInputError
from skelsplat.metrics._arrays import (
    LARGEST,
    PartialReduce,
    Reduce,
    as_pair,
    centre,
    joint_errors,
    present,
    reduced,
    result,
    within,
)

Endpoint: TypeAlias = int | Sequence[int]


def _correct(good: Mask, judged: Mask) -> Array:
    """1 where `good`, 0 where not, NaN where there is nothing to judge."""
    return np.where(judged, np.where(good, 1.0, 0.0), np.nan)


@overload
def pck(
    pred: ArrayLike, gt: ArrayLike, *, threshold_mm: float = 150.0, reduce: Literal["mean"] = "mean"
) -> float: ...
@overload
def pck(pred: ArrayLike, gt: ArrayLike, *, threshold_mm: float = 150.0, reduce: PartialReduce) -> Array: ...
def pck(
    pred: ArrayLike, gt: ArrayLike, *, threshold_mm: float = 150.0, reduce: Reduce = "mean"
) -> float | Array:
    """Share of correct keypoints: joints at most `threshold_mm` from the truth. A missing joint is wrong.

    Parameters
    ----------
    threshold_mm : float
        Largest distance of a correct joint, mm.
    """
    predicted, truth = as_pair(pred, gt)
    if not (np.isfinite(threshold_mm) and threshold_mm >= 0):
        raise InvalidInputError(f"threshold_mm: expected a finite number >= 0, got {threshold_mm!r}")
    errors = joint_errors(predicted, truth)
    return result(_correct(errors <= threshold_mm, present(truth)), reduce)


@overload
def auc(
    pred: ArrayLike,
    gt: ArrayLike,
    *,
    thresholds_mm: Sequence[float] | None = None,
    reduce: Literal["mean"] = "mean",
) -> float: ...
@overload
def auc(
    pred: ArrayLike, gt: ArrayLike, *, thresholds_mm: Sequence[float] | None = None, reduce: PartialReduce
) -> Array: ...
def auc(
    pred: ArrayLike, gt: ArrayLike, *, thresholds_mm: Sequence[float] | None = None, reduce: Reduce = "mean"
) -> float | Array:
    """Area under the PCK curve: the mean of `pck` over thresholds, by default 0, 5, …, 150 mm (31 of them).

    Parameters
    ----------
    thresholds_mm : sequence of float, optional
        The thresholds, mm.
    """
    thresholds = (
        np.arange(0.0, 151.0, 5.0) if thresholds_mm is None else numbers(thresholds_mm, "thresholds_mm")
    )
    if thresholds.ndim != 1 or thresholds.size == 0:
        raise InvalidInputError(f"thresholds_mm: expected a sequence of numbers, got {thresholds_mm!r}")
    curve = [pck(pred, gt, threshold_mm=float(limit), reduce="none") for limit in thresholds]
    return result(np.mean(curve, axis=0), reduce)


@overload
def pcp(
    pred: ArrayLike,
    gt: ArrayLike,
    limbs: Sequence[tuple[Endpoint, Endpoint]],
    *,
    alpha: float = 0.5,
    reduce: Literal["mean"] = "mean",
) -> float: ...
@overload
def pcp(
    pred: ArrayLike,
    gt: ArrayLike,
    limbs: Sequence[tuple[Endpoint, Endpoint]],
    *,
    alpha: float = 0.5,
    reduce: PartialReduce,
) -> Array: ...
def pcp(
    pred: ArrayLike,
    gt: ArrayLike,
    limbs: Sequence[tuple[Endpoint, Endpoint]],
    *,
    alpha: float = 0.5,
    reduce: Reduce = "mean",
) -> float | Array:
    """Share of correct parts: limbs whose two endpoint errors have a mean of at most `alpha` · true length.

    A limb with a missing endpoint is wrong; one whose true endpoint is missing is excluded.

    Parameters
    ----------
    limbs : sequence of (a, b)
        Endpoints, each a joint or the joints whose mean it is, as in ``((2, 3), 12)`` for hip centre to head.
    alpha : float
        Allowed error as a share of the limb's length; 0.5 on Shelf and Campus.
    reduce : "mean", "per_joint" (here: per limb), "per_pose" or "none"
    """
    predicted, truth = as_pair(pred, gt)
    if not (np.isfinite(alpha) and alpha >= 0):
        raise InvalidInputError(f"alpha: expected a finite number >= 0, got {alpha!r}")
    if len(limbs) == 0:
        raise InvalidInputError("limbs: expected at least one pair of joints, got none")
    parts = []
    for k, limb in enumerate(limbs):
        if len(limb) != 2:
            raise InvalidInputError(f"limbs[{k}]: expected two endpoints, got {limb!r}")
        ends = [(centre(predicted, end, f"limbs[{k}]"), centre(truth, end, f"limbs[{k}]")) for end in limb]
        error = sum(np.linalg.norm(p - g, axis=-1) for p, g in ends) / 2.0
        length = np.linalg.norm(ends[0][1] - ends[1][1], axis=-1)
        parts.append(_correct(error <= alpha * length, ~np.isnan(length)))
    return result(np.stack(parts, axis=-1), reduce)


def sigma_coverage(
    pred: ArrayLike,
    covariance: ArrayLike,
    gt: ArrayLike,
    *,
    sigmas: Sequence[float] = (1.0, 2.0, 3.0),
    reduce: Reduce = "mean",
) -> Array:
    """Share of the joints whose truth lies within k standard deviations of the prediction, for each k.

    "Within k" is a Mahalanobis distance of at most k (paper, section 5). If the errors were Gaussian with
    these covariances the shares at 1, 2, 3 would be 0.199, 0.739, 0.971: three dimensions, not one.
    Joints without a prediction or a covariance are left out, like those without ground truth.

    Parameters
    ----------
    covariance : (…, N, 3, 3) mm²
        Symmetric positive definite; NaN = missing.
    sigmas : sequence of float
        The k, S of them.

    Returns
    -------
    (S,), (S, N), (S, …) or (S, …, N), as `reduce` says.
    """
    predicted, truth = as_pair(pred, gt)
    distance = _mahalanobis(predicted - truth, numbers(covariance, "covariance"))
    judged = ~np.isnan(distance)
    return np.stack([reduced(_correct(distance <= k, judged), reduce) for k in sigmas])


def _mahalanobis(offset: Array, covariance: Array) -> Array:
    """√(offsetᵀ Σ⁻¹ offset), (…, N); NaN where the offset or Σ is."""
    expected = (*offset.shape, 3)
    if covariance.shape != expected:
        raise InvalidInputError(f"covariance: expected shape {expected}, got {covariance.shape}")
    within(covariance, LARGEST**2, "covariance")
    known = np.isfinite(covariance).all(axis=(-2, -1)) & present(offset)
    sigma = np.where(known[..., None, None], covariance, np.eye(3))
    size = np.abs(sigma).max(axis=(-2, -1))
    skew = np.abs(sigma - np.swapaxes(sigma, -1, -2)).max(axis=(-2, -1))
    # 1e-9 of the largest entry: far above rounding, far below any asymmetry that a mistake makes.
    bad = (np.linalg.eigvalsh(sigma)[..., 0] <= 0) | (skew > 1e-9 * size)
    if bad.any():
        first = tuple(int(i) for i in np.argwhere(bad)[0])
        raise InvalidInputError(
            f"covariance[{', '.join(map(str, first))}]: expected a symmetric positive definite matrix, "
            f"got {sigma[first].tolist()}"
        )
    safe = np.where(known[..., None], offset, 0.0)
    solved = np.linalg.solve(sigma, safe[..., None])[..., 0]
    squared = np.einsum("...i,...i->...", safe, solved)
    return np.where(known, np.sqrt(np.maximum(squared, 0.0)), np.nan)

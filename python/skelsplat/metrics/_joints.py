"""Distances between predicted and true joints, and shares of joints or limbs that meet a criterion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from skelsplat._arrays import Array, Mask, numbers
from skelsplat.exceptions import InvalidInputError, one_of

Reduce: TypeAlias = Literal["mean", "per_joint", "per_pose", "none"]
Mean: TypeAlias = Any
"""A float if everything is averaged, else an array."""
Endpoint: TypeAlias = int | Sequence[int]

# Products of coordinates up to it, and sums of them, are doubles; LAPACK may not return from what overflows.
_LARGEST = 1e100


def mpjpe(pred: ArrayLike, gt: ArrayLike, *, reduce: Reduce = "mean") -> Mean:
    """Mean per-joint position error in absolute coordinates, mm (paper, section 4)."""
    return result(_distance(*_pair(pred, gt)), reduce)


def root_relative_mpjpe(pred: ArrayLike, gt: ArrayLike, *, root: Endpoint, reduce: Reduce = "mean") -> Mean:
    """Mean per-joint position error after moving both roots to the origin, mm.

    `root` is the root joint, or the joints whose mean it is (``layout.root``). The root itself stays in the
    mean (with error 0), as is the field's habit. A pose whose root is missing has no root-relative joints:
    all of them count as missing.
    """
    predicted, truth = (pose - _centre(pose, root, "root")[..., None, :] for pose in _pair(pred, gt))
    return result(_distance(predicted, truth), reduce)


def pa_mpjpe(pred: ArrayLike, gt: ArrayLike, *, reduce: Reduce = "mean") -> Mean:
    """Mean per-joint position error after Procrustes alignment of each pose, mm.

    The alignment is the similarity (rotation, translation, one scale; no reflection) with the least squared
    distance over the joints present in both poses; a pose with fewer than three of them has no alignment and
    counts as missing.
    """
    predicted, truth = _pair(pred, gt)
    return result(_distance(_aligned(predicted, truth), truth), reduce)


def missing_rate(pred: ArrayLike, gt: ArrayLike, *, reduce: Reduce = "mean") -> Mean:
    """Share of the joints with ground truth that have no prediction, 0 to 1.

    The companion of the distances, which leave missing joints out.
    """
    predicted, truth = _pair(pred, gt)
    return result(_correct(~present(predicted), present(truth)), reduce)


def pck(pred: ArrayLike, gt: ArrayLike, *, threshold_mm: float = 150.0, reduce: Reduce = "mean") -> Mean:
    """Share of correct keypoints: joints at most `threshold_mm` from the truth. A missing joint is wrong."""
    predicted, truth = _pair(pred, gt)
    _check_limit(threshold_mm, "threshold_mm")
    errors = _distance(predicted, truth)
    return result(_correct(errors <= threshold_mm, present(truth)), reduce)


def auc(
    pred: ArrayLike, gt: ArrayLike, *, thresholds_mm: Sequence[float] | None = None, reduce: Reduce = "mean"
) -> Mean:
    """Area under the PCK curve: the mean of `pck` over thresholds, by default 0, 5, …, 150 mm."""
    given = np.arange(0.0, 151.0, 5.0) if thresholds_mm is None else thresholds_mm
    thresholds = numbers(given, "thresholds_mm")
    if thresholds.ndim != 1 or thresholds.size == 0:
        raise InvalidInputError(f"thresholds_mm: expected a sequence of numbers, got {thresholds_mm!r}")
    curve = [pck(pred, gt, threshold_mm=float(limit), reduce="none") for limit in thresholds]
    return result(np.mean(curve, axis=0), reduce)


def pcp(
    pred: ArrayLike,
    gt: ArrayLike,
    limbs: Sequence[tuple[Endpoint, Endpoint]],
    *,
    alpha: float = 0.5,
    reduce: Reduce = "mean",
) -> Mean:
    """Share of correct parts: limbs whose two endpoint errors have a mean of at most `alpha` · true length.

    A limb with a missing endpoint is wrong; one whose true endpoint is missing is excluded. An endpoint is a
    joint or the joints whose mean it is, as in ``((2, 3), 12)`` for hip centre to head; `alpha` is 0.5 on
    Shelf and Campus. `reduce` ``"per_joint"`` is per limb.
    """
    predicted, truth = _pair(pred, gt)
    _check_limit(alpha, "alpha")
    if len(limbs) == 0:
        raise InvalidInputError("limbs: expected at least one pair of joints, got none")
    parts = []
    for k, limb in enumerate(limbs):
        if len(limb) != 2:
            raise InvalidInputError(f"limbs[{k}]: expected two endpoints, got {limb!r}")
        ends = [(_centre(predicted, end, f"limbs[{k}]"), _centre(truth, end, f"limbs[{k}]")) for end in limb]
        error = sum(_distance(p, g) for p, g in ends) / 2.0
        length = _distance(ends[0][1], ends[1][1])
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

    `covariance` is (…, N, 3, 3) mm², symmetric positive definite, NaN = missing. For S `sigmas` the result is
    (S,), (S, N), (S, …) or (S, …, N), as `reduce` says.
    """
    predicted, truth = _pair(pred, gt)
    distance = _mahalanobis(predicted - truth, numbers(covariance, "covariance"))
    judged = ~np.isnan(distance)
    return np.stack([result(_correct(distance <= k, judged), reduce) for k in sigmas])


def as_poses(value: ArrayLike, name: str) -> Array:
    """Return `value` as float64 (…, N, 3), or raise `InvalidInputError`; NaN passes, infinity does not."""
    array = numbers(value, name)
    if array.ndim < 2 or array.shape[-1] != 3:
        raise InvalidInputError(f"{name}: expected shape (..., N, 3), got {array.shape}")
    if np.isinf(array).any():
        raise InvalidInputError(f"{name}: expected finite numbers or NaN, got infinity")
    _check_size(array, _LARGEST, name)
    return array


def present(points: Array) -> Mask:
    """Whether each joint has all its coordinates, (…, N)."""
    return np.logical_not(np.isnan(points).any(axis=-1))


def result(values: Array, reduce: Reduce) -> Mean:
    """Mean of `values` (…, N) without the NaNs, over the axes that `reduce` names (see the package)."""
    axes: dict[str, tuple[int, ...]] = {
        "mean": tuple(range(values.ndim)),
        "per_joint": tuple(range(values.ndim - 1)),
        "per_pose": (values.ndim - 1,),
        "none": (),
    }
    one_of("reduce", reduce, axes)
    if reduce == "none":
        return values
    valid = ~np.isnan(values)
    total = np.where(valid, values, 0.0).sum(axis=axes[reduce])
    count = valid.sum(axis=axes[reduce])
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return float(mean) if reduce == "mean" else mean


def _pair(pred: ArrayLike, gt: ArrayLike) -> tuple[Array, Array]:
    """Prediction and ground truth as arrays of one shape (…, N, 3)."""
    truth, predicted = as_poses(gt, "gt"), as_poses(pred, "pred")
    if predicted.shape != truth.shape:
        raise InvalidInputError(f"pred: expected the shape of gt {truth.shape}, got {predicted.shape}")
    return predicted, truth


def _check_size(array: Array, largest: float, name: str) -> None:
    """Refuse finite numbers beyond ±`largest`."""
    too_large = (np.abs(array) > largest) & np.isfinite(array)
    if too_large.any():
        place = tuple(np.argwhere(too_large)[0].tolist())
        expected = f"numbers from -{largest:g} to {largest:g}"
        raise InvalidInputError(
            f"{name}[{', '.join(map(str, place))}]: expected {expected}, got {array[place]:g}"
        )


def _check_limit(value: float, name: str) -> None:
    if not (np.isfinite(value) and value >= 0):
        raise InvalidInputError(f"{name}: expected a finite number >= 0, got {value!r}")


def _distance(a: Array, b: Array) -> Array:
    """Distance per joint (…, N); NaN where either is missing."""
    return np.asarray(np.linalg.norm(a - b, axis=-1))


def _correct(good: Mask, judged: Mask) -> Array:
    """1 where `good`, 0 where not, NaN where there is nothing to judge."""
    return np.where(judged, np.where(good, 1.0, 0.0), np.nan)


def _centre(points: Array, indices: Endpoint, name: str) -> Array:
    """Mean of the joints `indices`, (…, 3)."""
    given = np.asanyarray(indices)
    chosen = np.atleast_1d(np.asarray(given))
    n_joints = points.shape[-2]
    whole = np.issubdtype(given.dtype, np.integer) and not np.ma.is_masked(given)
    if chosen.ndim != 1 or chosen.size == 0 or not whole:
        raise InvalidInputError(f"{name}: expected a joint index or a sequence of them, got {indices!r}")
    if (chosen < 0).any() or (chosen >= n_joints).any():
        raise InvalidInputError(f"{name}: expected joint indices from 0 to {n_joints - 1}, got {indices!r}")
    return np.asarray(points[..., chosen, :].mean(axis=-2))


def _aligned(pred: Array, gt: Array) -> Array:
    """Move each pose of `pred` onto `gt` by the best similarity (Umeyama 1991, equations 39–43)."""
    used = present(pred) & present(gt)
    count = np.maximum(used.sum(axis=-1), 1)[..., None, None]
    source = np.where(used[..., None], pred, 0.0)
    target = np.where(used[..., None], gt, 0.0)
    source_mean = source.sum(axis=-2, keepdims=True) / count
    target_mean = target.sum(axis=-2, keepdims=True) / count
    source = np.where(used[..., None], source - source_mean, 0.0)
    target = np.where(used[..., None], target - target_mean, 0.0)

    u, singular, vt = np.linalg.svd(np.swapaxes(target, -1, -2) @ source)
    sign = np.ones_like(singular)
    sign[..., -1] = np.where(np.linalg.det(u @ vt) < 0, -1.0, 1.0)
    rotation = (u * sign[..., None, :]) @ vt
    spread = (source**2).sum(axis=(-2, -1))
    # All predicted joints in one point: any scale is as good as another.
    scale = np.where(spread > 0, (singular * sign).sum(axis=-1) / np.where(spread > 0, spread, 1.0), 1.0)
    moved = scale[..., None, None] * (source @ np.swapaxes(rotation, -1, -2)) + target_mean
    enough = used & (used.sum(axis=-1, keepdims=True) >= 3)
    return np.where(enough[..., None], moved, np.nan)


def _mahalanobis(offset: Array, covariance: Array) -> Array:
    """√(offsetᵀ Σ⁻¹ offset), (…, N); NaN where the offset or Σ is."""
    expected = (*offset.shape, 3)
    if covariance.shape != expected:
        raise InvalidInputError(f"covariance: expected shape {expected}, got {covariance.shape}")
    _check_size(covariance, _LARGEST**2, "covariance")
    known = np.isfinite(covariance).all(axis=(-2, -1)) & present(offset)
    sigma = np.where(known[..., None, None], covariance, np.eye(3))
    size = np.abs(sigma).max(axis=(-2, -1))
    skew = np.abs(sigma - np.swapaxes(sigma, -1, -2)).max(axis=(-2, -1))
    # 1e-9 of the largest entry: far above rounding, far below any asymmetry that a mistake makes.
    bad = (np.linalg.eigvalsh(sigma)[..., 0] <= 0) | (skew > 1e-9 * size)
    if bad.any():
        first = tuple(np.argwhere(bad)[0].tolist())
        raise InvalidInputError(
            f"covariance[{', '.join(map(str, first))}]: expected a symmetric positive definite matrix, "
            f"got {sigma[first].tolist()}"
        )
    safe = np.where(known[..., None], offset, 0.0)
    solved = np.linalg.solve(sigma, safe[..., None])[..., 0]
    squared = np.einsum("...i,...i->...", safe, solved)
    return np.where(known, np.sqrt(np.maximum(squared, 0.0)), np.nan)

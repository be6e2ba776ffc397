"""Distances between predicted and true joints, absolute and after an alignment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from skelsplat._arrays import Array
from skelsplat.metrics._arrays import PartialReduce, Reduce, as_pair, centre, joint_errors, present, result


@overload
def mpjpe(pred: ArrayLike, gt: ArrayLike, *, reduce: Literal["mean"] = "mean") -> float: ...
@overload
def mpjpe(pred: ArrayLike, gt: ArrayLike, *, reduce: PartialReduce) -> Array: ...
def mpjpe(pred: ArrayLike, gt: ArrayLike, *, reduce: Reduce = "mean") -> float | Array:
    """Mean per-joint position error in absolute coordinates, mm (paper, section 4)."""
    return result(joint_errors(*as_pair(pred, gt)), reduce)


@overload
def root_relative_mpjpe(
    pred: ArrayLike, gt: ArrayLike, *, root: int | Sequence[int], reduce: Literal["mean"] = "mean"
) -> float: ...
@overload
def root_relative_mpjpe(
    pred: ArrayLike, gt: ArrayLike, *, root: int | Sequence[int], reduce: PartialReduce
) -> Array: ...
def root_relative_mpjpe(
    pred: ArrayLike, gt: ArrayLike, *, root: int | Sequence[int], reduce: Reduce = "mean"
) -> float | Array:
    """Mean per-joint position error after moving both roots to the origin, mm.

    The root joint itself stays in the mean (with error 0), as is the field's habit. A pose whose root is
    missing has no root-relative joints: all of them count as missing.

    Parameters
    ----------
    root : int or sequence of int
        The root joint, or the joints whose mean is the root (``layout.root``).
    """
    predicted, truth = as_pair(pred, gt)
    predicted = predicted - centre(predicted, root, "root")[..., None, :]
    truth = truth - centre(truth, root, "root")[..., None, :]
    return result(joint_errors(predicted, truth), reduce)


@overload
def pa_mpjpe(pred: ArrayLike, gt: ArrayLike, *, reduce: Literal["mean"] = "mean") -> float: ...
@overload
def pa_mpjpe(pred: ArrayLike, gt: ArrayLike, *, reduce: PartialReduce) -> Array: ...
def pa_mpjpe(pred: ArrayLike, gt: ArrayLike, *, reduce: Reduce = "mean") -> float | Array:
    """Mean per-joint position error after Procrustes alignment of each pose, mm.

    The alignment is the similarity (rotation, translation, one scale; no reflection) with the least squared
    distance over the joints present in both poses; a pose with fewer than three of them has no alignment and
    counts as missing.
    """
    predicted, truth = as_pair(pred, gt)
    return result(joint_errors(_aligned(predicted, truth), truth), reduce)


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


@overload
def missing_rate(pred: ArrayLike, gt: ArrayLike, *, reduce: Literal["mean"] = "mean") -> float: ...
@overload
def missing_rate(pred: ArrayLike, gt: ArrayLike, *, reduce: PartialReduce) -> Array: ...
def missing_rate(pred: ArrayLike, gt: ArrayLike, *, reduce: Reduce = "mean") -> float | Array:
    """Share of the joints with ground truth that have no prediction, 0 to 1.

    The companion of the distances, which leave missing joints out.
    """
    predicted, truth = as_pair(pred, gt)
    missing = np.where(present(truth), np.where(present(predicted), 0.0, 1.0), np.nan)
    return result(missing, reduce)

"""What the metrics share: checked inputs, joint errors, means that know about missing values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from skelsplat._arrays import Array, Mask, numbers
from skelsplat.exceptions import InvalidInputError, one_of

PartialReduce: TypeAlias = Literal["per_joint", "per_pose", "none"]
Reduce: TypeAlias = Literal["mean", "per_joint", "per_pose", "none"]


# Products of coordinates up to it, and sums of them, are doubles; LAPACK may not return from what overflows.
LARGEST = 1e100


def as_poses(value: ArrayLike, name: str) -> Array:
    """Return `value` as float64 (…, N, 3), or raise `InvalidInputError`; NaN passes, infinity does not."""
    array = numbers(value, name)
    if array.ndim < 2 or array.shape[-1] != 3:
        raise InvalidInputError(f"{name}: expected shape (..., N, 3), got {array.shape}")
    if np.isinf(array).any():
        raise InvalidInputError(f"{name}: expected finite numbers or NaN, got infinity")
    within(array, LARGEST, name)
    return array


def within(array: Array, largest: float, name: str) -> None:
    """Refuse finite numbers beyond ±`largest`."""
    too_large = (np.abs(array) > largest) & np.isfinite(array)
    if too_large.any():
        place = tuple(int(i) for i in np.argwhere(too_large)[0])
        expected = f"numbers from -{largest:g} to {largest:g}"
        raise InvalidInputError(
            f"{name}[{', '.join(map(str, place))}]: expected {expected}, got {array[place]:g}"
        )


def as_pair(pred: ArrayLike, gt: ArrayLike) -> tuple[Array, Array]:
    """Return prediction and ground truth as arrays of one shape (…, N, 3)."""
    truth = as_poses(gt, "gt")
    predicted = as_poses(pred, "pred")
    if predicted.shape != truth.shape:
        raise InvalidInputError(f"pred: expected the shape of gt {truth.shape}, got {predicted.shape}")
    return predicted, truth


def joint_errors(pred: Array, gt: Array) -> Array:
    """Distance per joint (…, N); NaN where either is missing."""
    distances: Array = np.linalg.norm(pred - gt, axis=-1)
    return distances


def present(points: Array) -> Mask:
    """Whether each joint has all its coordinates, (…, N)."""
    return np.logical_not(np.isnan(points).any(axis=-1))


def centre(points: Array, indices: int | Sequence[int], name: str) -> Array:
    """Mean of the joints `indices`, (…, 3)."""
    given = np.asanyarray(indices)
    chosen = np.atleast_1d(np.asarray(given))
    n_joints = points.shape[-2]
    whole = np.issubdtype(given.dtype, np.integer) and not np.ma.is_masked(given)
    if chosen.ndim != 1 or chosen.size == 0 or not whole:
        raise InvalidInputError(f"{name}: expected a joint index or a sequence of them, got {indices!r}")
    if (chosen < 0).any() or (chosen >= n_joints).any():
        raise InvalidInputError(f"{name}: expected joint indices from 0 to {n_joints - 1}, got {indices!r}")
    mean: Array = points[..., chosen, :].mean(axis=-2)
    return mean


def reduced(values: Array, reduce: Reduce) -> Array:
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
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def result(values: Array, reduce: Reduce) -> float | Array:
    """Reduce `values`, as a float when everything was averaged."""
    mean = reduced(values, reduce)
    return float(mean) if reduce == "mean" else mean

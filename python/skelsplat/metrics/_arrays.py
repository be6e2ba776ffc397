"""What the metrics share: checked inputs, joint errors, means that know about missing values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat.exceptions import InvalidInputError

FloatArray: TypeAlias = NDArray[np.float64]
PartialReduce: TypeAlias = Literal["per_joint", "per_pose", "none"]
Reduce: TypeAlias = Literal["mean", "per_joint", "per_pose", "none"]


def as_numbers(value: ArrayLike, name: str) -> FloatArray:
    """Return `value` as a float64 array, or raise `InvalidInputError`."""
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidInputError(f"{name}: expected an array of numbers, got {error}") from None


def as_poses(value: ArrayLike, name: str) -> FloatArray:
    """Return `value` as float64 (…, N, 3), or raise `InvalidInputError`; NaN passes, infinity does not."""
    array = as_numbers(value, name)
    if array.ndim < 2 or array.shape[-1] != 3:
        raise InvalidInputError(f"{name}: expected shape (..., N, 3), got {array.shape}")
    if np.isinf(array).any():
        raise InvalidInputError(f"{name}: expected finite numbers or NaN, got infinity")
    return array


def as_pair(pred: ArrayLike, gt: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return prediction and ground truth as arrays of one shape (…, N, 3)."""
    truth = as_poses(gt, "gt")
    predicted = as_poses(pred, "pred")
    if predicted.shape != truth.shape:
        raise InvalidInputError(f"pred: expected the shape of gt {truth.shape}, got {predicted.shape}")
    return predicted, truth


def joint_errors(pred: FloatArray, gt: FloatArray) -> FloatArray:
    """Distance per joint (…, N); NaN where either is missing."""
    distances: FloatArray = np.linalg.norm(pred - gt, axis=-1)
    return distances


def present(points: FloatArray) -> NDArray[np.bool_]:
    """Whether each joint has all its coordinates, (…, N)."""
    there: NDArray[np.bool_] = np.logical_not(np.isnan(points).any(axis=-1))
    return there


def centre(points: FloatArray, indices: int | Sequence[int], name: str) -> FloatArray:
    """Mean of the joints `indices`, (…, 3)."""
    chosen = np.atleast_1d(np.asarray(indices))
    n_joints = points.shape[-2]
    if chosen.ndim != 1 or chosen.size == 0 or not np.issubdtype(chosen.dtype, np.integer):
        raise InvalidInputError(f"{name}: expected a joint index or a sequence of them, got {indices!r}")
    if (chosen < 0).any() or (chosen >= n_joints).any():
        raise InvalidInputError(f"{name}: expected joint indices from 0 to {n_joints - 1}, got {indices!r}")
    mean: FloatArray = points[..., chosen, :].mean(axis=-2)
    return mean


def reduced(values: FloatArray, reduce: Reduce) -> FloatArray:
    """Mean of `values` (…, N) without the NaNs, over the axes that `reduce` names (see the package)."""
    axes: dict[str, tuple[int, ...]] = {
        "mean": tuple(range(values.ndim)),
        "per_joint": tuple(range(values.ndim - 1)),
        "per_pose": (values.ndim - 1,),
        "none": (),
    }
    if reduce not in axes:
        raise InvalidInputError(f"reduce: expected one of {', '.join(axes)}, got {reduce!r}")
    if reduce == "none":
        return values
    valid = ~np.isnan(values)
    total = np.where(valid, values, 0.0).sum(axis=axes[reduce])
    count = valid.sum(axis=axes[reduce])
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def result(values: FloatArray, reduce: Reduce) -> float | FloatArray:
    """Reduce `values`, as a float when everything was averaged."""
    mean = reduced(values, reduce)
    return float(mean) if reduce == "mean" else mean

"""A cut-out of constant size that follows the person."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from skelsplat.io.video import Size

    Array = npt.NDArray[np.float64]
    Flags = npt.NDArray[np.bool_]

_MARGIN = 0.15  # of the person's size, on every side
_LEAST_PX = 64.0
_CALM = 15  # frames over which the middle is averaged


def follow(points: Array, size: Size) -> tuple[Size, npt.NDArray[np.int64]]:
    """Return the size of the cut-out, and its upper left corner in each frame.

    Parameters
    ----------
    points : (T, N, 2)
        The person's joints in the pixels of the frames; NaN where unknown.
    size : (width, height)
        Of the frames.

    Returns
    -------
    size : (width, height)
        Enough for the person in 95 of 100 frames, with a margin; the whole frame if it is in none.
    corners : (T, 2) int
        x and y; the middle is averaged over frames and the cut-out stays within the frame.
    """
    limit = np.array(size)
    inside: Flags = np.all((points >= -0.5) & (points < limit - 0.5), axis=2)
    points = np.where(inside[..., None], points, np.nan)
    seen: Flags = np.any(inside, axis=1)
    if not seen.any():
        return size, np.zeros((len(points), 2), dtype=np.int64)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # frames without the person are NaN
        low, high = np.nanmin(points, axis=1), np.nanmax(points, axis=1)
    extent = np.quantile((high - low)[seen], 0.95, axis=0)
    wanted = np.maximum(extent * (1 + 2 * _MARGIN), np.maximum(_LEAST_PX, 0.25 * extent[::-1]))
    cut = np.minimum(np.ceil(wanted / 2) * 2, limit).astype(np.int64)
    corners = np.rint(_calm((low + high) / 2, seen) - (cut - 1) / 2).astype(np.int64)
    return (int(cut[0]), int(cut[1])), np.clip(corners, 0, limit - cut)


def _calm(middle: Array, seen: Flags) -> Array:
    """Fill the frames without the person by the nearest ones in time, and average over `_CALM` frames."""
    times = np.arange(len(middle))
    whole = np.stack([np.interp(times, times[seen], axis[seen]) for axis in middle.T], axis=1)
    reach = min(_CALM, len(middle)) // 2
    padded = np.pad(whole, [(reach, reach), (0, 0)], mode="edge")
    kernel = np.full(2 * reach + 1, 1 / (2 * reach + 1))
    return np.stack([np.convolve(axis, kernel, mode="valid") for axis in padded.T], axis=1)

"""Poses over time: gaps filled and noise filtered, on request and never by default.

All functions take a ``pose`` (T, N, 3) with NaN for what is missing, leave it as it is, and never carry
anything across missing positions that they do not fill. ``frame_rate`` is in frames per second; ``frames``
(T,) are the ascending numbers of the frames, by default 0, 1, …; a gap in the numbers is a gap in time.
``weak`` (T, N) marks positions that are not to be trusted (the status ``weak`` of a refinement): a filter
leaves them as they are, and they do not pull on those around them. Cubic splines and the Butterworth filter
need SciPy: ``pip install 'skelsplat[temporal]'``. A bad argument is an `InvalidInputError` that names it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from skelsplat import _arrays
from skelsplat._arrays import Array, Index, Mask
from skelsplat._optional import require
from skelsplat.exceptions import InvalidInputError, one_of

METHODS = ("cubic", "linear")


def fill_gaps(
    pose: npt.ArrayLike,
    max_gap: int,
    *,
    method: str = "cubic",
    frames: npt.ArrayLike | None = None,
    gaps: npt.ArrayLike | None = None,
) -> tuple[Array, Mask]:
    """Interpolate every joint over gaps of at most ``max_gap`` frames, counted in frame numbers.

    A gap lies between two frames in which the joint is known. It is filled from a cubic spline through all
    these frames, or from straight lines. ``gaps`` (T, N) is what to replace, if that is more than what is
    missing; a gap that is too long keeps what it had.

    Returns
    -------
    pose : (T, N, 3)
    filled : (T, N) bool
        Where a position was put in.
    """
    positions, numbers = _checked(pose, frames)
    if max_gap < 1:
        raise InvalidInputError(f"max_gap: expected at least 1 frame, got {max_gap}")
    one_of("method", method, METHODS)
    known = _known(positions) & ~_marked("gaps", gaps, positions.shape[:2])
    filled = np.zeros_like(known)
    for j, there in enumerate(known.T):
        at = filled[:, j] = _short_gaps(there, numbers, max_gap)
        if at.any():
            positions[at, j] = _interpolated(numbers[there], positions[there, j], numbers[at], method)
    return positions, filled


def butterworth(
    pose: npt.ArrayLike,
    frame_rate: float,
    cutoff: float = 6.0,
    *,
    order: int = 4,
    frames: npt.ArrayLike | None = None,
    weak: npt.ArrayLike | None = None,
) -> tuple[Array, Mask]:
    """Low-pass every joint with a Butterworth filter run forwards and backwards, so without lag.

    The amplitude at ``cutoff`` Hz is 1/√2 (−3 dB) after both passes, whose order together is 2, 4, 6 or 8.
    Between trusted positions a straight line stands in for ``weak`` ones, over a stretch of any length.

    Returns
    -------
    pose : (T, N, 3)
    left : (T, N) bool
        Positions that were left as they are: weak ones, and those of a run of frames without a gap that is
        too short to filter.
    """
    positions, numbers = _checked(pose, frames)
    if order not in (2, 4, 6, 8):
        raise InvalidInputError(f"order: expected 2, 4, 6 or 8 (both passes together), got {order}")
    _arrays.positive("frame_rate", frame_rate)
    if not 0.0 < cutoff < frame_rate / 2:
        limit = f"above 0 and below half the frame rate, {frame_rate / 2:g} Hz"
        raise InvalidInputError(f"cutoff: expected a frequency {limit}, got {cutoff:g}")
    signal = require("scipy.signal", "the Butterworth filter", "temporal")
    sections = signal.butter(order // 2, _single_pass(cutoff, frame_rate, order // 2), output="sos")
    # of scipy.signal.sosfiltfilt: how much it reflects at either end, and so the shortest that it takes
    shortest = 3 * (2 * len(sections) + 1 - int((sections[:, 5] == 0).sum())) + 1
    left: Mask = _known(positions)
    believed = left & ~_marked("weak", weak, left.shape)
    for j, run in _runs(positions, numbers):
        inner = np.flatnonzero(believed[run, j])
        if len(inner) == 0 or inner[-1] - inner[0] + 1 < shortest:
            continue
        times = np.arange(inner[0], inner[-1] + 1)
        path = _interpolated(inner, positions[run, j][inner], times, "linear")
        smooth = signal.sosfiltfilt(sections, path, axis=0)
        positions[run.start + inner, j] = smooth[inner - inner[0]]
        left[run.start + inner, j] = False
    return positions, left


def _checked(pose: npt.ArrayLike, frames: npt.ArrayLike | None) -> tuple[Array, Index]:
    """Return a copy of the poses in which a joint has three numbers or none, and the frame numbers."""
    positions = _arrays.numbers(pose, "pose").copy()
    if positions.ndim != 3 or positions.shape[2] != 3:
        raise InvalidInputError(f"pose: expected shape (T, N, 3), got {positions.shape}")
    positions[~_known(positions)] = np.nan
    numbers = np.arange(len(positions)) if frames is None else _arrays.whole_numbers(frames, "frames")
    if numbers.shape != positions.shape[:1]:
        raise InvalidInputError(f"frames: expected shape {positions.shape[:1]}, got {numbers.shape}")
    if (np.diff(numbers) < 1).any():
        raise InvalidInputError("frames: expected ascending numbers, got some that are not")
    return positions, numbers.astype(np.int64)


def _marked(name: str, mask: npt.ArrayLike | None, shape: tuple[int, ...]) -> Mask:
    """Return a mask (T, N) that was given; without one nothing is marked."""
    marked = np.zeros(shape, dtype=np.bool_) if mask is None else _arrays.flags(mask, name)
    if marked.shape != shape:
        raise InvalidInputError(f"{name}: expected shape {shape}, got {marked.shape}")
    return marked


def _known(positions: Array) -> Mask:
    return np.asarray(np.isfinite(positions).all(axis=-1))


def _short_gaps(known: Mask, numbers: Index, max_gap: int) -> Mask:
    """Mark the frames (T,) that lie in a gap of at most ``max_gap`` between two known frames."""
    there = np.flatnonzero(known)
    short = np.zeros_like(known)
    for before, after in pairwise(there.tolist()):
        if after > before + 1 and numbers[after] - numbers[before] - 1 <= max_gap:
            short[before + 1 : after] = True
    return short


def _interpolated(times: Any, values: Array, at: Any, method: str) -> Array:
    if method == "linear":
        return np.stack([np.interp(at, times, values[:, axis]) for axis in range(3)], axis=-1)
    interpolate = require("scipy.interpolate", "cubic splines over gaps", "temporal")
    result: Array = interpolate.CubicSpline(times, values)(at)
    return result


def _single_pass(cutoff: float, frame_rate: float, order: int) -> float:
    """Return the cutoff of one pass, as a share of half the frame rate, for −3 dB at ``cutoff`` after two.

    Two passes have the gain 1 / (1 + (ω/ω_c)²ⁿ), which is 1/√2 where (ω/ω_c)²ⁿ = √2 − 1; by the bilinear
    transform ω = tan(π f / f_s).
    """
    angle = math.tan(math.pi * cutoff / frame_rate) / (math.sqrt(2.0) - 1.0) ** (1.0 / (2 * order))
    return 2.0 / math.pi * math.atan(angle)


def _runs(positions: Array, numbers: Index) -> Iterator[tuple[int, slice]]:
    """Yield (joint, slice of frames) for every run of consecutive frames in which the joint is known."""
    breaks = np.flatnonzero(np.diff(numbers) != 1) + 1
    for j, known in enumerate(_known(positions).T):
        ends = {0, len(known), *breaks.tolist(), *(np.flatnonzero(np.diff(known)) + 1).tolist()}
        for start, stop in pairwise(sorted(ends)):
            if known[start]:
                yield j, slice(start, stop)

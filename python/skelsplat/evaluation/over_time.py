"""What smooths single frames afterwards, at the rate of a recording and never across a gap in its frames.

These are the methods that one which solves over time is compared with, with the settings of
``benchmarks/sequences.py``.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from skelsplat import temporal
from skelsplat._arrays import Array, Index

CUTOFF_HZ = 6.0
"""Of the Butterworth filter, or `_OF_NYQUIST` of half the frame rate if that is less."""

_OF_NYQUIST = 0.8

GAP_S = 0.5
"""Longest gap of a joint that a straight line fills before the Butterworth filter."""

DENSITY_MM2_S3 = 1e6
"""Spectral density of the white acceleration of the Kalman smoother: on simulated recordings at 30 Hz, the
lowest errors of arms and legs of 1e5, 3e5, 1e6, …, 1e8."""


def stretches(frames: Index) -> list[slice]:
    """Cut frames (T,) into runs of consecutive numbers."""
    starts = [0, *(np.flatnonzero(np.diff(frames) != 1) + 1).tolist(), len(frames)]
    return [slice(a, b) for a, b in pairwise(starts) if a < b]


def cutoff(fps: float, wanted: float = CUTOFF_HZ) -> float:
    """Return the cutoff of the Butterworth filter, Hz: as wanted, but below half the frame rate."""
    return min(wanted, _OF_NYQUIST * fps / 2.0)


def butterworth(pose: Array, fps: float, cutoff_hz: float = CUTOFF_HZ, gap_s: float = GAP_S) -> Array:
    """Fill short gaps of joints, then run the zero-lag filter, on poses (T, N, 3) of consecutive frames."""
    filled, _ = temporal.fill_gaps(pose, max(1, round(gap_s * fps)), method="linear")
    return temporal.butterworth(filled, fps, cutoff(fps, cutoff_hz))[0]

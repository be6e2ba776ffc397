"""Which frames of a long sequence a page shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    Array = npt.NDArray[np.float64]
    Places = npt.NDArray[np.int64]

# Joint positions that a page holds, 33 bytes each with their ellipsoids: 2.5 MB.
MOST_POSITIONS = 75_000
# Part of them that frames with a problem may take.
_FOR_PROBLEMS = 0.25


def frames_to_show(frames: npt.NDArray[np.int64], joints: int, wanted: Sequence[int]) -> tuple[Places, int]:
    """Return the places of the frames to show and k, where every k-th is shown and ``wanted`` numbers beside.

    All frames while they hold at most `MOST_POSITIONS` joint positions.
    """
    count, most = len(frames), max(MOST_POSITIONS // max(joints, 1), 8)
    if count <= most:
        return np.arange(count), 1
    some = np.unique(np.asarray(wanted, dtype=np.int64))
    beside = int(_FOR_PROBLEMS * most)
    some = some[np.linspace(0, len(some) - 1, beside).astype(int)] if len(some) > beside else some
    every = -(-count // (most - beside))
    kept = np.arange(count) % every == 0
    return np.flatnonzero(kept | np.isin(frames, some)), every


def thin_line(values: Array, places: Places, *, peaks: bool) -> Array:
    """Return the values at ``places``, or with ``peaks`` the largest from each place to the next."""
    if not peaks or not len(places):
        return values[places]
    largest: Array = np.fmax.reduceat(values, places)
    return largest

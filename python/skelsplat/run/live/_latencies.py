"""Latencies of a session, counted and not kept: a loop of days takes no more memory than one of minutes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

# Each bin is 2 % wide, so that its middle is within 1 %, from 1 µs to 1000 s; what is beyond is in the last.
_WIDTH = math.log(1.02)
_SHORTEST_MS, _LONGEST_MS = 1e-3, 1e6
_BINS = math.ceil(math.log(_LONGEST_MS / _SHORTEST_MS) / _WIDTH) + 1


class Latencies:
    """A histogram of times in ms: percentiles to within 1 %, the longest exactly."""

    def __init__(self) -> None:
        self._counts = [0] * _BINS
        self.count = 0
        self.longest_ms = 0.0

    def add(self, ms: float) -> None:
        """Count a time."""
        within = min(max(ms, _SHORTEST_MS), _LONGEST_MS)
        self._counts[int(math.log(within / _SHORTEST_MS) / _WIDTH)] += 1
        self.count += 1
        self.longest_ms = max(self.longest_ms, ms)

    def percentiles(self, shares: Sequence[float]) -> list[float]:
        """Return the times that these percentages of all do not exceed; there must be one time or more."""
        ranks = np.ceil(np.array(shares) / 100 * self.count)
        places = np.searchsorted(np.cumsum(self._counts), np.maximum(ranks, 1))
        middles = _SHORTEST_MS * np.exp((places + 0.5) * _WIDTH)
        middles[places == _BINS - 1] = self.longest_ms
        return [min(float(ms), self.longest_ms) for ms in middles]

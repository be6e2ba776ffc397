"""Latencies of a session, counted and not kept: a loop of days takes no more memory than one of minutes."""

from __future__ import annotations

import math

import numpy as np

# Each bin is 2 % wide, so that its middle is within 1 %, from 1 µs to 1000 s; what is beyond is in the last.
_WIDTH = math.log(1.02)
_SHORTEST_MS = 1e-3
_LONGEST_MS = 1e6
_BINS = math.ceil(math.log(_LONGEST_MS / _SHORTEST_MS) / _WIDTH) + 1
_PERCENTILES = (50, 90, 99, 99.9)


class Latencies:
    """A histogram of times: percentiles to within 1 %, the longest exactly."""

    def __init__(self) -> None:
        self._counts = [0] * _BINS
        self._longest_ms = 0.0
        self._first = math.inf
        self._last = 0.0
        self.count = 0

    def add(self, begin: float, end: float) -> float:
        """Count what took from ``begin`` to ``end``, in s; return how long in ms."""
        ms = 1000.0 * (end - begin)
        within = min(max(ms, _SHORTEST_MS), _LONGEST_MS)
        self._counts[int(math.log(within / _SHORTEST_MS) / _WIDTH)] += 1
        self._longest_ms = max(self._longest_ms, ms)
        self._first = min(self._first, begin)
        self._last = end
        self.count += 1
        return ms

    def __str__(self) -> str:
        """How many per second, and percentiles; there must be one time or more."""
        ranks = np.ceil(np.array(_PERCENTILES) / 100 * self.count)
        places = np.searchsorted(np.cumsum(self._counts), np.maximum(ranks, 1))
        middles = _SHORTEST_MS * np.exp((places + 0.5) * _WIDTH)
        middles[places == _BINS - 1] = self._longest_ms
        values = np.minimum(middles, self._longest_ms)
        parts = [f"{share:g}% {value:.3f}" for share, value in zip(_PERCENTILES, values, strict=True)]
        rate = self.count / max(self._last - self._first, 1e-9)
        return f"{rate:.0f} per second; latency in ms: {', '.join(parts)}, longest {self._longest_ms:.3f}"

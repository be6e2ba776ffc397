"""Confidence intervals by bootstrap over takes: frames of one take are alike, takes are not."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat._arrays import numbers
from skelsplat.exceptions import InvalidInputError

RESAMPLES = 2000


def mean_interval(
    sums: ArrayLike,
    counts: ArrayLike,
    *,
    level: float = 0.95,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> tuple[float, float]:
    """Return the percentile interval of Σ sums / Σ counts when whole takes are drawn with replacement.

    Parameters
    ----------
    sums, counts : (S,)
        Of each take: the sum of what is averaged, and of how many numbers. Takes that count nothing are left
        out.
    level : float
        Share of the resampled means inside the interval.
    resamples : int
    seed : int

    Returns
    -------
    (low, high), both NaN with fewer than two takes.

    Raises
    ------
    InvalidInputError
        Shapes that differ, a level not between 0 and 1, no resamples.
    """
    total, number = numbers(sums, "sums"), numbers(counts, "counts")
    if total.ndim != 1 or total.shape != number.shape:
        raise InvalidInputError(f"counts: expected shape {total.shape} (S,) as sums, got {number.shape}")
    if not 0.0 < level < 1.0:
        raise InvalidInputError(f"level: expected a number between 0 and 1, got {level!r}")
    if resamples < 1:
        raise InvalidInputError(f"resamples: expected an integer >= 1, got {resamples!r}")
    used = number > 0
    if np.count_nonzero(used) < 2:
        return float("nan"), float("nan")
    means = _resampled_means(total[used], number[used], resamples, np.random.default_rng(seed))
    low, high = np.quantile(means, [(1.0 - level) / 2.0, (1.0 + level) / 2.0])
    return float(low), float(high)


def _resampled_means(
    sums: NDArray[np.float64], counts: NDArray[np.float64], resamples: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    n = len(sums)
    times = rng.multinomial(n, np.full(n, 1.0 / n), size=resamples)
    means: NDArray[np.float64] = (times @ sums) / (times @ counts)
    return means

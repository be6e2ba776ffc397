"""A bar per method with its interval."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from skelsplat._arrays import read_fields
from skelsplat.viz._style import AFTER, BEFORE, LABEL_PT, SMALL_PT, new_figure, save_png, tidy


@dataclass(frozen=True)
class BarData:
    """What `write_bars` draws, from top to bottom.

    Parameters
    ----------
    names
        One per bar.
    values, low, high : (B,)
        Length of each bar and its interval; NaN: no bar, no interval.
    measured : (B,)
        False for figures that others reported: another colour.
    title, axis, caption
        Text above, along the axis and below.
    """

    names: tuple[str, ...]
    values: npt.NDArray[np.float64]
    low: npt.NDArray[np.float64]
    high: npt.NDArray[np.float64]
    measured: npt.NDArray[np.bool_]
    title: str
    axis: str
    caption: str = ""

    def __post_init__(self) -> None:
        read_fields(self, "values", "low", "high")


def write_bars(path: str | os.PathLike[str], data: BarData) -> Path:
    """Write a chart of horizontal bars as PNG, whole or not at all.

    A bar much longer than the others is cut at the figure's edge, and its number says how long it is.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    count = len(data.names)
    figure = new_figure(1.6 + 0.32 * count)
    axes = figure.add_axes((0.27, 0.9 / (1.6 + 0.32 * count), 0.68, 1 - 1.5 / (1.6 + 0.32 * count)))
    places = np.arange(count)[::-1]
    colours = np.where(data.measured, AFTER, BEFORE)
    axes.barh(places, np.nan_to_num(data.values), color=colours.tolist(), height=0.7)
    known = np.isfinite(data.low) & np.isfinite(data.high)
    spread = np.stack([data.values - data.low, data.high - data.values])[:, known]
    axes.errorbar(
        data.values[known], places[known], xerr=np.maximum(spread, 0), fmt="none", ecolor="black", capsize=3
    )
    limit = _limit(data.values)
    axes.set_xlim(0, limit)
    for place, value, high in zip(places, data.values, data.high, strict=True):
        if np.isfinite(value):
            end = min(max(value, high if np.isfinite(high) else value), 0.93 * limit)
            axes.text(end + 0.008 * limit, place, f"{value:.1f}", va="center", fontsize=SMALL_PT)
    axes.set_yticks(places, data.names)
    axes.set_xlabel(data.axis)
    axes.set_title(data.title, loc="left")
    tidy(axes)
    axes.tick_params(axis="y", length=0)
    figure.text(0.02, 0.02, data.caption, fontsize=LABEL_PT)
    return save_png(figure, path)


def _limit(values: npt.NDArray[np.float64]) -> float:
    """End of the axis: a little beyond the longest bar, but not beyond three times the median one."""
    finite = values[np.isfinite(values)]
    if finite.size == 0 or finite.max() <= 0:
        return 1.0
    return float(1.1 * min(finite.max(), 3.0 * np.median(finite)))

"""Charts of measured figures: bars with intervals, and lines by setting next to published ones."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import StrMethodFormatter

from skelsplat._arrays import Array, ArrayFields, Mask
from skelsplat.viz import _style

_PANEL_IN, _CAPTION_IN = 4.6, 0.5
# Okabe and Ito's palette without yellow.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#222222")
_SMALL_PT = _style.SCREEN.small_pt
# Ratio of the largest to the smallest figure from which on a logarithmic axis shows more.
_LOG_RATIO = 8.0


@dataclass(frozen=True)
class BarData(ArrayFields):
    """What `write_bars` draws, from top to bottom."""

    names: tuple[str, ...]  # one per bar
    # (B,) length of each bar and its interval; NaN: no bar, no interval
    values: Array
    low: Array
    high: Array
    measured: Mask  # (B,) false for figures that others reported: another colour
    # text above, along the axis and below
    title: str
    axis: str
    caption: str = ""


def write_bars(path: str | os.PathLike[str], data: BarData) -> Path:
    """Write a chart of horizontal bars as PNG, whole or not at all.

    A bar much longer than the others is cut at the figure's edge, and its number gives its length.
    """
    count = len(data.names)
    figure = _style.new_figure(1.6 + 0.32 * count)
    axes = figure.add_axes((0.27, 0.9 / (1.6 + 0.32 * count), 0.68, 1 - 1.5 / (1.6 + 0.32 * count)))
    places = np.arange(count)[::-1]
    colours = np.where(data.measured, _style.AFTER, _style.BEFORE)
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
            axes.text(end + 0.008 * limit, place, f"{value:.1f}", va="center", fontsize=_SMALL_PT)
    axes.set_yticks(places, data.names)
    axes.set_xlabel(data.axis)
    axes.set_title(data.title, loc="left")
    _style.tidy(axes)
    axes.tick_params(axis="y", length=0)
    figure.text(0.02, 0.02, data.caption, fontsize=_style.SCREEN.label_pt)
    return _style.save_png(figure, path)


def _limit(values: Array) -> float:
    """End of the axis: a little beyond the longest bar, but not beyond three times the median one."""
    finite = values[np.isfinite(values)]
    if finite.size == 0 or finite.max() <= 0:
        return 1.0
    return float(1.1 * min(finite.max(), 3.0 * np.median(finite)))


@dataclass(frozen=True, slots=True)
class Line:
    """A row of figures, one per place on the axis; NaN leaves a gap. Published ones are dashed."""

    name: str
    values: Sequence[float]
    published: bool = False


@dataclass(frozen=True, slots=True)
class Panel:
    """One chart."""

    title: str
    x_label: str
    y_label: str
    places: Sequence[str]  # labels of the places on the axis
    lines: Sequence[Line]


def write_panels(path: str | os.PathLike[str], panels: Sequence[Panel], *, caption: str = "") -> Path:
    """Draw the panels under one another and write them as a PNG."""
    height = _PANEL_IN * len(panels) + _CAPTION_IN
    figure = _style.new_figure(height)
    share = _CAPTION_IN / height
    for k, panel in enumerate(panels):
        low = share + (1 - share) * (1 - (k + 1) / len(panels))
        axes = figure.add_axes((0.06, low + 0.7 / height, 0.50, (1 - share) / len(panels) - 1.2 / height))
        _draw(axes, panel)
    figure.text(0.01, 0.15 / height, caption, fontsize=_SMALL_PT, va="bottom", wrap=True)
    return _style.save_png(figure, path)


def _draw(axes: Axes, panel: Panel) -> None:
    places = range(len(panel.places))
    for k, line in enumerate(panel.lines):
        style = "--" if line.published else "-"
        colour = "#8c8c8c" if line.published else _COLOURS[k % len(_COLOURS)]
        marker = "sv^D<>p*"[k % 8] if line.published else "o"
        axes.plot(
            places, list(line.values), style, color=colour, marker=marker, markersize=5, label=line.name
        )
    known = [v for line in panel.lines for v in line.values if math.isfinite(v)]
    if known and min(known) > 0 and max(known) / min(known) > _LOG_RATIO:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.yaxis.set_minor_formatter(StrMethodFormatter("{x:g}"))
    elif known:
        axes.set_ylim(bottom=0)
    axes.set_xticks(list(places), list(panel.places))
    axes.set_title(panel.title, loc="left")
    axes.set(xlabel=panel.x_label, ylabel=panel.y_label)
    _style.tidy(axes)
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), fontsize=_SMALL_PT, frameon=False)

"""Charts of measured figures: bars with intervals, and lines by setting next to published ones."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from skelsplat._arrays import Array, ArrayFields, Mask
from skelsplat.viz import _style

# Ratio of the largest to the smallest figure from which on a logarithmic axis shows more.
_LOG_RATIO = 8.0
_LONGEST = 3.0  # medians; longer bars are cut at the figure's edge, and their numbers give their lengths


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


@_style.drawn_for(_style.SCREEN)
def write_bars(path: str | os.PathLike[str], data: BarData) -> Path:
    """Write a chart of horizontal bars as PNG, whole or not at all."""
    figure = _style.new_figure(_style.SCREEN_IN, 1.6 + 0.32 * len(data.names))
    axes, places = figure.add_subplot(), np.arange(len(data.names))
    colours = np.where(data.measured, _style.AFTER, _style.BEFORE)
    axes.barh(places, data.values, color=colours.tolist(), height=0.7)
    spread = np.maximum([data.values - data.low, data.high - data.values], 0)
    axes.errorbar(data.values, places, xerr=spread, fmt="none", ecolor="black", capsize=3)
    known = data.values[data.values > 0]  # not NaN
    limit = 1.1 * min(known.max(), _LONGEST * np.median(known)) if len(known) else 1.0
    for place, value, high in zip(places.tolist(), data.values, data.high, strict=True):
        if np.isfinite(value):
            end = min(np.nanmax([value, high]), 0.93 * limit)
            axes.text(end + 0.008 * limit, place, f"{value:.1f}", va="center")
    axes.set(xlim=(0, limit), ylim=(len(places) - 0.5, -0.5), xlabel=data.axis, title=data.title)
    axes.set_yticks(places, data.names)
    axes.tick_params(axis="y", length=0)
    figure.supxlabel(data.caption, x=0.01, ha="left", fontsize="medium")
    return _style.save_png(figure, path)


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


@_style.drawn_for(_style.SCREEN)
def write_panels(path: str | os.PathLike[str], panels: Sequence[Panel], *, caption: str = "") -> Path:
    """Draw the panels under one another and write them as a PNG."""
    figure = _style.new_figure(_style.SCREEN_IN, 4.6 * len(panels) + 0.5)
    for k, panel in enumerate(panels, 1):
        _draw(figure.add_subplot(len(panels), 1, k), panel)
    figure.supxlabel(caption, x=0.01, ha="left", fontsize="medium")
    return _style.save_png(figure, path)


def _draw(axes: Axes, panel: Panel) -> None:
    for k, line in enumerate(panel.lines):
        dashes, marker = ("--", "sv^D<>p*"[k % 8]) if line.published else ("-", "o")
        colour = _style.BEFORE if line.published else _style.person_colour(k)
        style: dict[str, Any] = {"color": colour, "marker": marker, "markersize": 5, "label": line.name}
        axes.plot(range(len(panel.places)), list(line.values), dashes, **style)
    known = [v for line in panel.lines for v in line.values if math.isfinite(v)]
    if known and min(known) > 0 and max(known) / min(known) > _LOG_RATIO:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter("{x:g}")
    elif known:
        axes.set_ylim(bottom=0)
    axes.set_xticks(range(len(panel.places)), list(panel.places))
    axes.set(xlabel=panel.x_label, ylabel=panel.y_label, title=panel.title)
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), fontsize="medium")

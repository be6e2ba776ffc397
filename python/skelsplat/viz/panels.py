"""Line charts of figures by setting: what was measured beside what was published."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.ticker import FuncFormatter

from skelsplat.viz._style import SMALL_PT, new_figure, save_png, tidy

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PANEL_IN, _CAPTION_IN = 4.6, 0.5
# Okabe and Ito's palette without yellow.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#222222")
# Ratio of the largest to the smallest figure from which on a logarithmic axis shows more.
_LOG_RATIO = 8.0


@dataclass(frozen=True, slots=True)
class Line:
    """A row of figures, one per place on the axis; NaN leaves a gap. Published ones are dashed."""

    name: str
    values: Sequence[float]
    published: bool = False


@dataclass(frozen=True, slots=True)
class Panel:
    """One chart.

    Attributes
    ----------
    title, x_label, y_label : str
    places : sequence of str
        What stands under each place of the axis.
    lines : sequence of Line
    """

    title: str
    x_label: str
    y_label: str
    places: Sequence[str]
    lines: Sequence[Line]


def write_panels(path: str | os.PathLike[str], panels: Sequence[Panel], *, caption: str = "") -> Path:
    """Draw the panels under one another and write them as a PNG.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    height = _PANEL_IN * len(panels) + _CAPTION_IN
    figure = new_figure(height)
    share = _CAPTION_IN / height
    for k, panel in enumerate(panels):
        low = share + (1 - share) * (1 - (k + 1) / len(panels))
        axes = figure.add_axes((0.06, low + 0.7 / height, 0.50, (1 - share) / len(panels) - 1.2 / height))
        _draw(axes, panel)
    figure.text(0.01, 0.15 / height, caption, fontsize=SMALL_PT, va="bottom", wrap=True)
    return save_png(figure, path)


def _plain(value: float, _: object) -> str:
    return f"{value:g}"


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
        axes.yaxis.set_major_formatter(FuncFormatter(_plain))
        axes.yaxis.set_minor_formatter(FuncFormatter(_plain))
    elif known:
        axes.set_ylim(bottom=0)
    axes.set_xticks(list(places), list(panel.places))
    axes.set_title(panel.title, loc="left")
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    tidy(axes)
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), fontsize=SMALL_PT, frameon=False)

"""``errors``: where the pose and the detections disagree, joint by camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import LinearSegmentedColormap

from skelsplat.viz import _paper, _style

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    Array = npt.NDArray[np.float64]

# One hue each, from white to dark, so that they can be told in greyscale; grey is nothing measured.
_ERROR = LinearSegmentedColormap.from_list(
    "error", ["#ffffff", "#9ecae1", "#3182bd", "#08306b"]
).with_extremes(bad="#d9d9d9")
_REJECTED = LinearSegmentedColormap.from_list(
    "rejected", ["#ffffff", "#ecc3da", "#c2508f", "#7a0047"]
).with_extremes(bad="#d9d9d9")

_LEAST_PT, _MOST_PT = 4.8, 7.0  # of the numbers in the cells; smaller ones are left out
_LETTERS = 2.1  # widths of a figure at which a number such as 12.3 fits into a cell
_BESIDE = 13  # columns up to which the two maps stand side by side
_ROW_IN, _LEAST_ROW_IN = 0.2, 0.1
_BAR_IN, _BAR_GAP_IN = 0.09, 0.08
_BAR_TEXT_IN = 0.42
_HEAD_IN, _TITLE_IN, _GAP_IN, _EDGE_IN = 0.3, 0.24, 0.15, 0.08
_LETTER_IN = 0.058  # mean width of a letter of SMALL_PT
_MOST_LETTERS = 22
# Everything above is drawn in the darkest colour, so that one bad cell does not pale all others.
_TOP_PERCENTILE = 97.0
_LEAST_SHARE = 10.0


@dataclass(frozen=True)
class ErrorMapData:
    """What the picture shows.

    Parameters
    ----------
    median_px : (M + 1, N + 1)
        Median reprojection error per camera and joint; the last row and column are over all cameras and all
        joints. NaN where there is no detection.
    rejected : (M + 1, N + 1)
        Share of the detections that is rejected, 0 to 1; likewise.
    camera_names, joint_names : (M,) and (N,)
    title
        What was recorded.
    notes
        Sentences below.
    """

    median_px: Array
    rejected: Array
    camera_names: Sequence[str]
    joint_names: Sequence[str]
    title: str = ""
    notes: Sequence[str] = ()


@dataclass(frozen=True)
class _Map:
    """One of the two maps: values (N + 1, M + 1), how to write one, and its colours up to ``top``."""

    values: Array
    title: str
    written: str
    colours: LinearSegmentedColormap
    top: float
    unit: str


def write_error_map(stem: Path, data: ErrorMapData, *, formats: Sequence[str] = ("png",)) -> list[Path]:
    """Draw the two maps and write them as ``stem.png`` or ``stem.pdf``.

    Raises
    ------
    OSError
        If the folder cannot be written.
    """
    return _paper.write_pages([draw_error_map(data)], stem, formats)


def draw_error_map(data: ErrorMapData) -> Figure:
    """Draw a row per joint and a column per camera: the median error, and the share of rejected detections.

    The maps stand side by side, or from thirteen cameras on under one another. The numbers are written into
    the cells where they fit.
    """
    joints, cameras = [*data.joint_names, "all joints"], [*data.camera_names, "all"]
    rows, columns = len(joints), len(cameras)
    beside = columns <= _BESIDE
    names = [_short(name) for name in cameras]
    upright = max(map(len, names)) * _LETTER_IN > _cell_width(joints, columns, beside=beside)
    below = (_letters(names) if upright else 0.1) + 0.14
    lines = _paper.note_lines(data.notes)
    foot = _paper.notes_height(lines) + 0.06
    stacked = 1 if beside else 2
    free = _paper.HEIGHT_IN - foot - _HEAD_IN - stacked * (below + _TITLE_IN) - (stacked - 1) * _GAP_IN
    row_in = float(np.clip(free / stacked / rows, _LEAST_ROW_IN, _ROW_IN))
    map_in = rows * row_in
    figure = _paper.new_page(
        foot + _HEAD_IN + stacked * (map_in + below + _TITLE_IN) + (stacked - 1) * _GAP_IN
    )
    width = columns * _cell_width(joints, columns, beside=beside)
    left = _left(joints)
    for k, chart in enumerate(_maps(data)):
        x = left + (k * (width + _BAR_GAP_IN + _BAR_IN + _BAR_TEXT_IN) if beside else 0.0)
        y = foot + below + (0.0 if beside or k == 1 else map_in + below + _TITLE_IN + _GAP_IN)
        axes = figure.add_axes(_style.box(figure, x, y, width, map_in))
        _draw_map(axes, chart, (row_in, width / columns))
        shown = joints if k == 0 or not beside else []
        _name_cells(axes, [name.replace("_", " ") for name in map(_short, shown)], names, upright=upright)
        bar = figure.add_axes(_style.box(figure, x + width + _BAR_GAP_IN, y, _BAR_IN, map_in))
        _draw_bar(figure, bar, axes, chart)
    _paper.heading(figure, data.title)
    _paper.draw_notes(figure, lines)
    return figure


def _short(name: str) -> str:
    """Return a name of at most so many letters; of a long one the end, which usually tells it apart."""
    return name if len(name) <= _MOST_LETTERS else "…" + name[1 - _MOST_LETTERS :]


def _letters(names: Sequence[str]) -> float:
    return _LETTER_IN * max(map(len, names))


def _left(joints: Sequence[str]) -> float:
    return _letters([_short(name) for name in joints]) + 0.16


def _cell_width(joints: Sequence[str], columns: int, *, beside: bool) -> float:
    """Return the width of a cell in inches, at most 0.6."""
    count = 2 if beside else 1
    space = _paper.WIDTH_IN - _left(joints) - count * (_BAR_GAP_IN + _BAR_IN + _BAR_TEXT_IN)
    return min(space / count / columns, 0.6)


def _maps(data: ErrorMapData) -> tuple[_Map, _Map]:
    error, share = data.median_px.T, 100 * data.rejected.T
    known = error[np.isfinite(error)]
    top = float(np.percentile(known, _TOP_PERCENTILE)) if len(known) else 1.0
    shares = share[np.isfinite(share)]
    most = min(max(float(shares.max()) if len(shares) else 0.0, _LEAST_SHARE), 100.0)
    title = "Median reprojection error [px]"
    return (
        _Map(error, title, "1f", _ERROR, top if top > 0 else 1.0, "px"),
        _Map(share, "Rejected detections [%]", "0f", _REJECTED, most, "%"),
    )


def _draw_map(axes: Axes, chart: _Map, cell_in: tuple[float, float]) -> None:
    image = np.ma.masked_invalid(chart.values)
    axes.imshow(image, cmap=chart.colours, vmin=0, vmax=chart.top, aspect="auto", interpolation="nearest")
    rows, columns = chart.values.shape
    for edge, line in ((rows - 1.5, axes.axhline), (columns - 1.5, axes.axvline)):
        line(edge, color="0.15", linewidth=0.8)
    axes.set_xticks(np.arange(columns - 1) + 0.5, minor=True)
    axes.set_yticks(np.arange(rows - 1) + 0.5, minor=True)
    axes.grid(which="minor", color="0.85", linewidth=0.3)
    axes.tick_params(which="minor", length=0)
    axes.set_title(chart.title, fontsize=_paper.LABEL_PT, loc="left", pad=4)
    size = _number_size(chart, cell_in)
    if size:
        for (row, column), value in np.ndenumerate(chart.values):
            if np.isfinite(value):
                colour = "white" if value > 0.6 * chart.top else "0.1"
                axes.text(
                    column, row, _written(chart, value), color=colour, fontsize=size, ha="center", va="center"
                )
    if not np.isfinite(chart.values).any():
        axes.text(0.5, 0.5, "no detections", transform=axes.transAxes, ha="center", va="center", fontsize=8)


def _written(chart: _Map, value: float) -> str:
    """Return a number of at most three figures."""
    return f"{value:.{chart.written}}" if value < 99.95 else f"{value:.0f}"


def _number_size(chart: _Map, cell_in: tuple[float, float]) -> float:
    """Return the size in points at which the longest number fits into a cell; 0 if it would be too small."""
    known = chart.values[np.isfinite(chart.values)]
    letters = max((len(_written(chart, value)) for value in known), default=1)
    height, width = cell_in
    size = min(72 * height / 1.3, 72 * width / (0.6 * letters + 0.3), _MOST_PT)
    return size if size >= _LEAST_PT else 0.0


def _name_cells(axes: Axes, joints: Sequence[str], cameras: Sequence[str], *, upright: bool) -> None:
    axes.set_xticks(range(len(cameras)), cameras, rotation=90 if upright else 0)
    axes.set_yticks(range(len(joints)), joints)
    _paper.tidy(axes)
    axes.tick_params(which="both", length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _draw_bar(figure: Figure, bar: Axes, axes: Axes, chart: _Map) -> None:
    known = chart.values[np.isfinite(chart.values)]
    beyond = len(known) and known.max() > chart.top
    scale = figure.colorbar(axes.images[0], cax=bar, extend="max" if beyond else "neither", extendfrac=0.03)
    scale.outline.set_linewidth(0.4)  # type: ignore[operator]
    bar.tick_params(labelsize=_paper.SMALL_PT, width=0.5, length=2, pad=1.5)
    bar.set_ylabel(chart.unit, fontsize=_paper.SMALL_PT, labelpad=1)

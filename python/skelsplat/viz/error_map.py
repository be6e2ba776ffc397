"""``errors``: where the pose and the detections disagree, joint by camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LinearSegmentedColormap
from matplotlib.figure import Figure

from skelsplat._arrays import Array, ArrayFields
from skelsplat.viz import _style

# One hue each, from white to dark, so that they can be read in greyscale; grey is nothing measured.
_ERROR = LinearSegmentedColormap.from_list(
    "error", ["#ffffff", "#9ecae1", "#3182bd", "#08306b"]
).with_extremes(bad="#d9d9d9")
_REJECTED = LinearSegmentedColormap.from_list(
    "rejected", ["#ffffff", "#ecc3da", "#c2508f", "#7a0047"]
).with_extremes(bad="#d9d9d9")

_LEAST_PT, _MOST_PT = 4.8, 7.0  # of the numbers in the cells; smaller ones are left out
_BESIDE = 13  # columns up to which the two maps are side by side
_ROW_IN, _LEAST_ROW_IN, _COLUMN_IN = 0.2, 0.1, 0.6
_LEAST_MAP_IN = 1.9  # wide enough for the title of a map
_BAR_IN, _BAR_GAP_IN = 0.09, 0.08
_BAR_TEXT_IN = 0.32
_BESIDE_MAP_IN = _BAR_GAP_IN + _BAR_IN + _BAR_TEXT_IN
_HEAD_IN, _TITLE_IN, _GAP_IN = 0.3, 0.24, 0.15
_LETTER_IN = 0.058  # mean width of a letter of `PRINT.small_pt`
_MOST_LETTERS = 22
# Everything above either is drawn in the darkest colour, so that one bad camera does not pale all others.
_TOP_PERCENTILE, _TOP_MEDIANS = 97.0, 4.0
_LEAST_SHARE = 10.0


@dataclass(frozen=True)
class ErrorMapData(ArrayFields):
    """What the picture shows."""

    # (M + 1, N + 1) median reprojection error per camera and joint; the last row and column are over
    # all cameras and all joints. NaN where there is no detection.
    median_px: Array
    rejected: Array  # (M + 1, N + 1) share of the detections that is rejected, 0 to 1; likewise
    # (M,) and (N,)
    camera_names: Sequence[str]
    joint_names: Sequence[str]
    title: str = ""  # what was recorded
    notes: Sequence[str] = ()  # sentences below


@dataclass(frozen=True)
class _Map:
    """One of the two maps: values (N + 1, M + 1), decimals of those below ten, colours up to ``top``."""

    values: Array
    title: str
    decimals: int
    colours: Colormap
    top: float


def draw_error_map(data: ErrorMapData) -> Figure:
    """Draw a row per joint and a column per camera: the median error, and the share of rejected detections.

    The maps are side by side, or from thirteen cameras on one above the other. The numbers are written into
    the cells where they fit.
    """
    joints = [_short(name).replace("_", " ") for name in (*data.joint_names, "all joints")]
    cameras = [_short(name) for name in (*data.camera_names, "all")]
    lines = _style.note_lines(data.notes)
    plan = _Plan(joints, cameras, _style.notes_height(lines) + 0.06)
    figure = _style.new_figure(plan.height, _style.PRINT)
    for k, chart in enumerate(_maps(data)):
        x, y = plan.corner(k)
        axes = figure.add_axes(_style.box(figure, x, y, plan.width, plan.map_in))
        _draw_map(axes, chart, plan.cell)
        _name_cells(axes, joints if plan.stacked or k == 0 else [], cameras, upright=plan.upright)
        bar = figure.add_axes(_style.box(figure, x + plan.width + _BAR_GAP_IN, y, _BAR_IN, plan.map_in))
        _draw_bar(figure, bar, axes, chart)
    _style.write_around(figure, data.title, lines)
    return figure


class _Plan:
    """Where the maps are, in inches: cells as large as the page allows, with ``foot`` for the notes."""

    def __init__(self, joints: Sequence[str], cameras: Sequence[str], foot: float) -> None:
        rows, columns = len(joints), len(cameras)
        self.stacked = columns > _BESIDE
        across, blocks = (1, 2) if self.stacked else (2, 1)
        self.left = _letters(joints) + 0.16
        space = _style.PRINT.width_in - self.left - across * _BESIDE_MAP_IN
        width = min(space / across / columns, max(_COLUMN_IN, _LEAST_MAP_IN / columns))
        self.upright = _letters(cameras) > width  # the cameras' names are too long for their columns
        below = (_letters(cameras) if self.upright else 0.1) + 0.14
        free = _style.PRINT_HEIGHT_IN - foot - _HEAD_IN - (blocks - 1) * _GAP_IN
        height = float(np.clip((free / blocks - below - _TITLE_IN) / rows, _LEAST_ROW_IN, _ROW_IN))
        self.cell = (height, width)
        self.map_in, self.width = rows * height, columns * width
        self.bottom, self.block = foot + below, self.map_in + below + _TITLE_IN
        self.height = foot + _HEAD_IN + self.block + (self.block + _GAP_IN if self.stacked else 0.0)

    def corner(self, k: int) -> tuple[float, float]:
        """Return the lower left corner of the first or second map."""
        if self.stacked:
            return self.left, self.bottom + (1 - k) * (self.block + _GAP_IN)
        return self.left + k * (self.width + _BESIDE_MAP_IN), self.bottom


def _short(name: str) -> str:
    """Return a name of at most so many letters; of a long one the end, which usually tells it apart."""
    return name if len(name) <= _MOST_LETTERS else "…" + name[1 - _MOST_LETTERS :]


def _letters(names: Sequence[str]) -> float:
    return _LETTER_IN * max(map(len, names))


def _maps(data: ErrorMapData) -> tuple[_Map, _Map]:
    error, share = data.median_px.T, 100 * data.rejected.T
    known = error[np.isfinite(error)]
    top = 1.0
    if len(known):
        top = float(min(np.percentile(known, _TOP_PERCENTILE), _TOP_MEDIANS * np.median(known)))
    shares = share[np.isfinite(share)]
    most = min(max(float(shares.max()) if len(shares) else 0.0, _LEAST_SHARE), 100.0)
    title = "Median reprojection error [px]"
    return (
        _Map(error, title, 1, _ERROR, top if top > 0 else 1.0),
        _Map(share, "Rejected detections [%]", 0, _REJECTED, most),
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
    axes.set_title(chart.title, fontsize=_style.PRINT.label_pt, loc="left", pad=4)
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
    """Return a number, with decimals below ten alone."""
    return f"{value:.{chart.decimals if value < 9.95 else 0}f}"


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
    _style.tidy(axes, _style.PRINT)
    axes.tick_params(which="both", length=0)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _draw_bar(figure: Figure, bar: Axes, axes: Axes, chart: _Map) -> None:
    known = chart.values[np.isfinite(chart.values)]
    beyond = len(known) and known.max() > chart.top
    scale = figure.colorbar(axes.images[0], cax=bar, extend="max" if beyond else "neither", extendfrac=0.03)
    scale.outline.set_linewidth(0.4)
    bar.tick_params(labelsize=_style.PRINT.small_pt, width=0.5, length=2, pad=1.5)

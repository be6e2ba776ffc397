"""``trajectories``: where chosen joints are over time, with the error bands of the refinement."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from skelsplat._arrays import Array, ArrayFields
from skelsplat.viz import _style
from skelsplat.viz._skeleton import Skeleton
from skelsplat.viz._time import MANY_FRAMES, TimeAxis, alone, draw_series, finish, neighbours

# Number of standard deviations → how dark the band is; the wide one is drawn first.
BANDS = {2: 0.18, 1: 0.32}
# Status → colour of its mark at the foot of a panel: dark, middle and light also in greyscale.
MARKS = {"unobserved": "#222222", "inferred": "#7a3e9d", "filled": "#009e73", "weak": "#e69f00"}
_WORDS = {"filled": "filled (dotted)"}  # where the name of a status needs more
_MARK_HEIGHT = 0.055  # of a panel

_ROW_IN, _GAP_IN = 1.02, 0.22
_HEAD_IN, _FOOT_IN = 0.66, 0.42
_ACROSS_IN, _RIGHT_IN = 0.5, 0.1
_EDGE_IN, _TICKS_IN, _LETTER_IN = 0.08, 0.47, 0.066  # left of a row: edge, numbers, a letter of its name
_NAME_LETTERS = 11  # in a line
_ROWS = 6  # on a page
_LEGEND = {
    "borderaxespad": 0.0,
    "borderpad": 0.0,
    "handlelength": 1.5,
    "handletextpad": 0.5,
    "columnspacing": 1.3,
}


@dataclass(frozen=True)
class TrajectoryData(ArrayFields):
    """What the picture shows."""

    pose: Array  # (T, N, 3) positions in mm; NaN where unknown
    # (T, N, 3) standard deviations along the axes in mm; NaN where unknown, and there no band is drawn
    sigma: Array
    start: Array  # (T, N, 3) where the refinement began, in mm; NaN where unknown
    # (T, N) ``"ok"``, ``"inferred"``, ``"weak"``, ``"unobserved"`` or ``"filled"``; ``""`` where unknown
    status: npt.NDArray[np.str_]
    time: TimeAxis  # when the frames were
    joint_names: Sequence[str]  # (N,)
    joints: Sequence[int]  # indices of the joints to draw, from top to bottom
    title: str = ""  # what was recorded
    start_name: str = "start of the refinement"
    notes: Sequence[str] = ()  # sentences below: what was done to the poses


def draw_trajectories(data: TrajectoryData, *, skeleton: Skeleton) -> list[Figure]:
    """Draw x, y and z of each joint side by side, at most six joints on a page."""
    joints = list(data.joints)
    groups = [joints[k : k + _ROWS] for k in range(0, len(joints), _ROWS)]
    return [_draw_page(data, group, skeleton) for group in groups]


def _draw_page(data: TrajectoryData, joints: Sequence[int], skeleton: Skeleton) -> Figure:
    lines = _style.note_lines(data.notes)
    foot = _FOOT_IN + _style.notes_height(lines)
    height = foot + len(joints) * (_ROW_IN + _GAP_IN) - _GAP_IN + _HEAD_IN
    figure = _style.new_figure(height, _style.PRINT)
    names = [textwrap.wrap(data.joint_names[joint].replace("_", " "), _NAME_LETTERS) for joint in joints]
    letters = max(len(line) for name in names for line in name)
    start = _EDGE_IN + letters * _LETTER_IN + _TICKS_IN
    width = (_style.PRINT.width_in - start - _RIGHT_IN - 2 * _ACROSS_IN) / 3
    for row, joint in enumerate(joints):
        bottom = foot + (len(joints) - 1 - row) * (_ROW_IN + _GAP_IN)
        for axis in range(3):
            left = start + axis * (width + _ACROSS_IN)
            axes = figure.add_axes(_style.box(figure, left, bottom, width, _ROW_IN))
            _draw_panel(axes, data, (joint, axis), skeleton.colour(joint))
            if row == 0:
                axes.set_title(f"{'xyz'[axis]} [mm]", fontsize=_style.PRINT.label_pt, pad=4)
            if row == len(joints) - 1:
                axes.set_xlabel(data.time.label, labelpad=2)
            else:
                axes.tick_params(labelbottom=False)
        middle, label = bottom + _ROW_IN / 2, "\n".join(names[row])
        _style.text(figure, _EDGE_IN, middle, label, size=_style.PRINT.label_pt, va="center", linespacing=1.1)
    entries = _legend_entries(data, joints, skeleton)
    _style.legend(figure, _EDGE_IN, height - 0.3, entries, _style.PRINT.small_pt, **_LEGEND)
    _style.write_around(figure, data.title, lines)
    return figure


def _draw_panel(axes: Axes, data: TrajectoryData, place: tuple[int, int], colour: str) -> None:
    """Draw one coordinate of one joint, ``place``: bands, start, position and the marks of its status."""
    joint, axis = place
    time, values = data.time, data.pose[:, joint, axis]
    status = data.status[:, joint]
    draw_bands(axes, time, values, (data.sigma[:, joint, axis], colour))
    draw_series(
        axes, time, data.start[:, joint, axis], color=_style.BEFORE, linewidth=0.6, zorder=2.2, label="start"
    )
    filled = status == "filled"
    style = {"color": colour, "zorder": 2.5}
    draw_series(axes, time, np.where(filled, np.nan, values), **style, linewidth=0.9, label="position")
    if filled.any():
        meeting = filled | neighbours(filled)  # so that a line meets what it continues
        dots = {**style, "linewidth": 1.1, "linestyle": (0, (1, 1)), "label": "filled"}
        draw_series(axes, time, np.where(meeting, values, np.nan), **dots)
    for name, mark in MARKS.items():
        axes.broken_barh(
            time.runs(status == name),
            (0.0, _MARK_HEIGHT),
            transform=axes.get_xaxis_transform(),
            color=mark,
            linewidth=0.5,
            zorder=3,
            label=name,
        )
    low, high = limits(values, data.sigma[:, joint, axis], data.start[:, joint, axis])
    room = 2 * _MARK_HEIGHT * (high - low) if np.isin(data.status[:, data.joints], list(MARKS)).any() else 0.0
    missing = None if np.isfinite(values).any() else "no position"
    finish(axes, time, (low - room, high), ticks=4, missing=missing)


def draw_bands(axes: Axes, time: TimeAxis, values: Array, spread: tuple[Array, str]) -> None:
    """Draw ±2σ and ±1σ; a frame without neighbours gets bars."""
    sigma, colour = spread
    x, y, s = time.broken(values, sigma)
    single = alone(y + s)
    for count, alpha in BANDS.items():
        low, high = y - count * s, y + count * s
        axes.fill_between(
            x,
            low,
            high,
            color=colour,
            alpha=alpha,
            linewidth=0,
            rasterized=len(x) > MANY_FRAMES,
            label=f"{count} σ",
        )
        if single.any():
            width = 4.0 / count
            axes.vlines(
                x[single], low[single], high[single], color=colour, alpha=alpha + 0.1, linewidth=width
            )


def limits(values: Array, sigma: Array, start: Array) -> tuple[float, float]:
    """Return the range of a panel: all positions, most of the band, and a start that is not far away."""
    known = values[np.isfinite(values)]
    if not len(known):
        return -1.0, 1.0
    low, high = float(known.min()), float(known.max())
    band = 2 * sigma[np.isfinite(sigma) & np.isfinite(values)]
    widest = 3 * float(np.median(band)) if len(band) else 0.0
    reach = np.minimum(np.nan_to_num(2 * sigma), widest)
    bottom, top = float(np.nanmin(values - reach)), float(np.nanmax(values + reach))
    space = max(high - low, 2 * widest / 3, 1.0) / 2
    begun = start[np.isfinite(start)]
    if len(begun):
        bottom = min(bottom, max(float(begun.min()), low - space))
        top = max(top, min(float(begun.max()), high + space))
    margin = max(0.05 * (top - bottom), 0.5)
    return bottom - margin, top + margin


def _legend_entries(data: TrajectoryData, joints: Sequence[int], skeleton: Skeleton) -> list[Artist]:
    """Return what occurs on this page."""
    colours = {skeleton.colour(joint) for joint in joints}
    entries: list[Artist] = [
        _style.entry(colour, side, linewidth=1.2)
        for side, colour in _style.SIDES.items()
        if colour in colours and skeleton.left_right
    ]
    if np.isfinite(data.sigma[:, joints]).any():
        dark = {2: BANDS[2], 1: BANDS[1] + BANDS[2]}
        entries += [Patch(color="0.2", alpha=dark[n], linewidth=0, label=f"error bar, {n} σ") for n in (1, 2)]
    if np.isfinite(data.start[:, joints]).any():
        entries.append(_style.entry(_style.BEFORE, data.start_name, linewidth=0.8))
    for name, colour in MARKS.items():
        if (data.status[:, joints] == name).any():
            entries.append(Patch(color=colour, linewidth=0, label=_WORDS.get(name, name)))
    return entries

"""``bones``: the lengths of the limbs over time; how much they vary shows how rigid the skeleton is."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from skelsplat._arrays import Array, ArrayFields, Mask
from skelsplat.viz import _style
from skelsplat.viz._time import TimeAxis, draw_series, finish

P = TypeVar("P")
COLOURS = {**_style.SIDES, "": _style.MIDDLE}
# A panel shows at least this part of the length above and below it: what is rigid looks flat.
_LEAST_SHARE = 0.1
_PALE = 0.35
_SMALL_PT = _style.PRINT.small_pt

UPPER_PT, LOWER_PT = 13.0, 4.0  # of the two lines above a panel
_COLUMNS, _ROWS = 2, 7  # on a page
_AXES_IN, _TEXT_IN = 0.74, 0.46
_HEAD_IN, _FOOT_IN = 0.16, 0.42
_LEFT_IN, _ACROSS_IN, _RIGHT_IN = 0.5, 0.5, 0.1


@dataclass(frozen=True)
class Bone(ArrayFields):
    """One limb."""

    side: str  # ``"left"``, ``"right"`` or ``""``
    lengths: Array  # (T,) in mm; NaN where an end is unknown
    sure: Mask  # (T,) where the length counts; elsewhere it is drawn pale and may leave the panel

    @property
    def median(self) -> float:
        """Median in mm, NaN without a frame that counts."""
        return float(np.median(self.lengths[self.sure])) if self.sure.any() else float("nan")

    @property
    def deviation(self) -> float:
        """Standard deviation in mm, NaN with fewer than two frames that count."""
        return float(np.std(self.lengths[self.sure])) if self.sure.sum() > 1 else float("nan")


@dataclass(frozen=True)
class BonePanel:
    """A limb, or a left and a right one that are mirror images."""

    title: str
    bones: Sequence[Bone]


def draw_bones(
    panels: Sequence[BonePanel], time: TimeAxis, *, title: str = "", notes: Sequence[str] = ()
) -> list[Figure]:
    """Draw the panels in two columns, at most fourteen on a page, with a title above and notes below."""
    return draw_columns(panels, time, _draw_panel, title=title, notes=notes)


def draw_columns(
    panels: Sequence[P],
    time: TimeAxis,
    draw: Callable[[Axes, P, TimeAxis], None],
    *,
    title: str,
    notes: Sequence[str],
) -> list[Figure]:
    """Draw panels in two columns over one axis of time; ``draw`` fills one, with two lines of text above."""
    most, lines = _COLUMNS * _ROWS, _style.note_lines(notes)
    foot = _FOOT_IN + _style.notes_height(lines)
    width = (_style.PRINT.width_in - _LEFT_IN - _RIGHT_IN - (_COLUMNS - 1) * _ACROSS_IN) / _COLUMNS
    pages = []
    for page in (panels[k : k + most] for k in range(0, len(panels), most)):
        rows = -(-len(page) // _COLUMNS)
        figure = _style.new_figure(foot + rows * (_AXES_IN + _TEXT_IN) + _HEAD_IN, _style.PRINT)
        for k, panel in enumerate(page):
            row, column = divmod(k, _COLUMNS)
            left = _LEFT_IN + column * (width + _ACROSS_IN)
            bottom = foot + (rows - 1 - row) * (_AXES_IN + _TEXT_IN)
            axes = figure.add_axes(_style.box(figure, left, bottom, width, _AXES_IN))
            draw(axes, panel, time)
            if k + _COLUMNS >= len(page):
                axes.set_xlabel(time.label, labelpad=2)
            else:
                axes.tick_params(labelbottom=False)
        _style.write_around(figure, title, lines)
        pages.append(figure)
    return pages


def _draw_panel(axes: Axes, panel: BonePanel, time: TimeAxis) -> None:
    for bone in panel.bones:
        colour = COLOURS[bone.side]
        draw_series(axes, time, bone.lengths, color=colour, alpha=_PALE, linewidth=0.6, label="all")
        counted = np.where(bone.sure, bone.lengths, np.nan)
        draw_series(axes, time, counted, color=colour, linewidth=0.8, label=bone.side)
        if np.isfinite(bone.median):
            axes.axhline(bone.median, color=colour, linewidth=0.6, linestyle=(0, (5, 3)), zorder=1.5)
    known = any(np.isfinite(bone.lengths).any() for bone in panel.bones)
    finish(axes, time, _limits(panel.bones), ticks=3, missing=None if known else "no length")
    axes.set_ylabel("mm", labelpad=1)
    _write_numbers(axes, panel)


def _write_numbers(axes: Axes, panel: BonePanel) -> None:
    """Write two lines above a panel: the limb and the difference of its sides, then each side's numbers."""
    write_above(axes, (0.0, UPPER_PT), panel.title, size=_style.PRINT.label_pt, weight="bold")
    write_above(axes, (1.0, UPPER_PT), difference_in_words(panel), ha="right")
    for place, end, bone in zip((0.0, 1.0), ("left", "right"), panel.bones, strict=False):
        numbers = in_words(bone)
        words = f"{bone.side} {numbers}".strip() if numbers else ""
        write_above(axes, (place, LOWER_PT), words, color=COLOURS[bone.side], ha=end)


def write_above(
    axes: Axes, place: tuple[float, float], words: str, size: float = _SMALL_PT, **style: object
) -> None:
    """Write words above an axes at a part of its width and some points above it."""
    axes.annotate(
        words,
        (place[0], 1.0),
        (0.0, place[1]),
        xycoords="axes fraction",
        textcoords="offset points",
        fontsize=size,
        **style,  # type: ignore[arg-type]
    )


def in_words(bone: Bone) -> str:
    """Return the median and the standard deviation of a limb in words."""
    if not np.isfinite(bone.median):
        return "no reliable frame" if np.isfinite(bone.lengths).any() else ""
    digits = _digits(bone.median)
    if not np.isfinite(bone.deviation):
        return f"{_three_figures(bone.median, digits)} mm"
    deviation = _three_figures(bone.deviation, digits)
    share = f" ({_three_figures(100 * bone.deviation / bone.median)} %)" if bone.median > 0 else ""
    return f"{_three_figures(bone.median, digits)} ± {deviation} mm{share}"


def _digits(mm: float) -> int:
    """Return how many decimals the spread of a bone of this length needs: one, more if it is short."""
    return 2 - math.floor(math.log10(mm)) if 0 < mm < 10 else 1


def _three_figures(value: float, digits: int = 1) -> str:
    """Return a number with these decimals, from a hundred on without: both sides' must fit above a panel."""
    return f"{value:.{digits if value < 99.95 else 0}f}"


def difference_in_words(panel: BonePanel) -> str:
    """Return by how much the median of the left limb exceeds that of the right one; nothing for a single."""
    if len(panel.bones) < 2:
        return ""
    left, right = (bone.median for bone in panel.bones)
    if not np.isfinite(left - right):
        return ""
    return f"left − right {left - right:+.{_digits(min(left, right))}f} mm".replace("-", "−")


def _limits(bones: Sequence[Bone]) -> tuple[float, float]:
    """Return the range of a panel: all lengths that count, and a tenth of the median above and below it."""
    known = np.concatenate([bone.lengths[bone.sure] for bone in bones])
    if not len(known):
        known = np.concatenate([bone.lengths[np.isfinite(bone.lengths)] for bone in bones])
    if not len(known):
        return 0.0, 1.0
    middle = float(np.median(known))
    least = _LEAST_SHARE * middle or 1.0
    low, high = min(float(known.min()), middle - least), max(float(known.max()), middle + least)
    margin = 0.03 * (high - low)
    return low - margin, high + margin

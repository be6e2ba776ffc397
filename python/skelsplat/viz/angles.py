"""``angles``: joint angles over time with their error bands, left and right together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from skelsplat._arrays import Array, ArrayFields, median
from skelsplat.viz import _style
from skelsplat.viz._time import TimeAxis, draw_series, finish
from skelsplat.viz.bones import COLOURS, LOWER_PT, UPPER_PT, draw_columns, write_above
from skelsplat.viz.trajectories import draw_bands, limits


@dataclass(frozen=True)
class AngleCurve(ArrayFields):
    """One angle."""

    side: str  # ``"left"``, ``"right"`` or ``""``
    degrees: Array  # (T,) NaN where unknown
    sigma: Array  # (T,) standard deviations in degrees; NaN where unknown, and there no band is drawn


@dataclass(frozen=True)
class AnglePanel:
    """An angle, or that of both sides of the body."""

    title: str
    curves: Sequence[AngleCurve]


def draw_angles(
    panels: Sequence[AnglePanel], time: TimeAxis, *, title: str = "", notes: Sequence[str] = ()
) -> list[Figure]:
    """Draw the panels in two columns, at most fourteen on a page, with a title above and notes below."""
    return draw_columns(panels, time, _draw_panel, title=title, notes=notes)


def _draw_panel(axes: Axes, panel: AnglePanel, time: TimeAxis) -> None:
    for curve in panel.curves:
        colour = COLOURS[curve.side]
        draw_bands(axes, time, curve.degrees, (curve.sigma, colour))
        draw_series(axes, time, curve.degrees, color=colour, linewidth=0.8, label=curve.side)
    values, sigma = (
        np.concatenate([getattr(curve, name) for curve in panel.curves]) for name in ("degrees", "sigma")
    )
    range_ = limits(values, sigma, np.full(values.shape, np.nan))
    finish(axes, time, range_, ticks=3, missing=None if np.isfinite(values).any() else "no angle")
    if range_[0] < 0 < range_[1]:
        axes.axhline(0.0, color="0.6", linewidth=0.5, zorder=1.5)
    axes.set_ylabel("degrees", labelpad=1)
    write_above(axes, (0.0, UPPER_PT), panel.title, size=_style.PRINT.label_pt, weight="bold")
    for place, end, curve in zip((0.0, 1.0), ("left", "right"), panel.curves, strict=False):
        write_above(axes, (place, LOWER_PT), _in_words(curve), color=COLOURS[curve.side], ha=end)


def _in_words(curve: AngleCurve) -> str:
    """Return the side, and the median error bar if there is one."""
    sigma = median(curve.sigma)
    return f"{curve.side} ± {sigma:.1f}°".strip() if np.isfinite(sigma) else curve.side

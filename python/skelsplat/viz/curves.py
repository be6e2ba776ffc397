"""Values over the frames in print: joint trajectories, bone lengths and joint angles, in panels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from skelsplat._arrays import Array, ArrayFields, Index, Mask, median
from skelsplat.viz import _style

# Number of standard deviations → how dark the band is; the wide one is drawn first.
BANDS = {2: 0.18, 1: 0.32}
# Status → colour of its mark at the foot of a panel: dark, middle and light also in greyscale.
MARKS = {"unobserved": "#222222", "inferred": "#7a3e9d", "filled": "#009e73", "weak": "#e69f00"}
_MARK_HEIGHT = 0.055  # of a panel
_PALE = 0.35
# Frames from which on lines and bands go into a PDF as pixels: curves would take megabytes.
_MANY_FRAMES = 4000
_ROWS = 7  # on a page
_ROW_IN, _AROUND_IN = 1.2, 0.9


@dataclass(frozen=True)
class TimeAxis:
    """When the frames were."""

    frames: Index  # (T,) ascending frame numbers, T at least 1
    frame_rate: float | None = None  # frames per second; None if unknown: the axis then counts frames
    zero: int = 0  # the frame number at 0 s

    @property
    def values(self) -> Array:
        """Places of the frames on the axis, (T,): seconds, or frame numbers."""
        if self.frame_rate is None:
            return self.frames.astype(np.float64)
        return (self.frames - self.zero) / self.frame_rate

    @property
    def label(self) -> str:
        """What the axis shows."""
        return "frame" if self.frame_rate is None else f"time since frame {self.zero} [s]"

    @property
    def step(self) -> float:
        """Distance of neighbouring frames on the axis."""
        return float(np.median(np.diff(self.values))) if len(self.frames) > 1 else 1.0

    def broken(self, *series: Array) -> list[Array]:
        """Return the places and the series (T,), with a NaN where frames are missing, so that lines stop."""
        gaps = np.flatnonzero(np.diff(self.values) > 1.5 * self.step) + 1
        return [np.insert(values, gaps, np.nan) for values in (self.values, *series)]

    def runs(self, mask: Mask) -> list[tuple[float, float]]:
        """Return (start, length) on the axis of the stretches where ``mask`` (T,) holds."""
        places, inside = self.broken(mask.astype(np.float64))
        ends = np.diff(np.concatenate([[0], inside == 1, [0]]).astype(int))
        first, last = places[np.flatnonzero(ends == 1)], places[np.flatnonzero(ends == -1) - 1]
        return list(zip(first - self.step / 2, last - first + self.step, strict=True))


@dataclass(frozen=True)
class Curve(ArrayFields):
    """A value over the frames; every array is (T,)."""

    values: Array  # NaN where unknown
    side: str = ""  # of the body: ``"left"``, ``"right"`` or ``""``
    sigma: Array | None = None  # standard deviations, drawn as bands; NaN where unknown
    start: Array | None = None  # where the refinement began; NaN where unknown
    status: npt.NDArray[np.str_] | None = None  # of the joint; those of `MARKS` are marked
    sure: Mask | None = None  # where the value counts; elsewhere it is pale and may leave the panel

    @property
    def counted(self) -> Array:
        """The values that count, NaN elsewhere."""
        return self.values if self.sure is None else np.where(self.sure, self.values, np.nan)

    @property
    def median(self) -> float:
        """Median of the values that count, NaN without any."""
        return median(self.counted)

    @property
    def deviation(self) -> float:
        """Standard deviation of the values that count, NaN with fewer than two."""
        known = self.counted[np.isfinite(self.counted)]
        return float(np.std(known)) if len(known) > 1 else float("nan")


@dataclass(frozen=True)
class CurvePanel:
    """A value, or that of both sides of the body."""

    title: str
    unit: str
    curves: Sequence[Curve]
    remark: str = ""  # above the panel on the right
    least: float = 0.5  # it shows at least so much above and below the values


def bone_panel(title: str, curves: Sequence[Curve]) -> CurvePanel:
    """Return the panel of a limb, or of a left and a right one, with their lengths in words above it.

    It shows at least a tenth of the length above and below it: what is rigid looks flat.
    """
    medians = [curve.median for curve in curves]
    decimals = 1 if max(medians) >= 10 else 3
    left, right = [_length(curve, decimals) for curve in curves] + [""] * (2 - len(curves))
    difference = (
        f"left − right {medians[0] - medians[-1]:+.{decimals}f} mm".replace("-", "−") if right else ""
    )
    least = 0.1 * np.nanmean([*medians, 0.0] if np.isnan(medians).all() else medians)
    return CurvePanel(f"{title}\n{left}", "mm", curves, f"{difference}\n{right}", float(least) or 1.0)


def _length(curve: Curve, decimals: int) -> str:
    """Return the median, the standard deviation, and its share of the median."""
    middle, deviation = curve.median, curve.deviation
    if np.isnan(middle):
        return f"{curve.side} no reliable frame".strip()
    words = f"{curve.side} {middle:.{decimals}f}"
    if np.isfinite(deviation):
        words += f" ± {deviation:.{decimals}f} mm ({100 * deviation / middle:.1f} %)"
    return words.strip()


@_style.drawn_for(_style.PRINT)
def draw_curves(
    panels: Sequence[CurvePanel],
    time: TimeAxis,
    *,
    columns: int = 2,
    title: str = "",
    notes: Sequence[str] = (),
    start_name: str = "start of the refinement",
) -> list[Figure]:
    """Draw panels in columns, seven rows on a page, with a title and a legend above and notes below."""
    most, pages = columns * _ROWS, []
    for page in (panels[k : k + most] for k in range(0, len(panels), most)):
        rows = -(-len(page) // columns)
        figure = _style.new_figure(_style.PRINT_IN, rows * _ROW_IN + _AROUND_IN)
        _style.head(figure, title, _legend(page, start_name))
        for k, panel in enumerate(page):
            axes = figure.add_subplot(rows, columns, k + 1)
            _draw_panel(axes, panel, time)
            if k + columns >= len(page):
                axes.set_xlabel(time.label)
            else:
                axes.tick_params(labelbottom=False)
        _style.write_notes(figure, notes)
        pages.append(figure)
    return pages


def _draw_panel(axes: Axes, panel: CurvePanel, time: TimeAxis) -> None:
    for curve in panel.curves:
        _draw_curve(axes, time, curve)
    values = np.concatenate([curve.counted for curve in panel.curves])
    spread = [curve.values * np.nan if curve.sigma is None else curve.sigma for curve in panel.curves]
    low, high = limits(values, np.concatenate(spread), panel.least)
    if any(curve.status is not None for curve in panel.curves):
        low -= 2 * _MARK_HEIGHT * (high - low)
    places, half = time.values, time.step / 2
    axes.set(xlim=(places[0] - half, places[-1] + half), ylim=(low, high), ylabel=panel.unit)
    axes.set_title(panel.title)
    axes.set_title(panel.remark, loc="right")
    axes.xaxis.set_major_locator(MaxNLocator(5, integer=time.frame_rate is None))
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.grid()


def _draw_curve(axes: Axes, time: TimeAxis, curve: Curve) -> None:
    colour = _style.SIDES.get(curve.side, _style.MIDDLE)
    if curve.sigma is not None:
        _draw_bands(axes, time, curve.values, curve.sigma, colour)
    if curve.start is not None:
        draw_series(axes, time, curve.start, color=_style.BEFORE, linewidth=0.6, label="start")
    if curve.sure is not None:
        draw_series(axes, time, curve.values, color=colour, alpha=_PALE, linewidth=0.6, label="all")
    draw_series(axes, time, curve.counted, color=colour, linewidth=0.9, label="value")
    for name, mark in MARKS.items() if curve.status is not None else ():
        stretches = time.runs(np.asarray(curve.status == name))
        foot = axes.get_xaxis_transform()
        axes.broken_barh(stretches, (0.0, _MARK_HEIGHT), transform=foot, color=mark, label=name)


def _draw_bands(axes: Axes, time: TimeAxis, values: Array, sigma: Array, colour: str) -> None:
    """Draw ±2σ and ±1σ; a frame without neighbours has a bar of ±2σ."""
    x, y, s = time.broken(values, sigma)
    for count, alpha in BANDS.items():
        style: dict[str, Any] = {"color": colour, "alpha": alpha, "rasterized": len(x) > _MANY_FRAMES}
        axes.fill_between(x, y - count * s, y + count * s, linewidth=0, label=f"{count} σ", **style)
    single = _alone(y + s)
    if single.any():
        axes.errorbar(x[single], y[single], 2 * s[single], fmt="none", ecolor=colour, alpha=0.5)


def draw_series(axes: Axes, time: TimeAxis, values: Array, **style: Any) -> None:
    """Draw values (T,) as a line that stops where one is missing; one without neighbours is a point."""
    x, y = time.broken(values)
    points: dict[str, Any] = {
        "marker": "o",
        "markersize": 2.0,
        "markevery": np.flatnonzero(_alone(y)).tolist(),
    }
    axes.plot(x, y, rasterized=len(x) > _MANY_FRAMES, **points, **style)


def _alone(values: Array) -> Mask:
    """Tell which values have no neighbour: a line through them would not show."""
    known = np.pad(np.isfinite(values), 1)
    return np.asarray(known[1:-1] & ~known[:-2] & ~known[2:])


def limits(values: Array, sigma: Array, least: float = 0.5) -> tuple[float, float]:
    """Return the range of a panel: all values, and of the band of ±2σ what is not unusually wide."""
    known = np.isfinite(values)
    if not known.any():
        return -1.0, 1.0
    band = 2 * sigma[known & np.isfinite(sigma)]
    reach = np.minimum(np.nan_to_num(2 * sigma), 3 * np.median(band) if len(band) else 0.0)
    low, high = float(np.nanmin(values - reach)), float(np.nanmax(values + reach))
    margin = max(0.05 * (high - low), least)
    return low - margin, high + margin


def _legend(panels: Sequence[CurvePanel], start_name: str) -> list[Artist]:
    """Return what occurs on a page."""
    curves = [curve for panel in panels for curve in panel.curves]
    sides = {curve.side for curve in curves}
    entries: list[Artist] = [
        _style.entry(colour, side) for side, colour in _style.SIDES.items() if side in sides
    ]
    if any(np.isfinite(curve.sigma).any() for curve in curves if curve.sigma is not None):
        for n, alpha in ((1, sum(BANDS.values())), (2, BANDS[2])):
            entries.append(Patch(color="0.2", alpha=alpha, linewidth=0, label=f"error bar, {n} σ"))
    if any(np.isfinite(curve.start).any() for curve in curves if curve.start is not None):
        entries.append(_style.entry(_style.BEFORE, start_name))
    statuses = {name for curve in curves if curve.status is not None for name in curve.status.tolist()}
    return entries + [Patch(color=mark, label=name) for name, mark in MARKS.items() if name in statuses]

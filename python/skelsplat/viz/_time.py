"""Values over time: the axis, gaps in the frame numbers, and lines that stop at a gap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from skelsplat._arrays import Array, Mask
from skelsplat.viz import _style

# Frames from which on lines and bands go into a PDF as pixels: as curves the file would grow by megabytes.
MANY_FRAMES = 4000
# Frame numbers from which on the axis counts from the first one: longer labels would run into each other.
_LARGE = 100_000


@dataclass(frozen=True)
class TimeAxis:
    """When the frames were."""

    frames: npt.NDArray[np.int64]  # (T,) ascending frame numbers, T at least 1
    frame_rate: float | None = None  # frames per second; None if unknown: the axis then counts frames
    zero: int = 0  # the frame number at 0 s, and from which large frame numbers are counted

    @property
    def values(self) -> Array:
        """Places of the frames on the axis, (T,): seconds, or numbers of frames."""
        first = 0 if self._counts_from_zero else self.zero
        return (self.frames - first) / (self.frame_rate or 1.0)

    @property
    def label(self) -> str:
        """What the axis shows."""
        if self._counts_from_zero:
            return "frame"
        since = f"since frame {self.zero}"
        return f"frames {since}" if self.frame_rate is None else f"time {since} [s]"

    @property
    def _counts_from_zero(self) -> bool:
        return self.frame_rate is None and int(np.abs(self.frames).max()) < _LARGE

    @property
    def step(self) -> float:
        """Distance of neighbouring frames on the axis."""
        return float(self._frames_per_step / (self.frame_rate or 1.0))

    @property
    def _frames_per_step(self) -> float:
        return float(np.median(np.diff(self.frames))) if len(self.frames) > 1 else 1.0

    @property
    def breaks(self) -> npt.NDArray[np.int64]:
        """Indices of the frames before which others are missing."""
        jumps = np.diff(self.frames) > 1.5 * self._frames_per_step
        return np.flatnonzero(jumps).astype(np.int64) + 1

    def broken(self, *series: Array) -> list[Array]:
        """Return the places and the series (T,), with a NaN where frames are missing, so that lines stop."""
        return [np.insert(values, self.breaks, np.nan) for values in (self.values, *series)]

    def runs(self, mask: Mask) -> list[tuple[float, float]]:
        """Return (start, length) on the axis of the stretches where ``mask`` (T,) holds."""
        places, half = self.values, 0.5 * self.step
        edges = set(self.breaks.tolist())
        stretches: list[tuple[float, float]] = []
        for t in np.flatnonzero(mask):
            if stretches and t and mask[t - 1] and t not in edges:
                start = stretches[-1][0]
                stretches[-1] = (start, places[t] + half - start)
            else:
                stretches.append((places[t] - half, 2 * half))
        return stretches

    def apply(self, axes: Axes) -> None:
        """Set the limits and the ticks of an axes; a single frame is in its middle."""
        places = self.values
        space = 0.02 * (places[-1] - places[0]) + 0.5 * self.step
        axes.set_xlim(places[0] - space, places[-1] + space)
        if len(places) == 1:
            axes.set_xticks(places)
            return
        whole = self.frame_rate is None
        axes.xaxis.set_major_locator(MaxNLocator(5, integer=whole, steps=[1, 2, 2.5, 5, 10]))
        plain = np.abs(places).max() < _LARGE
        axes.ticklabel_format(
            axis="x", style="plain" if plain else "sci", scilimits=(0, 0), useOffset=False, useMathText=False
        )
        axes.xaxis.offsetText.set_fontsize(_style.PRINT.small_pt)


def finish(
    axes: Axes, time: TimeAxis, limits: tuple[float, float], *, ticks: int, missing: str | None = None
) -> None:
    """Set limits, at most so many ticks and the grid of an axes over time; ``missing`` is why it is empty."""
    _style.tidy(axes, _style.PRINT)
    time.apply(axes)
    axes.set_ylim(*limits)
    axes.yaxis.set_major_locator(MaxNLocator(ticks, steps=[1, 2, 5, 10]))
    axes.ticklabel_format(axis="y", style="plain", useOffset=False)
    axes.grid(color="0.92", linewidth=0.5)
    axes.set_axisbelow(True)
    if missing is not None:
        axes.set_yticks([])
        axes.text(0.5, 0.5, missing, transform=axes.transAxes, ha="center", va="center", fontsize=7)


def neighbours(mask: Mask) -> Mask:
    """Return the frames next to those of a mask (T,)."""
    beside = np.zeros_like(mask)
    beside[1:] |= mask[:-1]
    beside[:-1] |= mask[1:]
    return beside


def alone(values: Array) -> Mask:
    """Tell which values have no neighbour: a line through them would not show."""
    known = np.isfinite(values)
    return np.asarray(known & ~neighbours(known))


def draw_series(axes: Axes, time: TimeAxis, values: Array, **style: object) -> None:
    """Draw values (T,) as a line that stops where one is missing; one without neighbours is a point."""
    x, y = time.broken(values)
    axes.plot(x, y, rasterized=len(x) > MANY_FRAMES, **style)  # type: ignore[arg-type]
    single = alone(y)
    if single.any():
        size = 1.5 * float(style.get("linewidth", 1.0)) + 0.8  # type: ignore[arg-type]
        point = {**style, "linestyle": "", "markersize": size, "label": "_alone"}
        axes.plot(x[single], y[single], "o", **point)  # type: ignore[arg-type]

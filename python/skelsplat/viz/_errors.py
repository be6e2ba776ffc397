"""Reprojection errors before and after: bars per camera, and their distribution."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skelsplat.viz import _style

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt
    from matplotlib.axes import Axes

    Array = npt.NDArray[np.float64]

_MOST_NUMBERS = 8  # cameras for which the numbers fit between the bars


def draw_cameras(axes: Axes, before: Array, after: Array, names: Sequence[str]) -> None:
    """Draw per camera the median of the errors (T, M, N) as bars, with a line to the 90th percentile."""
    rows = np.arange(len(names))
    for offset, errors, colour in ((-0.19, before, _style.BEFORE), (0.19, after, _style.AFTER)):
        for row in rows:
            values = errors[:, row][np.isfinite(errors[:, row])]
            if not len(values):
                continue
            median, high = np.percentile(values, [50, 90])
            axes.barh(row + offset, median, height=0.36, color=colour, zorder=2)
            axes.plot([median, high], [row + offset] * 2, color=colour, linewidth=1.6, zorder=2)
            axes.plot(high, row + offset, "|", color=colour, markersize=9, markeredgewidth=1.6, zorder=2)
            if len(names) <= _MOST_NUMBERS:
                axes.annotate(
                    f"{median:.1f}",
                    (median, row + offset),
                    xytext=(4, 2.5),
                    textcoords="offset points",
                    fontsize=8.5,
                )
    axes.set_yticks(rows, names)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlim(left=0)
    axes.set_xlabel("error [px]: bar median, line to 90th percentile")
    axes.set_title("reprojection error per camera, all frames")
    axes.grid(axis="x", color="0.9", linewidth=0.8)
    _style.tidy(axes)


def draw_distribution(axes: Axes, before: Array, after: Array) -> None:
    """Draw the share of detections within each distance of the reprojected pose."""
    limit = 1.0
    for errors, colour, style in ((before, _style.BEFORE, "--"), (after, _style.AFTER, "-")):
        values = np.sort(errors[np.isfinite(errors)])
        if len(values):
            share = 100 * np.arange(1, len(values) + 1) / len(values)
            axes.plot(values, share, style, color=colour, linewidth=2)
            limit = max(limit, float(np.percentile(values, 97)))
    axes.set_xlim(0, limit)
    axes.set_ylim(0, 100)
    axes.set_xlabel("within this reprojection error [px]")
    axes.set_ylabel("detections [%]")
    axes.set_title("all cameras and frames")
    axes.grid(color="0.9", linewidth=0.8)
    _style.tidy(axes)

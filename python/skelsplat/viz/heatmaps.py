"""``heatmaps.png``: per camera the pseudo ground truth next to the rendering, with the joints on both."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap

from skelsplat._arrays import Array, ArrayFields
from skelsplat.viz import _style
from skelsplat.viz._body import Skeleton, aspect, draw_limbs, draw_points, person_window

_TALLEST_IN = 6.0  # of one image
_AROUND_IN = 1.1  # title above and axis label below it
_HEAT = LinearSegmentedColormap.from_list("heat", ["#ffffff", "#d9d3ec", "#a996d2", "#7459b0"])


@dataclass(frozen=True)
class HeatmapRow(ArrayFields):
    """One camera's row; all pixel coordinates are those of the two images."""

    name: str  # the camera's name
    # (H, W) pseudo ground truth and rendering, each summed over the joints
    pseudo: npt.NDArray[np.float32]
    rendering: npt.NDArray[np.float32]
    detections: Array  # (N, 2) detected joints; NaN where there is none
    reprojection: Array  # (N, 2) the refined pose projected
    median_error_px: float  # median distance of the two in this frame, in px; NaN without detections


@_style.drawn_for(_style.SCREEN)
def write_heatmaps(
    path: str | os.PathLike[str], rows: Sequence[HeatmapRow], *, skeleton: Skeleton, caption: str = ""
) -> Path:
    """Draw the two images of every camera, cut to the person, and write the figure to ``path``."""
    shapes = [aspect(_window(row)) for row in rows]
    # An upright person leaves room for two cameras side by side.
    across = 2 if len(rows) > 1 and np.median(shapes) > 1 else 1
    down = -(-len(rows) // across)
    height = min(_style.SCREEN_IN / (2 * across) * max(shapes), _TALLEST_IN)
    figure = _style.new_figure(_style.SCREEN_IN, 1.0 + down * (height + _AROUND_IN))
    cross = {"marker": "x", "markersize": 8, "markeredgewidth": 1.8}
    entries = [
        _style.entry(_style.DETECTION, "detections", linestyle="-", **cross),
        _style.entry(_style.REPROJECTION, "refined pose, projected", linestyle="-", marker="o"),
    ]
    _style.head(figure, caption, entries)
    for k, row in enumerate(rows):
        for column in (0, 1):
            axes = figure.add_subplot(down, 2 * across, 2 * k + column + 1)
            _draw(axes, row, skeleton, rendered=bool(column))
    return _style.save_png(figure, path)


def _window(row: HeatmapRow) -> tuple[tuple[int, int], tuple[int, int]]:
    height, width = row.pseudo.shape
    return person_window(np.concatenate([row.detections, row.reprojection]), (width, height))


def _draw(axes: Axes, row: HeatmapRow, skeleton: Skeleton, *, rendered: bool) -> None:
    """Draw one image with its joints; the limbs are those of the pose that the image was made from."""
    # One joint's peak is 1; where joints overlap the sum is larger and the colour ends at its darkest.
    image = row.rendering if rendered else row.pseudo
    axes.imshow(image, cmap=_HEAT, vmin=0, vmax=1, interpolation="nearest")
    limbs = row.reprojection if rendered else row.detections
    colour = _style.REPROJECTION if rendered else _style.DETECTION
    draw_limbs(axes, limbs, skeleton, color=colour, linewidth=1.1, alpha=0.6)
    draw_points(axes, row.reprojection, s=9, color=_style.REPROJECTION, linewidths=0, zorder=3)
    draw_points(axes, row.detections, s=20, marker="x", color=_style.DETECTION, linewidths=1.0, zorder=4)
    (left, right), (top, bottom) = _window(row)
    axes.set(xlim=(left - 0.5, right + 0.5), ylim=(bottom + 0.5, top - 0.5), xlabel="u [px]", ylabel="v [px]")
    known = np.isfinite(row.median_error_px)
    error = f"median error {row.median_error_px:.1f} px" if known else "no detections"
    axes.set_title(f"{row.name}, rendering\n{error}" if rendered else f"{row.name}, pseudo\nground truth")

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
from matplotlib.lines import Line2D

from skelsplat._arrays import Array, ArrayFields
from skelsplat.viz import _style
from skelsplat.viz._cameras import Window, aspect, person_window
from skelsplat.viz._skeleton import Skeleton, draw_limbs

_TALLEST_IN = 6.0  # of one image
_MARGIN_IN = 0.85  # left of an image, for its ticks and label
_HEADER_IN = 1.0
_ROW_GAP_IN = 1.15  # title above and axis label below an image

_HEAT = LinearSegmentedColormap.from_list("heat", ["#ffffff", "#d9d3ec", "#a996d2", "#7459b0"])


@dataclass(frozen=True)
class HeatmapRow(ArrayFields):
    """One camera's row; all pixel coordinates are those of the two images."""

    name: str  # the camera's name
    # (H, W) pseudo ground truth and rendering, each summed over the joints
    pseudo: npt.NDArray[np.float32]
    rendering: npt.NDArray[np.float32]
    # (N, 2) detected joints and the refined pose projected; NaN where there is none
    detections: Array
    reprojection: Array
    median_error_px: float  # median distance of the two in this frame, in px; NaN without detections


def write_heatmaps(
    path: str | os.PathLike[str], rows: Sequence[HeatmapRow], *, skeleton: Skeleton, caption: str = ""
) -> Path:
    """Draw the two images of every camera, cut to the person, and write the figure to ``path``."""
    windows = [crop_window(row) for row in rows]
    # An upright person leaves room for two cameras side by side.
    across = 2 if len(rows) > 1 and np.median([aspect(window) for window in windows]) > 1 else 1
    sheet = _style.SCREEN
    cell = sheet.width_in / (2 * across)
    width = cell - _MARGIN_IN
    lines = [range(k, min(k + across, len(rows))) for k in range(0, len(rows), across)]
    heights = [max(min(width * aspect(windows[k]), _TALLEST_IN) for k in line) for line in lines]
    total = _HEADER_IN + sum(heights) + _ROW_GAP_IN * len(lines)
    figure = _style.new_figure(total)
    top = total - _HEADER_IN
    for line, height in zip(lines, heights, strict=True):
        base = top - height - 0.5
        for place, k in enumerate(line):
            for column in (0, 1):
                left = (2 * place + column) * cell + _MARGIN_IN - 0.1
                box = _style.box(figure, left, base, width, height)
                _draw_panel(figure.add_axes(box), rows[k], windows[k], skeleton, rendered=bool(column))
        top -= height + _ROW_GAP_IN
    figure.text(0.02, 1 - 0.18 / total, caption, fontsize=sheet.title_pt, va="top")
    _style.legend(figure, 0.012 * sheet.width_in, total - 0.42, _legend_entries(), sheet.label_pt)
    return _style.save_png(figure, path)


def _draw_panel(axes: Axes, row: HeatmapRow, window: Window, skeleton: Skeleton, *, rendered: bool) -> None:
    """Draw one image with its joints; the limbs are those of the pose that the image was made from."""
    (left, right), (top, bottom) = window
    image = row.rendering if rendered else row.pseudo
    part = image[top : bottom + 1, left : right + 1]
    extent = (left - 0.5, right + 0.5, bottom + 0.5, top - 0.5)  # the edges of the outermost pixels
    # One joint's peak is 1; where joints overlap the sum is larger and the colour ends at its darkest.
    axes.imshow(part, cmap=_HEAT, vmin=0, vmax=1, extent=extent, interpolation="nearest", aspect="equal")
    limbs, colour = (
        (row.reprojection, _style.REPROJECTION) if rendered else (row.detections, _style.DETECTION)
    )
    draw_limbs(axes, limbs, skeleton, color=colour, linewidth=1.1, alpha=0.6)
    found, detected = row.reprojection, row.detections
    axes.scatter(found[:, 0], found[:, 1], s=9, color=_style.REPROJECTION, linewidths=0, zorder=3)
    axes.scatter(
        detected[:, 0], detected[:, 1], s=20, marker="x", color=_style.DETECTION, linewidths=1.0, zorder=4
    )
    axes.set(xlim=extent[:2], ylim=extent[2:], xlabel="u [px]", ylabel="v [px]")
    _style.tidy(axes)
    error = (
        f"median error {row.median_error_px:.1f} px" if np.isfinite(row.median_error_px) else "no detections"
    )
    axes.set_title(f"{row.name}, rendering\n{error}" if rendered else f"{row.name}, pseudo\nground truth")


def crop_window(row: HeatmapRow) -> Window:
    """Return the columns and rows to show: every detected and reprojected joint in the image, a margin."""
    height, width = row.pseudo.shape
    return person_window(np.concatenate([row.detections, row.reprojection]), (width, height))


def _legend_entries() -> list[Line2D]:
    cross = {"marker": "x", "markersize": 8, "markeredgewidth": 1.8}
    return [
        _style.entry(_style.DETECTION, "detection", **cross),
        _style.entry(_style.DETECTION, "limbs of the detections", linewidth=1.6),
        _style.entry(_style.REPROJECTION, "refined pose, projected", marker="o"),
        _style.entry(_style.REPROJECTION, "limbs of the refined pose", linewidth=1.6),
    ]

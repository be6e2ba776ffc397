"""What the cameras see in one frame: detections, the refined pose, and which detections were rejected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from skelsplat._arrays import Array, ArrayFields, Mask
from skelsplat.viz import _style
from skelsplat.viz._skeleton import Skeleton, draw_ellipses, draw_limbs

Window = tuple[tuple[int, int], tuple[int, int]]

ACROSS = 4
MOST = 2 * ACROSS
NOT_SEEN = "does not see this person"
_MARGIN_IN = 0.75  # left of a panel
_TALLEST_IN = 4.0
_GAP_IN = 0.95  # title above and label below

_PAD = 0.08  # of the person's longer side, around the crop
_MIN_CROP_PX = 40.0


@dataclass(frozen=True)
class CameraPanel(ArrayFields):
    """One camera in one frame; pixel coordinates are ideal ones, without lens distortion."""

    name: str  # the camera's name
    size: tuple[int, int]  # width and height of its image
    # (N, 2) detected joints and the refined pose projected; NaN where there is none
    detections: Array
    reprojection: Array
    covariances: Array  # (N, 2, 2) covariances of the projected joints, px²; NaN where unknown
    # (N,) detections that hardly pull on the pose, and those taken for the other side of the body
    rejected: Mask
    swapped: Mask
    sees: bool = True  # whether it has a detection of the person that is used, in any frame


def choose_panels(panels: Sequence[CameraPanel]) -> list[CameraPanel]:
    """Return at most `MOST` panels: those with most rejected detections, in the order of the cameras."""
    by_rejected = sorted(range(len(panels)), key=lambda i: -int(panels[i].rejected.sum()))
    return [panels[i] for i in sorted(by_rejected[:MOST])]


def panel_heights(panels: Sequence[CameraPanel]) -> list[float]:
    """Return the height of every row of panels in inches, without the space around it."""
    width = _style.SCREEN.width_in / ACROSS - _MARGIN_IN
    tall = [min(width * aspect(_window(panel)), _TALLEST_IN) for panel in panels]
    return [max(tall[k : k + ACROSS]) for k in range(0, len(tall), ACROSS)]


def space_of(heights: Sequence[float]) -> float:
    """Return the inches that rows of these heights take with the space around them."""
    return sum(heights) + _GAP_IN * len(heights)


def draw_panels(
    figure: Figure,
    panels: Sequence[CameraPanel],
    heights: Sequence[float],
    skeleton: Skeleton,
    bottom_in: float,
) -> None:
    """Draw the panels in rows, the last of which begins at ``bottom_in``."""
    cell = _style.SCREEN.width_in / ACROSS
    base = bottom_in + space_of(heights)
    for row, height in enumerate(heights):
        base -= height + _GAP_IN
        for place, panel in enumerate(panels[row * ACROSS : (row + 1) * ACROSS]):
            left = place * cell + _MARGIN_IN - 0.05
            box = _style.box(figure, left, base + 0.5, cell - _MARGIN_IN, height)
            _draw_panel(figure.add_axes(box), panel, skeleton)


def _window(panel: CameraPanel) -> Window:
    return person_window(np.concatenate([panel.detections, panel.reprojection]), panel.size)


def _draw_panel(axes: Axes, panel: CameraPanel, skeleton: Skeleton) -> None:
    """Draw the refined pose with its error ellipses, the detections, and lines to the rejected ones."""
    pose, detections = panel.reprojection, panel.detections
    colours = [skeleton.colour(joint) for joint in range(len(pose))]
    draw_limbs(axes, pose, skeleton, linewidth=1.4, alpha=0.9, zorder=3)
    draw_ellipses(axes, pose, panel.covariances, colours)
    away = panel.rejected & ~panel.swapped  # an exchanged one was meant for another joint
    for start, end in zip(detections[away], pose[away], strict=True):
        axes.plot(*np.stack([start, end], axis=1), color=_style.REJECTED, linewidth=1.2, zorder=4)
    hollow = {"marker": "o", "facecolors": "white", "edgecolors": _style.REJECTED, "linewidths": 1.5}
    diamond = {"marker": "D", "facecolors": "none", "edgecolors": _style.SWAPPED, "linewidths": 1.2}
    cross = {"marker": "x", "color": _style.DETECTION, "linewidths": 1.1}
    for which, size, style in (
        (~panel.rejected, 20, cross),
        (panel.rejected, 30, hollow),
        (panel.swapped, 70, diamond),
    ):
        axes.scatter(detections[which, 0], detections[which, 1], size, zorder=5, **style)  # type: ignore[arg-type]
    (left, right), (top, bottom) = _window(panel)
    axes.set_aspect("equal", anchor="N")
    axes.set(xlim=(left - 0.5, right + 0.5), ylim=(bottom + 0.5, top - 0.5), xlabel="u [px]", ylabel="v [px]")
    seen = int(np.isfinite(detections).all(axis=1).sum())
    if seen:
        axes.set_title(f"{panel.name}: {int(panel.rejected.sum())} of {seen} rejected")
    else:
        axes.set_title(panel.name)
        words = "no detection in this frame" if panel.sees else NOT_SEEN
        paper = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8}
        axes.text(
            0.5, 0.5, words, transform=axes.transAxes, **_style.REMARK, ha="center", bbox=paper, zorder=6
        )
    _style.tidy(axes)


def person_window(points: Array, size: tuple[int, int]) -> Window:
    """Return the columns and rows with the ``points`` (K, 2) in an image and a margin; without any, all."""
    width, height = size
    inside = (points >= -0.5).all(axis=1) & (points < np.array([width, height]) - 0.5).all(axis=1)
    if not inside.any():
        return (0, width - 1), (0, height - 1)
    low, high = points[inside].min(axis=0), points[inside].max(axis=0)
    centre = (low + high) / 2
    margin = _PAD * max(float((high - low).max()), _MIN_CROP_PX)
    side = np.maximum(high - low, _MIN_CROP_PX) + 2 * margin
    return _span(centre[0], side[0], width), _span(centre[1], side[1], height)


def aspect(window: Window) -> float:
    """Return height over width of a window."""
    (left, right), (top, bottom) = window
    return (bottom - top + 1) / (right - left + 1)


def _span(centre: float, length: float, limit: int) -> tuple[int, int]:
    """Return the first and last pixel of ``length`` px about ``centre``, within an image of ``limit`` px."""
    first = int(np.floor(centre - length / 2))
    last = int(np.ceil(centre + length / 2))
    return max(first, 0), min(last, limit - 1)

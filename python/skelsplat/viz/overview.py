"""``overview.png``: the skeleton from two sides, before and after, and the reprojection errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import MultipleLocator

from skelsplat.viz import _style
from skelsplat.viz._skeleton import Skeleton, body_axes, draw_limbs

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence
    from pathlib import Path

    import numpy.typing as npt
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    Array = npt.NDArray[np.float64]

_HEIGHT_IN = 9.0
_VIEWS_IN = (8.1, 6.85)  # width and height of the space for the two views
_VIEWS_LEFT_IN = 0.85
_VIEWS_GAP_IN = 0.3
_MARGIN_MM = 120.0
_GRID_MM = 250.0
_REACH_MM = 1400.0


@dataclass(frozen=True)
class OverviewData:
    """What the overview shows.

    Parameters
    ----------
    before, after : (T, N, 3)
        Joint positions at the start and refined, in mm; NaN where unknown.
    status : (T, N)
        ``"ok"``, ``"weak"`` or ``"unobserved"``; joints that are not ``"ok"`` are drawn hollow.
    error_before, error_after : (T, M, N)
        Reprojection errors in px; NaN where there is no detection.
    camera_names : (M,)
        Names in the order of the cameras.
    up : (3,)
        The vertical of the world, of unit length.
    frame
        Index of the frame that is drawn.
    caption
        What the frame is and why it was chosen.
    """

    before: Array
    after: Array
    status: npt.NDArray[np.str_]
    error_before: Array
    error_after: Array
    camera_names: Sequence[str]
    up: Array
    frame: int
    caption: str


def write_overview(path: str | os.PathLike[str], data: OverviewData, *, skeleton: Skeleton) -> Path:
    """Draw the overview and write it to ``path``.

    Raises
    ------
    OSError
        If ``path`` cannot be written.
    """
    figure = _style.new_figure(_HEIGHT_IN)
    left, forward = body_axes(data.after, skeleton.left_right, data.up, frame=data.frame)
    facing = bool(skeleton.left_right)
    views = (
        View(left, "front view", "to the body's left [mm]"),
        View(forward, "side view (from the right)", "to the body's front [mm]"),
    )
    if not facing:
        views = (View(left, "view 1", "widest direction [mm]"), View(forward, "view 2", "across it [mm]"))
    _draw_views(figure, data, skeleton, views)
    _draw_cameras(figure.add_axes((0.725, 0.56, 0.255, 0.34)), data)
    _draw_distribution(figure.add_axes((0.725, 0.14, 0.255, 0.30)), data)
    _legend(figure, data, facing)
    figure.text(0.02, 0.972, data.caption, fontsize=_style.TITLE_PT, va="top")
    return _style.save_png(figure, path)


@dataclass(frozen=True)
class View:
    """A direction to look from: ``right`` (3,) is the axis to the right of the page."""

    right: Array
    title: str
    label: str


def _draw_views(figure: Figure, data: OverviewData, skeleton: Skeleton, views: tuple[View, ...]) -> None:
    """Draw the views side by side in one scale, as large as the space left of the error panels allows."""
    flat = [
        [_flatten(pose[data.frame], data, view.right) for pose in (data.before, data.after)] for view in views
    ]
    limits = [_limits(np.concatenate(pair)) for pair in flat]
    low = min(limit[1][0] for limit in limits)
    high = max(limit[1][1] for limit in limits)
    widths = [limit[0][1] - limit[0][0] for limit in limits]
    inches_per_mm = min(_VIEWS_IN[0] / sum(widths), _VIEWS_IN[1] / (high - low))
    start = _VIEWS_LEFT_IN
    for view, points, limit, width in zip(views, flat, limits, widths, strict=True):
        size = (width * inches_per_mm, (high - low) * inches_per_mm)
        box = (start / _style.WIDTH_IN, 0.14, size[0] / _style.WIDTH_IN, size[1] / _HEIGHT_IN)
        axes = figure.add_axes(box)
        _draw_view(axes, points, data.status[data.frame], skeleton)
        axes.set(xlim=limit[0], ylim=(low, high), xlabel=view.label, title=view.title)
        axes.xaxis.set_major_locator(MultipleLocator(_GRID_MM))
        axes.yaxis.set_major_locator(MultipleLocator(_GRID_MM))
        if view is views[0]:
            axes.set_ylabel("height [mm]")
        else:
            axes.tick_params(labelleft=False)
        _style.tidy(axes)
        start += size[0] + _VIEWS_GAP_IN


def _draw_view(axes: Axes, points: list[Array], status: npt.NDArray[np.str_], skeleton: Skeleton) -> None:
    """Draw the pose before and after, each (N, 2), into one view."""
    before, after = points
    dashes = (0, (4, 2))
    draw_limbs(axes, before, skeleton, color=_style.BEFORE, linewidth=1.6, linestyle=dashes, zorder=1)
    axes.scatter(before[:, 0], before[:, 1], s=34, marker="x", color=_style.BEFORE, linewidths=1.6, zorder=2)
    draw_limbs(axes, after, skeleton, linewidth=2.4, alpha=0.9, zorder=3)
    colours = [skeleton.colour(joint) for joint in range(len(after))]
    faces = [colour if state == "ok" else "white" for colour, state in zip(colours, status, strict=True)]
    axes.scatter(after[:, 0], after[:, 1], s=40, facecolors=faces, edgecolors=colours, zorder=4)
    axes.grid(color="0.9", linewidth=0.8)
    axes.set_axisbelow(True)


def _flatten(pose: Array, data: OverviewData, right: Array) -> Array:
    """Return (N, 2): distance along ``right`` from the refined pose's middle, and world height."""
    across = data.after[data.frame] @ right
    middle = np.median(across[np.isfinite(across)]) if np.isfinite(across).any() else 0.0
    flat: Array = np.stack([pose @ right - middle, pose @ data.up], axis=1)
    return flat


def _limits(points: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the range of (N, 2) points across and in height, with a margin; 1 m about 0 if none is known.

    Joints further from the median than a body reaches do not widen it: their limbs run out of the picture.
    """
    known = points[np.isfinite(points).all(axis=1)]
    if not len(known):
        return (-500.0, 500.0), (-500.0, 500.0)
    middle = np.median(known, axis=0)
    near = np.clip(known, middle - _REACH_MM, middle + _REACH_MM)
    low, high = near.min(axis=0) - _MARGIN_MM, near.max(axis=0) + _MARGIN_MM
    return (float(low[0]), float(high[0])), (float(low[1]), float(high[1]))


def _draw_cameras(axes: Axes, data: OverviewData) -> None:
    """Draw per camera the median error before and after as bars, with a line to the 90th percentile."""
    rows = np.arange(len(data.camera_names))
    for offset, errors, colour in (
        (-0.19, data.error_before, _style.BEFORE),
        (0.19, data.error_after, _style.AFTER),
    ):
        for row in rows:
            values = errors[:, row][np.isfinite(errors[:, row])]
            if not len(values):
                continue
            median, high = np.percentile(values, [50, 90])
            axes.barh(row + offset, median, height=0.36, color=colour, zorder=2)
            axes.plot([median, high], [row + offset] * 2, color=colour, linewidth=1.6, zorder=2)
            axes.plot(high, row + offset, "|", color=colour, markersize=9, markeredgewidth=1.6, zorder=2)
            axes.annotate(
                f"{median:.1f}",
                (median, row + offset),
                xytext=(4, 2.5),
                textcoords="offset points",
                fontsize=8.5,
            )
    axes.set_yticks(rows, data.camera_names)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlim(left=0)
    axes.set_xlabel("error [px]: bar median, line to 90th percentile")
    axes.set_title("per camera, all frames")
    axes.grid(axis="x", color="0.9", linewidth=0.8)
    _style.tidy(axes)


def _draw_distribution(axes: Axes, data: OverviewData) -> None:
    """Draw the share of detections within each distance of the reprojected pose."""
    limit = 1.0
    for errors, colour, style in (
        (data.error_before, _style.BEFORE, "--"),
        (data.error_after, _style.AFTER, "-"),
    ):
        values = np.sort(errors[np.isfinite(errors)])
        if len(values):
            axes.plot(
                values, 100 * np.arange(1, len(values) + 1) / len(values), style, color=colour, linewidth=2
            )
            limit = max(limit, float(np.percentile(values, 97)))
    axes.set_xlim(0, limit)
    axes.set_ylim(0, 100)
    axes.set_xlabel("within this reprojection error [px]")
    axes.set_ylabel("detections [%]")
    axes.set_title("all cameras and frames")
    axes.grid(color="0.9", linewidth=0.8)
    _style.tidy(axes)


def _legend(figure: Figure, data: OverviewData, facing: bool) -> None:
    """Say along the lower edge which line is which."""
    entries = [Line2D([], [], color=_style.BEFORE, linestyle="--", marker="x", label="before (start)")]
    sides = (
        (("left", _style.LEFT), ("right", _style.RIGHT), ("middle", _style.MIDDLE))
        if facing
        else (("", _style.MIDDLE),)
    )
    entries += [
        Line2D([], [], color=colour, linewidth=2.4, marker="o", label=f"after, {name}" if name else "after")
        for name, colour in sides
    ]
    if (data.status[data.frame] != "ok").any():
        entries.append(
            Line2D(
                [],
                [],
                color=_style.MIDDLE,
                marker="o",
                linestyle="",
                markerfacecolor="white",
                label="after, weakly seen",
            )
        )
    figure.legend(
        handles=entries,
        loc="lower left",
        bbox_to_anchor=(0.05, 0.0),
        ncols=len(entries),
        frameon=False,
        fontsize=11,
    )
    errors = [
        Line2D([], [], color=_style.BEFORE, linestyle="--", linewidth=2, label="before (start)"),
        Line2D([], [], color=_style.AFTER, linewidth=2, label="after"),
    ]
    figure.legend(
        handles=errors, loc="lower right", bbox_to_anchor=(0.985, 0.0), ncols=2, frameon=False, fontsize=11
    )

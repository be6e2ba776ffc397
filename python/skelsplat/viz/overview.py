"""``overview.png``: the body from two sides with its error bars, reprojection errors, and every camera."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MultipleLocator

from skelsplat._arrays import Array, ArrayFields
from skelsplat.viz import _style
from skelsplat.viz._cameras import NOT_SEEN, CameraPanel, choose_panels, draw_panels, panel_heights, space_of
from skelsplat.viz._skeleton import SIGMAS, Skeleton, body_axes, draw_ellipses, draw_limbs, not_ok_in_words

_BODY_IN = 9.0  # the body and the errors, with their legend
_HEADER_IN = 0.75  # of the cameras: their heading and legend
_ERRORS_LEFT_IN, _ERRORS_WIDTH_IN = 10.15, 3.57
_CAPTION_LETTERS, _LINE_IN = 135, 0.25  # letters of a line, and its height
# Of the two views: width and height for both, left edge, gap; margin and grid around a body, and its reach.
_SPACE_IN = (8.1, 6.85)
_LEFT_IN = 0.85
_GAP_IN = 0.3
_MARGIN_MM = 120.0
_GRID_MM = 250.0
_REACH_MM = 1400.0
# Bodies below this size, such as mice and hands, have margin and grid in proportion.
_SMALL_MM = 500.0
_MOST_NUMBERS = 8  # cameras for which the numbers fit between the bars


@dataclass(frozen=True)
class OverviewData(ArrayFields):
    """What the overview shows."""

    # (T, N, 3) joint positions at the start and refined, in mm; NaN where unknown
    before: Array
    after: Array
    error_bar: Array  # (T, N, 3, 3) covariances of the refined joints, in mm²; NaN where unknown
    # (T, N) ``"ok"``, ``"inferred"``, ``"weak"`` or ``"unobserved"``; those not ``"ok"`` are drawn hollow
    status: npt.NDArray[np.str_]
    up: Array  # (3,) the vertical of the world, of unit length
    frame: int  # index of the frame that is drawn
    start: str  # what the pose before is, for the legend
    # (T, M, N) reprojection errors in px; NaN where there is no detection
    error_before: Array
    error_after: Array
    camera_names: Sequence[str]  # (M,) names in the order of the cameras
    # what the cameras see in the frame that is drawn; of many, those with most rejected detections
    panels: Sequence[CameraPanel]
    caption: str  # what the frame is and why it was chosen
    # false if the world's vertical is not known: then ``up`` is an axis of the world, and the two views
    # are not called front and side
    up_known: bool = True


def write_overview(path: str | os.PathLike[str], data: OverviewData, *, skeleton: Skeleton) -> Path:
    """Draw the overview and write it to ``path``."""
    panels = choose_panels(data.panels)
    heights = panel_heights(panels)
    below = space_of(heights) + _HEADER_IN if panels else 0.0
    caption = textwrap.wrap(data.caption, _CAPTION_LETTERS)
    figure = _style.new_figure(_BODY_IN + _LINE_IN * (len(caption) - 1) + below)
    _draw_body(figure, data, skeleton, below + 1.26)
    box = _style.box(figure, _ERRORS_LEFT_IN, below + 5.04, _ERRORS_WIDTH_IN, 3.06)
    _draw_cameras(figure.add_axes(box), data.error_before, data.error_after, data.camera_names)
    box = _style.box(figure, _ERRORS_LEFT_IN, below + 1.26, _ERRORS_WIDTH_IN, 2.7)
    _draw_distribution(figure.add_axes(box), data.error_before, data.error_after, data.start)
    _style.heading(figure, figure.get_figheight() - 0.25, "\n".join(caption))
    _legend(figure, 0.7, below + 0.48, _body_entries(data, skeleton))
    if panels:
        draw_panels(figure, panels, heights, skeleton, 0.1)
        shown = (
            f"{len(panels)} of {len(data.panels)} cameras" if len(panels) < len(data.panels) else "Cameras"
        )
        _style.heading(figure, below - 0.08, f"{shown}, same frame, cropped to the pose")
        _legend(figure, 0.2, below - 0.3, _panel_entries(panels))
    return _style.save_png(figure, path)


def _legend(figure: Figure, left: float, top: float, entries: Sequence[Artist]) -> None:
    _style.legend(figure, left, top, entries, _style.SCREEN.label_pt, columnspacing=1.4)


def _body_entries(body: OverviewData, skeleton: Skeleton) -> list[Artist]:
    """Return the legend of the two views."""
    entries: list[Artist] = [_style.entry(_style.BEFORE, body.start, linestyle="--", marker="x")]
    for side, colour in _style.SIDES.items() if skeleton.left_right else (("", _style.MIDDLE),):
        label = f"refined, {side}" if side else "refined"
        entries.append(_style.entry(colour, label, linestyle="-", linewidth=2.0, marker="o"))
    drawn = body.status[body.frame][np.isfinite(body.after[body.frame]).all(axis=1)]
    if (drawn != "ok").any():
        label = not_ok_in_words(drawn)
        entries.append(_style.entry(_style.MIDDLE, label, marker="o", markerfacecolor="white"))
    entries.append(Patch(color=_style.MIDDLE, alpha=0.28, label=f"error ellipsoid, {SIGMAS:g} σ"))
    return entries


def _panel_entries(panels: Sequence[CameraPanel]) -> list[Artist]:
    """Return the legend of the cameras."""
    white = {"marker": "o", "linestyle": "-", "markerfacecolor": "white", "markeredgewidth": 1.5}
    entries: list[Artist] = [
        _style.entry(_style.DETECTION, "detection", marker="x", markersize=7, markeredgewidth=1.6),
        _style.entry(_style.REJECTED, "rejected detection, with a line to the refined joint", **white),
    ]
    if any(panel.swapped.any() for panel in panels):
        diamond = {"marker": "D", "markerfacecolor": "none", "markersize": 8}
        entries.append(_style.entry(_style.SWAPPED, "left and right exchanged", **diamond))
    entries.append(_style.entry(_style.MIDDLE, "refined pose, projected", linewidth=1.4))
    return entries


def _draw_body(figure: Figure, body: OverviewData, skeleton: Skeleton, bottom_in: float) -> None:
    """Draw the two views side by side in one scale, as large as the space allows, from ``bottom_in`` up."""
    views = _views(body, skeleton)
    flat = [
        [_flatten(pose[body.frame], body, right) for pose in (body.before, body.after)] for right, *_ in views
    ]
    limits = [_limits(np.concatenate(pair)) for pair in flat]
    low = min(limit[1][0] for limit in limits)
    high = max(limit[1][1] for limit in limits)
    widths = [limit[0][1] - limit[0][0] for limit in limits]
    inches_per_mm = min(_SPACE_IN[0] / sum(widths), _SPACE_IN[1] / (high - low))
    start = _LEFT_IN
    for (right, title, label), points, limit, width in zip(views, flat, limits, widths, strict=True):
        size = (width * inches_per_mm, (high - low) * inches_per_mm)
        axes = figure.add_axes(_style.box(figure, start, bottom_in, *size))
        plane = np.stack([right, body.up])
        covariances = plane @ body.error_bar[body.frame] @ plane.T
        _draw_view(axes, points, covariances, body.status[body.frame], skeleton)
        axes.set(xlim=limit[0], ylim=(low, high), xlabel=label, title=title)
        axes.xaxis.set_major_locator(MultipleLocator(_grid(max(*widths, high - low))))
        axes.yaxis.set_major_locator(MultipleLocator(_grid(max(*widths, high - low))))
        if points is flat[0]:
            axes.set_ylabel("height [mm]" if body.up_known else f"{_axis_name(body.up)} [mm]")
        else:
            axes.tick_params(labelleft=False)
        _style.tidy(axes)
        start += size[0] + _GAP_IN


def _views(body: OverviewData, skeleton: Skeleton) -> list[tuple[Array, str, str]]:
    """Return of each view the axis to the right of the page (3,), the title and the label below."""
    pairs = skeleton.left_right if body.up_known else ()
    left, forward, known = body_axes(body.after, pairs, body.up, frame=body.frame)
    if known:
        return [
            (left, "front view", "to the body's left [mm]"),
            (forward, "side view (from the right)", "to the body's front [mm]"),
        ]
    return [(left, "view 1", "widest direction [mm]"), (forward, "view 2", "across it [mm]")]


def _axis_name(direction: Array) -> str:
    """Return the name of the world's axis nearest to a direction, with a minus for its opposite."""
    axis = int(np.argmax(np.abs(direction)))
    return ("−" if direction[axis] < 0 else "") + "xyz"[axis]


def _draw_view(
    axes: Axes, points: list[Array], covariances: Array, status: npt.NDArray[np.str_], skeleton: Skeleton
) -> None:
    """Draw the pose before and after, each (N, 2), into one view."""
    before, after = points
    dashes = (0, (4, 2))
    draw_limbs(axes, before, skeleton, color=_style.BEFORE, linewidth=1.6, linestyle=dashes, zorder=1)
    axes.scatter(before[:, 0], before[:, 1], s=34, marker="x", color=_style.BEFORE, linewidths=1.6, zorder=2)
    draw_limbs(axes, after, skeleton, linewidth=2.0, alpha=0.9, zorder=3)
    colours = [skeleton.colour(joint) for joint in range(len(after))]
    faces = [colour if state == "ok" else "white" for colour, state in zip(colours, status, strict=True)]
    axes.scatter(after[:, 0], after[:, 1], s=30, facecolors=faces, edgecolors=colours, zorder=4)
    draw_ellipses(axes, after, covariances, colours)
    axes.grid(color="0.9", linewidth=0.8)
    axes.set_axisbelow(True)


def _flatten(pose: Array, body: OverviewData, right: Array) -> Array:
    """Return (N, 2): distance to the view's right from the refined pose's middle, and world height."""
    across = body.after[body.frame] @ right
    middle = np.median(across[np.isfinite(across)]) if np.isfinite(across).any() else 0.0
    return np.stack([pose @ right - middle, pose @ body.up], axis=1)


def _limits(points: Array) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the range of (N, 2) points across and in height, with a margin; 1 m about 0 if none is known.

    Joints further from the median than a body reaches do not widen it: their limbs run out of the picture.
    """
    known = points[np.isfinite(points).all(axis=1)]
    if not len(known):
        return (-500.0, 500.0), (-500.0, 500.0)
    middle = np.median(known, axis=0)
    near = np.clip(known, middle - _REACH_MM, middle + _REACH_MM)
    size = float((near.max(axis=0) - near.min(axis=0)).max())
    margin = _MARGIN_MM * min(1.0, max(size, 1.0) / _SMALL_MM)
    low, high = near.min(axis=0) - margin, near.max(axis=0) + margin
    return (float(low[0]), float(high[0])), (float(low[1]), float(high[1]))


def _grid(size: float) -> float:
    """Return the distance of grid lines in mm: 250 for people, about a quarter of smaller bodies."""
    if size >= _SMALL_MM:
        return _GRID_MM
    power = 10.0 ** np.floor(np.log10(size / 4))
    return float(power * next(step for step in (1.0, 2.0, 5.0, 10.0) if step * power >= size / 4))


def _draw_cameras(axes: Axes, before: Array, after: Array, names: Sequence[str]) -> None:
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
    for row in np.flatnonzero(~np.isfinite([before, after]).any(axis=(0, 1, 3))):
        axes.annotate(NOT_SEEN, (0, row), xytext=(4, 0), textcoords="offset points", **_style.REMARK)
    axes.set_yticks(rows, names)
    axes.set_xlim(left=0)
    label = "error [px]: bar median, line to 90th percentile"
    axes.set(ylim=(len(rows) - 0.5, -0.5), xlabel=label, title="reprojection error per camera, all frames")
    axes.grid(axis="x", color="0.9", linewidth=0.8)
    _style.tidy(axes)


def _draw_distribution(axes: Axes, before: Array, after: Array, start: str) -> None:
    """Draw the share of detections within each distance of the reprojected pose, with a legend."""
    limit = 1.0
    for errors, colour, style, label in (
        (before, _style.BEFORE, "--", start),
        (after, _style.AFTER, "-", "refined"),
    ):
        values = np.sort(errors[np.isfinite(errors)])
        if len(values):
            share = 100 * np.arange(1, len(values) + 1) / len(values)
            axes.plot(values, share, style, color=colour, linewidth=2, label=label)
            limit = max(limit, float(np.percentile(values, 97)))
    axes.set(xlim=(0, limit), xlabel="within this reprojection error [px]")
    axes.set(ylim=(0, 100), ylabel="detections [%]", title="all cameras and frames")
    if axes.lines:
        axes.legend(loc="lower right", frameon=False, fontsize=_style.SCREEN.label_pt)
    axes.grid(color="0.9", linewidth=0.8)
    _style.tidy(axes)

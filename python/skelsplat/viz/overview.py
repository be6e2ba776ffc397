"""``overview.png``: the body from two sides with its error bars, reprojection errors, and every camera."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import SubFigure
from matplotlib.patches import Patch

from skelsplat._arrays import Array, ArrayFields, Mask, median
from skelsplat.viz import _style
from skelsplat.viz._body import (
    SIGMAS,
    Skeleton,
    aspect,
    draw_ellipses,
    draw_limbs,
    draw_points,
    not_ok_in_words,
    person_window,
    reach,
    upright,
)

_BODY_IN = 8.5  # height of the body and the errors
_ACROSS, _MOST_PANELS = 4, 8  # cameras in a row, and in all
_TALLEST_IN, _AROUND_IN = 4.0, 0.9  # of a camera
_MOST_NUMBERS = 8  # cameras for which the numbers fit between the bars
# Length of the mean of directions that agree on one: of those spread evenly over 270 degrees it is 0.3.
_STEADY_HEADING = 0.3


@dataclass(frozen=True)
class CameraPanel(ArrayFields):
    """One camera in one frame; pixel coordinates are ideal ones, without lens distortion."""

    name: str  # the camera's name
    size: tuple[int, int]  # width and height of its image
    detections: Array  # (N, 2) detected joints; NaN where there is none
    reprojection: Array  # (N, 2) the refined pose projected
    covariances: Array  # (N, 2, 2) covariances of the projected joints, px²; NaN where unknown
    rejected: Mask  # (N,) detections that hardly pull on the pose
    swapped: Mask  # (N,) those taken for the other side of the body

    @property
    def window(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """The columns and rows to show."""
        return person_window(np.concatenate([self.detections, self.reprojection]), self.size)


@dataclass(frozen=True)
class OverviewData(ArrayFields):
    """What the overview shows."""

    before: Array  # (T, N, 3) joint positions at the start, in mm; NaN where unknown
    after: Array  # the same, refined
    error_bar: Array  # (T, N, 3, 3) covariances of the refined joints, in mm²; NaN where unknown
    # (T, N) ``"ok"``, ``"inferred"``, ``"weak"`` or ``"unobserved"``; those not ``"ok"`` are drawn hollow
    status: npt.NDArray[np.str_]
    up: Array  # (3,) the vertical: an axis of the world or its opposite
    frame: int  # index of the frame that is drawn
    start: str  # what the pose before is, for the legend
    error_before: Array  # (T, M, N) reprojection errors in px; NaN where there is no detection
    error_after: Array
    camera_names: Sequence[str]  # (M,) names in the order of the cameras
    panels: Sequence[CameraPanel]  # what the cameras see in the frame that is drawn
    caption: str  # what the frame is and why it was chosen
    up_known: bool = True  # false: the two views are not called front and side


@_style.drawn_for(_style.SCREEN)
def write_overview(path: str | os.PathLike[str], data: OverviewData, *, skeleton: Skeleton) -> Path:
    """Draw the overview and write it to ``path``."""
    by_rejected = np.argsort([-panel.rejected.sum() for panel in data.panels], kind="stable")
    panels = [data.panels[k] for k in sorted(by_rejected[:_MOST_PANELS])]
    width = _style.SCREEN_IN / _ACROSS - _AROUND_IN
    tall = min(width * max((aspect(panel.window) for panel in panels), default=0.0), _TALLEST_IN)
    rows = -(-len(panels) // _ACROSS)
    heights = [_BODY_IN, *([rows * (tall + _AROUND_IN) + 0.7] if panels else [])]
    figure = _style.new_figure(_style.SCREEN_IN, sum(heights))
    body, *below = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)[:, 0]
    _style.head(body, data.caption, _body_legend(data, skeleton))
    _draw_body(body, data, skeleton)
    for cameras in below:
        some = f"{len(panels)} of {len(data.panels)} cameras" if len(panels) < len(data.panels) else "Cameras"
        _style.head(cameras, f"{some}, same frame, cropped to the pose", _panel_legend(panels))
        for k, panel in enumerate(panels, 1):
            _draw_panel(cameras.add_subplot(rows, _ACROSS, k), panel, skeleton)
    return _style.save_png(figure, path)


def _body_legend(data: OverviewData, skeleton: Skeleton) -> list[Artist]:
    entries: list[Artist] = [_style.entry(_style.BEFORE, data.start, linestyle="--", marker="x")]
    for side, colour in _style.SIDES.items() if skeleton.left_right else [("", _style.MIDDLE)]:
        label = f"refined, {side}" if side else "refined"
        entries.append(_style.entry(colour, label, linestyle="-", linewidth=2.0, marker="o"))
    drawn = data.status[data.frame][np.isfinite(data.after[data.frame]).all(axis=1)]
    if (drawn != "ok").any():
        entries.append(
            _style.entry(_style.MIDDLE, not_ok_in_words(drawn), marker="o", markerfacecolor="white")
        )
    return [*entries, Patch(color=_style.MIDDLE, alpha=0.28, label=f"error ellipsoid, {SIGMAS:g} σ")]


def _panel_legend(panels: Sequence[CameraPanel]) -> list[Artist]:
    white = {"marker": "o", "linestyle": "-", "markerfacecolor": "white", "markeredgewidth": 1.5}
    entries: list[Artist] = [
        _style.entry(_style.DETECTION, "detection", marker="x", markersize=7, markeredgewidth=1.6),
        _style.entry(_style.REJECTED, "rejected detection, with a line to the refined joint", **white),
    ]
    diamond = {"marker": "D", "markerfacecolor": "none", "markersize": 8}
    if any(panel.swapped.any() for panel in panels):
        entries.append(_style.entry(_style.SWAPPED, "left and right exchanged", **diamond))
    return [*entries, _style.entry(_style.MIDDLE, "refined pose, projected", linewidth=1.4)]


def _draw_body(figure: SubFigure, data: OverviewData, skeleton: Skeleton) -> None:
    """Draw the two views in one scale, and the errors beside them."""
    turn, names = upright(data.up)
    before, after = data.before[data.frame] @ turn.T, data.after[data.frame] @ turn.T
    middle = np.nan_to_num([median(after[:, 0]), median(after[:, 1]), 0.0])
    before, after = before - middle, after - middle
    bars = turn @ data.error_bar[data.frame] @ turn.T
    pairs = skeleton.left_right if data.up_known else ()
    left, known = heading(data.after @ turn.T, pairs, data.frame)
    views = (left, np.array([left[1], -left[0]]))  # to the body's left and front
    planes = [np.array([[*across, 0.0], [0.0, 0.0, 1.0]]) for across in views]
    limits = [reach(after @ plane.T, 1000.0) for plane in planes]
    margin = 0.07 * max(float((high - low).max()) for low, high in limits) or 1.0
    wide = np.array([high[0] - low[0] + 2 * margin for low, high in limits])
    grid = figure.add_gridspec(2, 3, width_ratios=[*(2.2 * wide / wide.sum()), 1.0])
    words = (
        [
            ("front view", "to the body's left [mm]"),
            ("side view (from the right)", "to the body's front [mm]"),
        ]
        if known
        else [("view 1", "widest direction [mm]"), ("view 2", "across it [mm]")]
    )
    for k, (plane, (low, high), (title, label)) in enumerate(zip(planes, limits, words, strict=True)):
        axes = figure.add_subplot(grid[:, k])
        _draw_view(axes, (before @ plane.T, after @ plane.T), plane @ bars @ plane.T, data, skeleton)
        span = (low[0] - margin, high[0] + margin), (low[1] - margin, high[1] + margin)
        axes.set(xlim=span[0], ylim=span[1], xlabel=label, title=title, aspect="equal")
        axes.tick_params(labelleft=not k)
        axes.set_ylabel("" if k else "height [mm]" if data.up_known else f"{names[2]} [mm]")
    _draw_cameras(figure.add_subplot(grid[0, 2]), data)
    _draw_distribution(figure.add_subplot(grid[1, 2]), data)


def heading(poses: Array, left_right: Sequence[tuple[int, int]], frame: int) -> tuple[Array, bool]:
    """Return the direction (2,) to the body's left, across the vertical z, and if it is known.

    It is the mean of the left-minus-right directions of all pairs in a frame of ``poses`` (T, N, 3), or in
    all frames where these cancel or are unknown; without pairs, where the joints spread most.
    """
    pairs = np.asarray(left_right, dtype=int).reshape(-1, 2)
    for some in (poses[frame : frame + 1], poses):
        across = (some[:, pairs[:, 0]] - some[:, pairs[:, 1]])[..., :2].reshape(-1, 2)
        length = np.linalg.norm(across, axis=1)
        seen = length > 0  # False for NaN
        mean = (across[seen] / length[seen, None]).sum(axis=0) / max(seen.sum(), 1)
        if np.linalg.norm(mean) >= _STEADY_HEADING:
            return mean / np.linalg.norm(mean), True
    flat = poses[frame][np.isfinite(poses[frame]).all(axis=1), :2]
    return np.linalg.svd(flat - flat.mean(axis=0) if len(flat) else np.zeros((1, 2)))[2][0], False


def _draw_view(
    axes: Axes, poses: tuple[Array, Array], bars: Array, data: OverviewData, skeleton: Skeleton
) -> None:
    """Draw the pose before and after, each (N, 2), into one view."""
    before, after = poses
    grey: dict[str, Any] = {"color": _style.BEFORE, "zorder": 1}
    draw_limbs(axes, before, skeleton, linewidth=1.6, linestyle=(0, (4, 2)), **grey)
    draw_points(axes, before, s=34, marker="x", linewidths=1.6, **grey)
    draw_limbs(axes, after, skeleton, linewidth=2.0, alpha=0.9, zorder=3)
    colours = [skeleton.colour(joint) for joint in range(len(after))]
    faces = np.where(data.status[data.frame] == "ok", colours, "white").tolist()
    draw_points(axes, after, s=30, facecolors=faces, edgecolors=colours, zorder=4)
    draw_ellipses(axes, after, bars, colours)
    axes.grid()


def _draw_cameras(axes: Axes, data: OverviewData) -> None:
    """Draw per camera the median of the errors as bars, with a line to the 90th percentile."""
    for row in range(len(data.camera_names)):
        for place, errors, colour in (
            (row - 0.19, data.error_before[:, row], _style.BEFORE),
            (row + 0.19, data.error_after[:, row], _style.AFTER),
        ):
            values = errors[np.isfinite(errors)]
            if not len(values):
                continue
            median, high = np.percentile(values, [50, 90])
            line = {"ecolor": colour, "elinewidth": 1.6, "capsize": 3}
            axes.barh(place, median, xerr=[[0.0], [high - median]], height=0.36, color=colour, error_kw=line)
            if len(data.camera_names) <= _MOST_NUMBERS:
                above: dict[str, Any] = {"xytext": (4, 2.5), "textcoords": "offset points"}
                axes.annotate(f"{median:.1f}", (median, place), fontsize=8.5, **above)
        if not np.isfinite([data.error_before[:, row], data.error_after[:, row]]).any():
            axes.text(0, row, " no detection", color="0.35", va="center")
    axes.set_yticks(range(len(data.camera_names)), data.camera_names)
    axes.set(xlim=(0, None), ylim=(len(data.camera_names) - 0.5, -0.5))
    axes.set(xlabel="error [px]: bar median, line to 90th percentile")
    axes.set_title("reprojection error, all frames")
    axes.grid(axis="x")


def _draw_distribution(axes: Axes, data: OverviewData) -> None:
    """Draw the share of detections within each distance of the reprojected pose, with a legend."""
    limit = 1.0
    for errors, colour, style, label in (
        (data.error_before, _style.BEFORE, "--", data.start),
        (data.error_after, _style.AFTER, "-", "refined"),
    ):
        values = errors[np.isfinite(errors)]
        if len(values):
            axes.ecdf(values, color=colour, linestyle=style, linewidth=2, label=label)
            limit = max(limit, float(np.percentile(values, 97)))
            axes.legend(loc="lower right")
    axes.set(xlim=(0, limit), ylim=(0, 1), xlabel="within this reprojection error [px]")
    axes.set(ylabel="share of detections", title="all cameras and frames")
    axes.grid()


def _draw_panel(axes: Axes, panel: CameraPanel, skeleton: Skeleton) -> None:
    """Draw the refined pose with its error ellipses, the detections, and lines to the rejected ones."""
    pose, detections = panel.reprojection, panel.detections
    draw_limbs(axes, pose, skeleton, linewidth=1.4, alpha=0.9, zorder=3)
    draw_ellipses(axes, pose, panel.covariances, [skeleton.colour(joint) for joint in range(len(pose))])
    away = panel.rejected & ~panel.swapped  # an exchanged one was meant for another joint
    ends = np.stack([detections[away], pose[away]])  # (2, K, 2)
    axes.plot(ends[..., 0], ends[..., 1], color=_style.REJECTED, linewidth=1.2, zorder=4)
    cross = {"s": 20, "marker": "x", "color": _style.DETECTION, "linewidths": 1.1}
    hollow = {"s": 30, "facecolors": "white", "edgecolors": _style.REJECTED, "linewidths": 1.5}
    diamond = {"s": 70, "marker": "D", "facecolors": "none", "edgecolors": _style.SWAPPED, "linewidths": 1.2}
    for which, style in ((~panel.rejected, cross), (panel.rejected, hollow), (panel.swapped, diamond)):
        draw_points(axes, detections[which], zorder=5, **style)
    (left, right), (top, bottom) = panel.window
    axes.set_aspect("equal", anchor="N")
    axes.set(xlim=(left - 0.5, right + 0.5), ylim=(bottom + 0.5, top - 0.5), xlabel="u [px]", ylabel="v [px]")
    seen = int(np.isfinite(detections).all(axis=1).sum())
    axes.set_title(f"{panel.name}: {panel.rejected.sum()} of {seen} rejected" if seen else panel.name)
    if not seen:
        axes.text(0.5, 0.5, "no detection in this frame", transform=axes.transAxes, ha="center", zorder=6)

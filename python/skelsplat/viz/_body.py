"""The body from two sides: the pose before and after, and the error ellipsoids."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from skelsplat._arrays import Array, ArrayFields
from skelsplat.viz import _style
from skelsplat.viz._skeleton import Skeleton, body_axes, draw_ellipses, draw_limbs

_SPACE_IN = (8.1, 6.85)  # width and height for the two views
_LEFT_IN = 0.85
_GAP_IN = 0.3
_MARGIN_MM = 120.0
_GRID_MM = 250.0
_REACH_MM = 1400.0


@dataclass(frozen=True)
class Body(ArrayFields):
    """A sequence of poses, of which one frame is drawn.

    Parameters
    ----------
    before, after : (T, N, 3)
        Joint positions at the start and refined, in mm; NaN where unknown.
    uncertainty : (T, N, 3, 3)
        Covariances of the refined joints, in mm²; NaN where unknown.
    status : (T, N)
        ``"ok"``, ``"weak"`` or ``"unobserved"``; joints that are not ``"ok"`` are drawn hollow.
    up : (3,)
        The vertical of the world, of unit length.
    frame
        Index of the frame that is drawn.
    up_known
        False if the world's vertical is not known: then ``up`` is an axis of the world, and the two views are
        not called front and side.
    """

    before: Array
    after: Array
    uncertainty: Array
    status: npt.NDArray[np.str_]
    up: Array
    frame: int
    up_known: bool = True


@dataclass(frozen=True)
class _View:
    """A direction to look from: ``right`` (3,) is the axis to the right of the page."""

    right: Array
    title: str
    label: str


def draw_body(figure: Figure, body: Body, skeleton: Skeleton, bottom_in: float) -> None:
    """Draw the two views side by side in one scale, as large as the space allows, from ``bottom_in`` up."""
    views = _views(body, skeleton)
    flat = [[_flatten(pose[body.frame], body, view) for pose in (body.before, body.after)] for view in views]
    limits = [_limits(np.concatenate(pair)) for pair in flat]
    low = min(limit[1][0] for limit in limits)
    high = max(limit[1][1] for limit in limits)
    widths = [limit[0][1] - limit[0][0] for limit in limits]
    inches_per_mm = min(_SPACE_IN[0] / sum(widths), _SPACE_IN[1] / (high - low))
    start = _LEFT_IN
    for view, points, limit, width in zip(views, flat, limits, widths, strict=True):
        size = (width * inches_per_mm, (high - low) * inches_per_mm)
        axes = figure.add_axes(_style.box(figure, start, bottom_in, *size))
        _draw_view(axes, points, _flat_covariances(body, view), body.status[body.frame], skeleton)
        axes.set(xlim=limit[0], ylim=(low, high), xlabel=view.label, title=view.title)
        axes.xaxis.set_major_locator(MultipleLocator(_GRID_MM))
        axes.yaxis.set_major_locator(MultipleLocator(_GRID_MM))
        if view is views[0]:
            axes.set_ylabel("height [mm]" if body.up_known else f"{_axis_name(body.up)} [mm]")
        else:
            axes.tick_params(labelleft=False)
        _style.tidy(axes)
        start += size[0] + _GAP_IN


def _views(body: Body, skeleton: Skeleton) -> tuple[_View, _View]:
    pairs = skeleton.left_right if body.up_known else ()
    left, forward, known = body_axes(body.after, pairs, body.up, frame=body.frame)
    if known:
        side = "side view (from the right)"
        return (
            _View(left, "front view", "to the body's left [mm]"),
            _View(forward, side, "to the body's front [mm]"),
        )
    return _View(left, "view 1", "widest direction [mm]"), _View(forward, "view 2", "across it [mm]")


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


def _flatten(pose: Array, body: Body, view: _View) -> Array:
    """Return (N, 2): distance along the view's right from the refined pose's middle, and world height."""
    across = body.after[body.frame] @ view.right
    middle = np.median(across[np.isfinite(across)]) if np.isfinite(across).any() else 0.0
    return np.stack([pose @ view.right - middle, pose @ body.up], axis=1)


def _flat_covariances(body: Body, view: _View) -> Array:
    """Return the covariances (N, 2, 2) in the plane of a view."""
    plane = np.stack([view.right, body.up])
    flat: Array = plane @ body.uncertainty[body.frame] @ plane.T
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

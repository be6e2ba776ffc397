"""``overview.png``: the body from two sides with its error bars, reprojection errors, and every camera."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from skelsplat._arrays import Array, ArrayFields
from skelsplat.viz import _style
from skelsplat.viz._body import Body, draw_body
from skelsplat.viz._cameras import CameraPanel, choose_panels, draw_panels, panel_heights, space_of
from skelsplat.viz._skeleton import SIGMAS, Skeleton, not_ok_in_words

_BODY_IN = 9.0  # the body and the errors, with their legend
_HEADER_IN = 0.75  # of the cameras: their heading and legend
_ERRORS_LEFT_IN, _ERRORS_WIDTH_IN = 10.15, 3.57
_CAPTION_LETTERS, _LINE_IN = 135, 0.25  # letters of a line, and its height
_MOST_NUMBERS = 8  # cameras for which the numbers fit between the bars


@dataclass(frozen=True)
class OverviewData(ArrayFields):
    """What the overview shows.

    Parameters
    ----------
    body
        The poses, of which one frame is drawn.
    start
        What the pose before is, for the legend.
    error_before, error_after : (T, M, N)
        Reprojection errors in px; NaN where there is no detection.
    camera_names : (M,)
        Names in the order of the cameras.
    panels
        What the cameras see in the frame that is drawn; of many, those with most rejected detections.
    caption
        What the frame is and why it was chosen.
    """

    body: Body
    start: str
    error_before: Array
    error_after: Array
    camera_names: Sequence[str]
    panels: Sequence[CameraPanel]
    caption: str


def write_overview(path: str | os.PathLike[str], data: OverviewData, *, skeleton: Skeleton) -> Path:
    """Draw the overview and write it to ``path``.

    Raises
    ------
    OSError
        If ``path`` cannot be written.
    """
    panels = choose_panels(data.panels)
    heights = panel_heights(panels)
    below = space_of(heights) + _HEADER_IN if panels else 0.0
    caption = textwrap.wrap(data.caption, _CAPTION_LETTERS)
    figure = _style.new_figure(_BODY_IN + _LINE_IN * (len(caption) - 1) + below)
    draw_body(figure, data.body, skeleton, below + 1.26)
    box = _style.box(figure, _ERRORS_LEFT_IN, below + 5.04, _ERRORS_WIDTH_IN, 3.06)
    _draw_cameras(figure.add_axes(box), data.error_before, data.error_after, data.camera_names)
    box = _style.box(figure, _ERRORS_LEFT_IN, below + 1.26, _ERRORS_WIDTH_IN, 2.7)
    _draw_distribution(figure.add_axes(box), data.error_before, data.error_after, data.start)
    _text(figure, 0.25, figure.get_figheight() - 0.25, "\n".join(caption))
    _legend(figure, 0.7, below + 0.48, _body_entries(data.body, data.start, skeleton))
    if panels:
        draw_panels(figure, panels, heights, skeleton, 0.1)
        shown = (
            f"{len(panels)} of {len(data.panels)} cameras" if len(panels) < len(data.panels) else "Cameras"
        )
        _text(figure, 0.25, below - 0.08, f"{shown}, same frame, cropped to the person")
        _legend(figure, 0.2, below - 0.3, _panel_entries(panels))
    return _style.save_png(figure, path)


def _legend(figure: Figure, left: float, top: float, entries: Sequence[Artist]) -> None:
    _style.legend(figure, left, top, entries, _style.SCREEN.label_pt, columnspacing=1.4)


def _text(figure: Figure, left: float, top: float, words: str) -> None:
    _style.text(figure, left, top, words, size=_style.SCREEN.title_pt, va="top")


def _body_entries(body: Body, start: str, skeleton: Skeleton) -> list[Artist]:
    """Return the legend of the two views."""
    entries: list[Artist] = [_style.entry(_style.BEFORE, start, linestyle="--", marker="x")]
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
    axes.set_yticks(rows, names)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xlim(left=0)
    axes.set_xlabel("error [px]: bar median, line to 90th percentile")
    axes.set_title("reprojection error per camera, all frames")
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
    axes.set_xlim(0, limit)
    axes.set_ylim(0, 100)
    axes.set_xlabel("within this reprojection error [px]")
    axes.set_ylabel("detections [%]")
    axes.set_title("all cameras and frames")
    if axes.lines:
        axes.legend(loc="lower right", frameon=False, fontsize=_style.SCREEN.label_pt)
    axes.grid(color="0.9", linewidth=0.8)
    _style.tidy(axes)

"""``overview.png``: the body from two sides with its error bars, reprojection errors, and every camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from skelsplat._arrays import read_fields
from skelsplat.viz import _style
from skelsplat.viz._body import Body, draw_body
from skelsplat.viz._ellipses import SIGMAS
from skelsplat.viz._errors import draw_cameras, draw_distribution
from skelsplat.viz._panels import CameraPanel, choose_panels, draw_panels, panel_heights, space_of

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence
    from pathlib import Path

    import numpy.typing as npt
    from matplotlib.artist import Artist
    from matplotlib.figure import Figure

    from skelsplat.viz._skeleton import Skeleton

    Array = npt.NDArray[np.float64]

_BODY_IN = 9.0  # the body and the errors, with their legend
_HEADER_IN = 0.75  # of the cameras: their heading and legend
_ERRORS_LEFT_IN, _ERRORS_WIDTH_IN = 10.15, 3.57


@dataclass(frozen=True)
class OverviewData:
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

    def __post_init__(self) -> None:
        read_fields(self, "error_before", "error_after")


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
    figure = _style.new_figure(_BODY_IN + below)
    draw_body(figure, data.body, skeleton, below + 1.26)
    box = _style.box(figure, _ERRORS_LEFT_IN, below + 5.04, _ERRORS_WIDTH_IN, 3.06)
    draw_cameras(figure.add_axes(box), data.error_before, data.error_after, data.camera_names)
    box = _style.box(figure, _ERRORS_LEFT_IN, below + 1.26, _ERRORS_WIDTH_IN, 2.7)
    draw_distribution(figure.add_axes(box), data.error_before, data.error_after)
    _text(figure, 0.25, below + 8.75, data.caption)
    _legend(figure, (0.7, below + 0.1), _body_entries(data, skeleton))
    _legend(figure, (10.3, below + 0.1), _error_entries(data))
    if panels:
        draw_panels(figure, panels, heights, skeleton, 0.1)
        shown = (
            f"{len(panels)} of {len(data.panels)} cameras" if len(panels) < len(data.panels) else "Cameras"
        )
        _text(figure, 0.25, below - 0.08, f"{shown}, the same frame, cut to the person")
        _legend(figure, (0.2, below - 0.72), _panel_entries(panels))
    return _style.save_png(figure, path)


def _text(figure: Figure, left: float, top: float, text: str) -> None:
    x, y = left / _style.WIDTH_IN, top / figure.get_figheight()
    figure.text(x, y, text, fontsize=_style.TITLE_PT, va="top")


def _legend(figure: Figure, corner: tuple[float, float], entries: Sequence[Artist]) -> None:
    """Draw a legend in one line, with its lower left corner at ``corner`` in inches."""
    place = (corner[0] / _style.WIDTH_IN, corner[1] / figure.get_figheight())
    figure.legend(
        handles=entries,
        loc="lower left",
        bbox_to_anchor=place,
        ncols=len(entries),
        frameon=False,
        fontsize=_style.LABEL_PT,
        columnspacing=1.4,
    )


def _dots(colour: str, label: str, **changes: object) -> Line2D:
    style = {"marker": "o", "linestyle": "", "color": colour, "label": label, **changes}
    return Line2D([], [], **style)  # type: ignore[arg-type]


def _body_entries(data: OverviewData, skeleton: Skeleton) -> list[Artist]:
    """Return the legend of the two views."""
    entries: list[Artist] = [_dots(_style.BEFORE, data.start, linestyle="--", marker="x")]
    sides = (("left", _style.LEFT), ("right", _style.RIGHT), ("middle", _style.MIDDLE))
    for side, colour in sides if skeleton.left_right else (("", _style.MIDDLE),):
        label = f"refined, {side}" if side else "refined"
        entries.append(_dots(colour, label, linestyle="-", linewidth=2.0))
    if (data.body.status[data.body.frame] != "ok").any():
        entries.append(_dots(_style.MIDDLE, "weakly seen", markerfacecolor="white"))
    entries.append(Patch(color=_style.MIDDLE, alpha=0.28, label=f"error ellipsoid, {SIGMAS:g} σ"))
    return entries


def _error_entries(data: OverviewData) -> list[Artist]:
    return [
        Line2D([], [], color=_style.BEFORE, linestyle="--", linewidth=2, label=data.start),
        Line2D([], [], color=_style.AFTER, linewidth=2, label="refined"),
    ]


def _panel_entries(panels: Sequence[CameraPanel]) -> list[Artist]:
    """Return the legend of the cameras."""
    entries: list[Artist] = [
        _dots(_style.DETECTION, "detection", marker="x", markersize=7, markeredgewidth=1.6),
        _dots(
            _style.REJECTED,
            "rejected detection, with a line to the refined joint",
            linestyle="-",
            markerfacecolor="white",
            markeredgewidth=1.5,
        ),
    ]
    if any(panel.swapped.any() for panel in panels):
        entries.append(
            _dots(
                _style.SWAPPED, "left and right exchanged", marker="D", markerfacecolor="none", markersize=8
            )
        )
    entries.append(Line2D([], [], color=_style.MIDDLE, linewidth=1.4, label="refined pose, projected"))
    return entries

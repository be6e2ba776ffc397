"""Cameras by joints or frames: weights of the detections, and where the pose disagrees with them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.ticker import MaxNLocator

from skelsplat._arrays import Array, ArrayFields, Index
from skelsplat.viz import _style

# One hue each, from white to dark, so that they can be read in greyscale; grey is nothing measured.
_ERROR, _REJECTED = (
    LinearSegmentedColormap.from_list("", colours).with_extremes(bad="#dddddd")
    for colours in (
        ["#ffffff", "#9ecae1", "#3182bd", "#08306b"],
        ["#ffffff", "#ecc3da", "#c2508f", "#7a0047"],
    )
)
_WEIGHT = _REJECTED.reversed()
_MOST_NUMBERS = 34  # rows and columns up to which numbers fit into the cells
_ROW_IN = 0.42  # of a camera
_BESIDE = 13  # columns up to which two maps are side by side
_JOINT_IN = (0.1, 0.2)  # least and largest height of a joint's row in print
_PAGE_IN = 9.4  # what a page of A4 or letter leaves room for with a caption
# Everything above is drawn in the darkest colour, so that one bad camera does not pale all others.
_TOP_PERCENTILE = 97.0


@dataclass(frozen=True)
class WeightData(ArrayFields):
    """What ``weights.png`` shows."""

    weights: Array  # (T, M, N) weights k of the detections; NaN where there is none
    frames: Index  # (T,) frame numbers
    camera_names: Sequence[str]  # (M,)
    joint_names: Sequence[str]  # (N,)
    rejected_below: float  # the weight below which a detection counts as rejected


@_style.drawn_for(_style.SCREEN)
def write_weights(path: str | os.PathLike[str], data: WeightData) -> Path:
    """Draw the mean weights, camera by joint and camera by frame, and write them to ``path``."""
    figure = _style.new_figure(_style.SCREEN_IN, 3.0 + 2 * max(_ROW_IN * len(data.camera_names), 1.0))
    below = f"below {data.rejected_below:g} rejected"
    _style.head(figure, f"Mean weight of the detections, all frames: 1 trusted, {below}, grey: no detection")
    by_joint, by_frame = figure.subplots(2, 1)
    _draw(by_joint, _mean(data.weights, 0), (data.camera_names, data.joint_names), _WEIGHT, decimals=2)
    by_joint.tick_params("x", rotation=45)
    rejected = np.where(np.isnan(data.weights), np.nan, data.weights < data.rejected_below)
    for row, share in enumerate(_mean(rejected, (0, 2))):
        words = "none" if np.isnan(share) else f"{100 * share:.0f}% rejected"
        by_joint.annotate(words, (1.01, row), xycoords=("axes fraction", "data"), va="center")
    ticks = MaxNLocator(10, integer=True).tick_values(0, len(data.frames) - 1)
    places = [int(place) for place in ticks if 0 <= place < len(data.frames)]
    image = _draw(by_frame, _mean(data.weights, 2).T, (data.camera_names, []), _WEIGHT)
    by_frame.set_xticks(places, [str(data.frames[place]) for place in places])
    by_frame.set_xlabel("frame")
    figure.colorbar(image, ax=[by_joint, by_frame], ticks=[0, data.rejected_below, 1], fraction=0.02)
    return _style.save_png(figure, path)


@dataclass(frozen=True)
class ErrorMapData(ArrayFields):
    """What the picture ``errors`` shows."""

    # (M + 1, N + 1) median reprojection error per camera and joint; the last row and column are over
    # all cameras and all joints. NaN where there is no detection.
    median_px: Array
    rejected: Array  # (M + 1, N + 1) share of the detections that is rejected, 0 to 1; likewise
    camera_names: Sequence[str]  # (M,)
    joint_names: Sequence[str]  # (N,)
    title: str = ""  # what was recorded
    notes: Sequence[str] = ()  # sentences below


@_style.drawn_for(_style.PRINT)
def draw_error_map(data: ErrorMapData) -> Figure:
    """Draw the median error and the share of rejected detections: a row per joint, a column per camera."""
    joints = [name.replace("_", " ") for name in (*data.joint_names, "all joints")]
    cameras = [*data.camera_names, "all"]
    down, across = (1, 2) if len(cameras) <= _BESIDE else (2, 1)
    row = np.clip((_PAGE_IN / down - 1.2) / len(joints), *_JOINT_IN)
    figure = _style.new_figure(_style.PRINT_IN, down * (row * len(joints) + 1.2))
    _style.head(figure, data.title)
    _style.write_notes(figure, data.notes)
    maps = (
        ("Median reprojection error [px]", data.median_px.T, _ERROR, 1.0, 1),
        ("Rejected detections [%]", 100 * data.rejected.T, _REJECTED, 10.0, 0),
    )
    for k, (title, values, colours, least, decimals) in enumerate(maps, 1):
        known = values[np.isfinite(values)]
        top = max(np.percentile(known, _TOP_PERCENTILE), least) if len(known) else least
        axes = figure.add_subplot(down, across, k)
        image = _draw(axes, values, (joints, cameras), colours, top=top, decimals=decimals)
        axes.set_title(title)
        axes.tick_params("x", rotation=90 if max(map(len, cameras)) * len(cameras) > 40 else 0)
        for edge, line in ((len(joints) - 1.5, axes.axhline), (len(cameras) - 1.5, axes.axvline)):
            line(edge, color="0.15", linewidth=0.8)
        beyond = "max" if known.max(initial=0.0) > top else "neither"
        bar = figure.colorbar(image, ax=axes, extend=beyond, extendfrac=0.03, fraction=0.03, aspect=60)
        bar.outline.set_linewidth(0.4)
    return figure


def _draw(
    axes: Axes,
    values: Array,
    names: tuple[Sequence[str], Sequence[str]],
    colours: Colormap,
    *,
    top: float = 1.0,
    decimals: int | None = None,
) -> AxesImage:
    """Draw a matrix whose rows and columns have names, with numbers in its cells if they fit."""
    image = axes.imshow(values, cmap=colours, vmin=0, vmax=top, aspect="auto", interpolation="nearest")
    rows, columns = names
    axes.set_yticks(range(len(rows)), rows)
    axes.set_yticks(np.arange(len(rows) - 1) + 0.5, minor=True)
    axes.set_xticks(range(len(columns)), columns)
    axes.grid(which="minor", axis="y", color="0.8", linewidth=0.4)
    axes.tick_params(which="both", length=0)
    if decimals is None or max(values.shape) > _MOST_NUMBERS:
        return image
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            red, green, blue, _ = colours(value / top)
            ink = "white" if 0.3 * red + 0.6 * green + 0.1 * blue < 0.5 else "0.1"
            digits = decimals if value < 10 else 0
            axes.text(column, row, f"{value:.{digits}f}", ha="center", va="center", color=ink)
    return image


def _mean(values: Array, axis: int | tuple[int, ...]) -> Array:
    """Return the mean over ``axis`` of what is not NaN; NaN where nothing is left."""
    known: Array = np.ma.masked_invalid(values).mean(axis=axis).filled(np.nan)
    return known

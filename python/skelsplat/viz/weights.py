"""``weights.png``: how much the detections are trusted, camera by joint and camera by frame."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.image import AxesImage
from matplotlib.ticker import MaxNLocator

from skelsplat._arrays import Array, ArrayFields
from skelsplat.viz import _style

_LEFT_IN, _RIGHT_IN = 1.6, 1.5
_ROW_IN = 0.42
_LEAST_IN = 1.0
_MOST_NUMBERS = 32  # joints for which the numbers fit into the cells
_MOST_NAMES = 60
_SMALL_PT = _style.SCREEN.small_pt
_DARK = 0.45  # below, a number is written in white

_WEIGHT = LinearSegmentedColormap.from_list(
    "weight", ["#7a0047", "#c2508f", "#ecc3da", "#ffffff"]
).with_extremes(bad="#e4e4e4")


@dataclass(frozen=True)
class WeightData(ArrayFields):
    """What the picture shows."""

    weights: Array  # (T, M, N) weights k of the detections; NaN where there is none
    frames: npt.NDArray[np.int64]  # (T,) frame numbers
    # (M,) and (N,) labels
    camera_names: Sequence[str]
    joint_names: Sequence[str]
    rejected_below: float  # the weight below which a detection counts as rejected


def write_weights(path: str | os.PathLike[str], data: WeightData) -> Path:
    """Draw the mean weights and write them to ``path``."""
    height = max(_ROW_IN * len(data.camera_names), _LEAST_IN)
    figure = _style.new_figure(2 * height + 3.05)
    width = _style.SCREEN.width_in - _LEFT_IN - _RIGHT_IN
    by_joint = figure.add_axes(_style.box(figure, _LEFT_IN, height + 2.3, width, height))
    by_frame = figure.add_axes(_style.box(figure, _LEFT_IN, 0.7, width, height))
    image = _draw_joints(by_joint, data)
    _draw_frames(by_frame, data)
    bar = figure.add_axes(_style.box(figure, _style.SCREEN.width_in - 0.75, 0.7, 0.18, height))
    figure.colorbar(image, cax=bar, ticks=[0, data.rejected_below, 1])
    below = f"below {data.rejected_below:g} rejected"
    words = f"Mean weight of the detections, all frames: 1 trusted, {below}, grey: no detection"
    _style.heading(figure, figure.get_figheight() - 0.2, words)
    return _style.save_png(figure, path)


def _draw_joints(axes: Axes, data: WeightData) -> AxesImage:
    mean = _mean(data.weights, axis=0)
    image = _draw_matrix(axes, mean, data.camera_names)
    some = slice(None, None, len(data.joint_names) // _MOST_NAMES + 1)
    names = list(data.joint_names)
    axes.set_xticks(range(len(names))[some], names[some], rotation=45, ha="right")
    rejected = _mean(
        np.where(np.isnan(data.weights), np.nan, data.weights < data.rejected_below), axis=(0, 2)
    )
    for row, share in enumerate(rejected):
        text = "none" if np.isnan(share) else f"{100 * share:.0f}% rejected"
        axes.annotate(text, (1.01, row), xycoords=("axes fraction", "data"), va="center", fontsize=_SMALL_PT)
    if len(data.joint_names) <= _MOST_NUMBERS:
        for (row, column), value in np.ndenumerate(mean):
            if np.isfinite(value):
                colour = "white" if value < _DARK else "0.15"
                axes.text(column, row, f"{value:.2f}", ha="center", va="center", color=colour, fontsize=8)
    return image


def _draw_frames(axes: Axes, data: WeightData) -> None:
    _draw_matrix(axes, _mean(data.weights, axis=2).T, data.camera_names)
    numbers = np.asarray(data.frames)
    ticks = np.asarray(MaxNLocator(10, integer=True).tick_values(0, len(numbers) - 1), dtype=int)
    steps = [step for step in ticks if 0 <= step < len(numbers)]
    axes.set_xticks(steps, [str(numbers[step]) for step in steps])
    axes.set_xlabel("frame")


def _draw_matrix(axes: Axes, values: Array, names: Sequence[str]) -> AxesImage:
    image = axes.imshow(values, cmap=_WEIGHT, vmin=0, vmax=1, aspect="auto", interpolation="nearest")
    axes.set_yticks(range(len(names)), names)
    axes.set_yticks(np.arange(len(names) - 1) + 0.5, minor=True)
    axes.grid(which="minor", axis="y", color="0.8", linewidth=0.8)
    axes.tick_params(which="minor", length=0)
    _style.tidy(axes)
    return image


def _mean(values: Array, axis: int | tuple[int, ...]) -> Array:
    """Return the mean over ``axis`` of what is not NaN; NaN where nothing is left."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # the mean of nothing is NaN, as it should be
        mean: Array = np.nanmean(values, axis=axis)
    return mean

"""``overview.png`` of several people: paths from above, who is there when, and all of them in one frame."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from skelsplat._arrays import Array, ArrayFields, Index, Mask, medians
from skelsplat.viz import _style
from skelsplat.viz._body import Skeleton, draw_limbs, draw_points, reach, upright
from skelsplat.viz.curves import TimeAxis, draw_series

_ROW_IN, _PLAN_IN, _SIDE_IN, _AROUND_IN = 0.34, 6.0, 3.3, 1.6
_MOST_NAME = 14  # letters
_MARGIN_MM = 500.0
_AROUND_MM = [[-200.0, -100.0], [200.0, 300.0]]  # the people from the side, for their names
_FAR = 3.0  # cameras farther away than so many times the size of the plan are left out
_BAR = 0.76  # height of a bar in its row
_DIRECTIONS = 24  # that are tried for the view from the side


@dataclass(frozen=True)
class PersonTrack(ArrayFields):
    """One of several people, in the frames (F,) in which they are followed."""

    name: str  # how the person is called, such as "person 0"
    frames: Index  # (F,) ascending frame numbers
    # (F, N, 3) joint positions before and after the refinement, in mm; NaN where unknown
    start: Array
    refined: Array
    error_bar: Array  # (F, N, 3, 3) covariances of the refined joints, in mm²; NaN where unknown
    status: npt.NDArray[np.str_]  # (F, N) joints whose status is not ``"ok"`` are drawn hollow
    seen: Mask  # (F, M) cameras with a detection of the person that is used and not rejected
    # (F,) median reprojection error in px, and part of the detections used that is rejected; NaN without any
    error_px: Array
    rejected: Array

    @property
    def views(self) -> Index:
        """How many cameras see the person, (F,)."""
        return np.asarray(self.seen.sum(axis=1), dtype=np.int64)

    @property
    def middle(self) -> Array:
        """Median of the joints, (F, 3): of those that are ``"ok"`` if there are any; NaN without joints."""
        ok = self.status == "ok"
        sure = np.where((ok | ~ok.any(axis=1, keepdims=True))[..., None], self.refined, np.nan)
        return medians(np.moveaxis(sure, 1, -1))


@dataclass(frozen=True)
class PeopleData(ArrayFields):
    """What the picture shows."""

    people: Sequence[PersonTrack]  # at least one, in the order of their identities
    camera_names: Sequence[str]  # M names
    centres: Array  # (M, 3) the cameras' positions, in mm
    up: Array  # (3,) the vertical: an axis of the world or its opposite
    skeleton: Skeleton  # limbs
    title: str  # what was recorded


def all_frames(people: Sequence[PersonTrack]) -> Index:
    """Return the numbers of the frames in which anybody is followed, ascending."""
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *(person.frames for person in people)]))


def spread_out(frames: Index, own: Index, values: npt.NDArray[Any], empty: object) -> npt.NDArray[Any]:
    """Return ``values`` (F, …) of the frames ``own`` in the frames ``frames`` (T,), ``empty`` in others."""
    whole = np.full((len(frames), *values.shape[1:]), empty, dtype=values.dtype)
    whole[np.searchsorted(frames, own)] = values
    return whole


def with_gaps(frames: Index) -> Index:
    """Return frame numbers with the first and the last one of every gap among them, where nobody is there."""
    steps = np.diff(frames)
    usual = int(np.median(steps)) if len(steps) else 1
    ends = np.flatnonzero(steps > 1.5 * usual)
    return np.unique(np.concatenate([frames, frames[ends] + usual, frames[ends + 1] - usual]))


@_style.drawn_for(_style.SCREEN)
def write_people(path: str | os.PathLike[str], data: PeopleData) -> Path:
    """Draw the picture and write it to ``path``."""
    rows = _ROW_IN * len(data.people)
    errors = max(_PLAN_IN - rows - 0.7, 2.0)
    heights = [rows, errors, _SIDE_IN]
    figure = _style.new_figure(_style.SCREEN_IN, sum(heights) + _AROUND_IN)
    _style.head(figure, data.title)
    panels = figure.subplot_mosaic(
        [["plan", "bars"], ["plan", "errors"], ["side"] * 2], height_ratios=heights
    )
    time, (turn, names) = TimeAxis(all_frames(data.people)), upright(data.up)
    _draw_plan(panels["plan"], data, turn)
    panels["plan"].set(xlabel=f"{names[0]} [mm]", ylabel=f"{names[1]} [mm]")
    _draw_bars(panels["bars"], data, time)
    _draw_errors(panels["errors"], data, time)
    _draw_side(panels["side"], data, turn)
    for name in ("bars", "errors"):
        panels[name].set_xlim(time.values[0] - time.step / 2, time.values[-1] + time.step / 2)
    for name in ("plan", "side"):
        panels[name].set_aspect("equal", adjustable="datalim")
        panels[name].grid()
    return _style.save_png(figure, path)


def _draw_plan(axes: Axes, data: PeopleData, turn: Array) -> None:
    """Draw the paths from above, pale where few views see the person, and the cameras."""
    for place, person in enumerate(data.people):
        colour, path = _style.person_colour(place), (person.middle @ turn.T)[:, :2]
        lines = np.stack([path[:-1], path[1:]], axis=1)
        steps = np.diff(person.frames)
        whole = steps < 1.5 * np.median(steps) if len(steps) else steps > 0
        tints = [_style.tint(colour, count / len(data.camera_names)) for count in person.views[1:][whole]]
        axes.add_collection(LineCollection(list(lines[whole]), colors=tints, linewidths=2.4, zorder=3))
        known = path[np.isfinite(path).all(axis=1)]
        if len(known):
            axes.plot(*known[0], "o", color=colour, markerfacecolor="white", markersize=7, zorder=4)
            axes.plot(*known[-1], "o", color=colour, markersize=8, zorder=4)
            _label(axes, known[-1], person.name, colour)
    low, high = reach(np.concatenate([(person.middle @ turn.T)[:, :2] for person in data.people]), _MARGIN_MM)
    centres = (data.centres @ turn.T)[:, :2]
    near = np.linalg.norm(centres - (low + high) / 2, axis=1) < _FAR * np.linalg.norm(high - low)
    for name, at in zip(np.array(data.camera_names)[near], centres[near], strict=True):
        axes.plot(*at, "s", color=_style.BEFORE, markersize=6, zorder=2)
        _label(axes, at, str(name), "0.35")
    axes.update_datalim(np.concatenate([centres[near], [low - _MARGIN_MM, high + _MARGIN_MM]]))
    axes.set_title("paths from above: ○ first, ● last frame")


def _draw_bars(axes: Axes, data: PeopleData, time: TimeAxis) -> None:
    """Draw a row per person: a bar where they are followed, pale where few views see them."""
    views = len(data.camera_names)
    for row, person in enumerate(data.people):
        count = spread_out(time.frames, person.frames, person.views, -1)
        for seen in np.unique(person.views):
            tint = _style.tint(_style.person_colour(row), seen / views)
            axes.broken_barh(time.runs(count == seen), (row - _BAR / 2, _BAR), color=tint, linewidth=0)
    axes.set_ylim(len(data.people) - 0.5, -0.5)
    axes.set_yticks(range(len(data.people)), [_short(person.name) for person in data.people])
    axes.set_title(f"who is there when (dark: all {views} views, pale: none)")
    axes.tick_params(labelbottom=False)


def _draw_errors(axes: Axes, data: PeopleData, time: TimeAxis) -> None:
    """Draw the median reprojection error of each person over the frames."""
    highest = 1.0
    for place, person in enumerate(data.people):
        values = spread_out(time.frames, person.frames, person.error_px, np.nan)
        draw_series(axes, time, values, color=_style.person_colour(place), linewidth=1.5)
        known = values[np.isfinite(values)]
        highest = max(highest, 1.3 * float(np.percentile(known, 99)) if len(known) else 0.0)
    axes.set(ylim=(0, highest), xlabel="frame", ylabel="error [px]")
    axes.set_title("median reprojection error of each person")
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    axes.grid()


def _draw_side(axes: Axes, data: PeopleData, turn: Array) -> None:
    """Draw the people of a frame with most of them, from where the smallest gap between two is widest."""
    frames = all_frames(data.people)
    middles = [spread_out(frames, person.frames, person.middle, np.nan) for person in data.people]
    flat = (np.stack(middles) @ turn.T)[..., :2]  # (P, T, 2)
    count = np.isfinite(flat).all(axis=-1).sum(axis=0)
    fullest = np.flatnonzero(count == count.max())
    place = fullest[len(fullest) // 2]
    there = flat[np.isfinite(flat[:, place]).all(axis=1), place]
    angles = np.linspace(0.0, np.pi, _DIRECTIONS, endpoint=False)
    directions = np.stack([np.cos(angles), np.sin(angles)])  # (2, D)
    gaps = np.diff(np.sort(there @ directions, axis=0), axis=0).min(axis=0, initial=np.inf)
    along = directions[:, np.argmax(gaps)]
    everybody = []
    for k, person in enumerate(data.people):
        for index in np.flatnonzero(person.frames == frames[place]):
            pose, colour = person.refined[index] @ turn.T, _style.person_colour(k)
            points, sure = np.stack([pose[:, :2] @ along, pose[:, 2]], axis=1), person.status[index] == "ok"
            draw_limbs(axes, points, data.skeleton, color=colour, linewidth=2.2, zorder=3)
            faces = np.where(sure, colour, "white").tolist()
            draw_points(axes, points, s=17, facecolors=faces, edgecolors=colour, zorder=4)
            known = points[np.isfinite(points).all(axis=1)]
            if len(known):
                _label(axes, known[np.argmax(known[:, 1])], person.name, colour)
            everybody.append(points)
    low, high = reach(np.concatenate(everybody), _MARGIN_MM)
    shown = np.add([low, high], _AROUND_MM)
    axes.update_datalim(shown)
    axes.set_xlim(*shown[:, 0], auto=True)
    axes.set_ylim(*shown[:, 1], auto=True)
    axes.set(xlabel="across [mm]", ylabel="height [mm]")
    axes.set_title(f"frame {frames[place]}, from the side (hollow: joints that are not ok)")


def _label(axes: Axes, at: Array, name: str, colour: str) -> None:
    """Write a name above a place, with a white edge, as it may lie on paths."""
    style: dict[str, Any] = {
        "ha": "center",
        "va": "bottom",
        "textcoords": "offset points",
        "annotation_clip": True,
    }
    note = axes.annotate(_short(name), tuple(at), xytext=(0, 6), color=colour, zorder=6, **style)
    note.set_path_effects([withStroke(linewidth=2.5, foreground="white")])


def _short(name: str) -> str:
    return name if len(name) <= _MOST_NAME else f"{name[: _MOST_NAME - 1]}…"

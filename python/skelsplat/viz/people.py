"""``overview.png`` of several people: paths from above, who is there when, and all of them in one frame."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
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
from skelsplat.viz._skeleton import Skeleton, draw_limbs
from skelsplat.viz._time import TimeAxis, draw_series
from skelsplat.viz.report._scene import reach, upright

# Places of the panels, in inches.
_EDGE_IN, _FOOT_IN, _HEAD_IN, _LINE_IN = 0.3, 0.7, 0.85, 0.25
_PLAN_IN = (6.2, 6.0)
_TIME_LEFT_IN, _NAME_IN, _LETTER_IN = 7.45, 0.35, 0.075
_ROW_IN, _BETWEEN_IN = 0.34, 0.95
_SIDE_IN = 3.1
_LETTERS = 135  # of a line of the caption
_MOST_NAME = 14  # letters
_MARGIN_MM = 500.0
_FAR = 3.0  # cameras farther away than so many times the size of the plan are left out
_BAR = 0.76  # height of a bar in its row
# Frames and directions that are tried for the view from the side.
_MOST_TRIED, _DIRECTIONS = 400, 24
_MOST_FRAMES = 4000  # of a longer recording, one frame in k is drawn


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


def write_people(path: str | os.PathLike[str], data: PeopleData) -> Path:
    """Draw the picture and write it to ``path``."""
    data = replace(data, people=thinned(data.people, _MOST_FRAMES))
    title = textwrap.wrap(data.title, _LETTERS)
    rows = _ROW_IN * len(data.people)
    tall = max(_PLAN_IN[1], rows + _BETWEEN_IN + 2.0)
    above = _FOOT_IN + _SIDE_IN + _BETWEEN_IN + 0.1
    figure = _style.new_figure(above + tall + _HEAD_IN + _LINE_IN * len(title))
    turn, names = upright(data.up)
    plan = figure.add_axes(_style.box(figure, 0.9, above, _PLAN_IN[0], tall))
    _draw_plan(plan, data, turn, names)
    left = _TIME_LEFT_IN + _NAME_IN + _LETTER_IN * max(len(_short(person.name)) for person in data.people)
    width = figure.get_figwidth() - _EDGE_IN - left
    time = TimeAxis(all_frames(data.people))
    bars = figure.add_axes(_style.box(figure, left, above + tall - rows, width, rows))
    _draw_bars(bars, data, time)
    errors = figure.add_axes(_style.box(figure, left, above, width, tall - rows - _BETWEEN_IN))
    _draw_errors(errors, data, time)
    side = figure.add_axes(
        _style.box(figure, 0.9, _FOOT_IN, figure.get_figwidth() - 0.9 - _EDGE_IN, _SIDE_IN)
    )
    _draw_side(side, data, turn)
    _style.heading(figure, figure.get_figheight() - 0.25, "\n".join(title))
    return _style.save_png(figure, path)


def _draw_plan(axes: Axes, data: PeopleData, turn: Array, names: Sequence[str]) -> None:
    """Draw the paths from above, pale where few views see the person, and the cameras."""
    views = len(data.camera_names)
    for place, person in enumerate(data.people):
        colour, path = _style.person_colour(place), (person.middle @ turn.T)[:, :2]
        steps = np.diff(person.frames) < 1.5 * TimeAxis(person.frames).step
        lines = np.stack([path[:-1], path[1:]], axis=1)[steps]
        tints = [_style.tint(colour, count / views) for count in person.views[1:][steps]]
        axes.add_collection(
            LineCollection(list(lines), colors=tints, linewidths=2.4, capstyle="round", zorder=3)
        )
        known = path[np.isfinite(path).all(axis=1)]
        if len(known):
            axes.plot(*known[0], "o", color=colour, markerfacecolor="white", markersize=7, zorder=4)
            axes.plot(*known[-1], "o", color=colour, markersize=8, zorder=4)
            _label(axes, known[-1], _short(person.name), colour)
    places = np.concatenate([(person.middle @ turn.T)[:, :2] for person in data.people])
    low, high = reach(places, _MARGIN_MM)
    flat = (data.centres @ turn.T)[:, :2]
    near = np.linalg.norm(flat - (low + high) / 2, axis=1) < _FAR * np.linalg.norm(high - low)
    for name, at in zip(np.array(data.camera_names)[near], flat[near], strict=True):
        axes.plot(*at, "s", color=_style.BEFORE, markersize=6, zorder=2)
        _label(axes, at, _short(str(name)), "0.35")
    both = np.concatenate([flat[near], [low, high]])
    _fit(axes, both.min(axis=0) - _MARGIN_MM, both.max(axis=0) + _MARGIN_MM)
    axes.set(
        xlabel=f"{names[0]} [mm]", ylabel=f"{names[1]} [mm]", title="paths from above: ○ first, ● last frame"
    )
    _finish(axes)


def _draw_bars(axes: Axes, data: PeopleData, time: TimeAxis) -> None:
    """Draw a row per person: a bar where they are followed, pale where few views see them."""
    views = len(data.camera_names)
    for row, person in enumerate(data.people):
        colour = _style.person_colour(row)
        count = spread_out(time.frames, person.frames, person.views, -1)
        for seen in np.unique(person.views):
            bars = time.runs(count == seen)
            axes.broken_barh(
                bars, (row - _BAR / 2, _BAR), color=_style.tint(colour, seen / views), linewidth=0
            )
    axes.set(ylim=(len(data.people) - 0.5, -0.5), xlim=_span(time))
    axes.set_yticks(range(len(data.people)), [_short(person.name) for person in data.people])
    axes.set(title=f"who is there when (dark: all {views} views, pale: none)")
    axes.tick_params(labelbottom=False)
    _finish(axes)
    axes.grid(visible=False, axis="y")


def _draw_errors(axes: Axes, data: PeopleData, time: TimeAxis) -> None:
    """Draw the median reprojection error of each person over the frames."""
    highest = 1.0
    for place, person in enumerate(data.people):
        values = spread_out(time.frames, person.frames, person.error_px, np.nan)
        draw_series(axes, time, values, color=_style.person_colour(place), linewidth=1.5)
        known = values[np.isfinite(values)]
        highest = max(highest, 1.3 * float(np.percentile(known, 99)) if len(known) else 0.0)
    axes.set(ylim=(0, highest), xlim=_span(time), xlabel="frame", ylabel="error [px]")
    axes.set(title="median reprojection error of each person")
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    _finish(axes)


def _draw_side(axes: Axes, data: PeopleData, turn: Array) -> None:
    """Draw the people of one frame from the side on which the gaps between them are widest."""
    number, along = _widest_gaps(data.people, turn)
    everybody = []
    for place, person in enumerate(data.people):
        for index in np.flatnonzero(person.frames == number):
            pose, colour = person.refined[index] @ turn.T, _style.person_colour(place)
            flat, sure = np.stack([pose[:, :2] @ along, pose[:, 2]], axis=1), person.status[index] == "ok"
            draw_limbs(axes, flat, data.skeleton, color=colour, linewidth=2.2, zorder=3)
            faces = np.where(sure, colour, "white").tolist()
            axes.scatter(flat[:, 0], flat[:, 1], s=17, facecolors=faces, edgecolors=colour, zorder=4)
            known = flat[np.isfinite(flat).all(axis=1)]
            if len(known):
                _label(axes, known[np.argmax(known[:, 1])], _short(person.name), colour)
            everybody.append(flat)
    low, high = reach(np.concatenate(everybody), _MARGIN_MM)
    _fit(axes, low - np.array([200.0, 100.0]), high + np.array([200.0, 300.0]))
    axes.set(xlabel="across [mm]", ylabel="height [mm]")
    axes.set(title=f"frame {number}, from the side (hollow: joints that are not ok)")
    _finish(axes)


def _widest_gaps(people: Sequence[PersonTrack], turn: Array) -> tuple[int, Array]:
    """Return a frame number and a horizontal direction (2,) to draw the people side by side.

    Of the frames with most people, and of the directions, those in which the smallest gap is largest.
    """
    frames = all_frames(people)
    places = np.stack(
        [spread_out(frames, person.frames, person.middle @ turn.T, np.nan) for person in people]
    )
    count = np.isfinite(places).all(axis=-1).sum(axis=0)  # (T,)
    fullest = np.flatnonzero(count == count.max())
    fullest = fullest[:: -(-len(fullest) // _MOST_TRIED)]
    angles = np.linspace(-np.pi / 2, np.pi / 2, _DIRECTIONS, endpoint=False)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    across = np.sort(places[:, fullest, :2] @ directions.T, axis=0)  # (K, T, D), NaN last
    gaps = np.diff(across, axis=0, append=np.inf)
    smallest = np.fmin.reduce(gaps, axis=0)
    frame, direction = np.unravel_index(
        np.argmax(np.where(np.isfinite(smallest), smallest, -1.0)), smallest.shape
    )
    return int(frames[fullest[frame]]), directions[direction]


def _fit(axes: Axes, low: Array, high: Array) -> None:
    """Show a box in one scale for both directions, with more around it where the axes have another shape."""
    across, up = axes.get_position().size * axes.figure.get_size_inches()  # type: ignore[union-attr]
    middle, half = (low + high) / 2, np.max((high - low) / [across, up]) * np.array([across, up]) / 2
    axes.set(xlim=(middle[0] - half[0], middle[0] + half[0]), ylim=(middle[1] - half[1], middle[1] + half[1]))


def _span(time: TimeAxis) -> tuple[float, float]:
    places = time.values
    return float(places[0] - 0.5 * time.step), float(places[-1] + 0.5 * time.step)


def _label(axes: Axes, at: Array, words: str, colour: str) -> None:
    """Write words above a place, with a white edge, as they may lie on paths."""
    style = {"ha": "center", "va": "bottom", "textcoords": "offset points", "annotation_clip": True}
    edge = [withStroke(linewidth=2.5, foreground="white")]
    size = _style.SCREEN.small_pt
    note = axes.annotate(words, at, xytext=(0, 6), color=colour, fontsize=size, zorder=6, **style)  # type: ignore[arg-type]
    note.set(path_effects=edge, parse_math=False)  # a name is no formula


def _short(name: str) -> str:
    return name if len(name) <= _MOST_NAME else f"{name[: _MOST_NAME - 1]}…"


def _finish(axes: Axes) -> None:
    axes.grid(color="0.92", linewidth=0.8)
    axes.set_axisbelow(True)
    _style.tidy(axes)


def all_frames(people: Sequence[PersonTrack]) -> Index:
    """Return the numbers of the frames in which anybody is followed, ascending."""
    return np.unique(np.concatenate([np.empty(0, dtype=np.int64), *(person.frames for person in people)]))


def spread_out(frames: Index, own: Index, values: npt.NDArray[Any], empty: object) -> npt.NDArray[Any]:
    """Return ``values`` (F, …) of the frames ``own`` in the frames ``frames`` (T,), ``empty`` in others."""
    whole = np.full((len(frames), *values.shape[1:]), empty, dtype=values.dtype)
    kept = np.isin(own, frames)
    whole[np.searchsorted(frames, own[kept])] = values[kept]
    return whole


def thinned(people: Sequence[PersonTrack], most: int) -> list[PersonTrack]:
    """Return people in some ``most`` of all frames, evenly chosen; nobody is lost."""
    frames = all_frames(people)
    if len(frames) <= most:
        return list(people)
    some, kept = frames[:: -(-len(frames) // most)], []
    for person in people:
        rows = np.isin(person.frames, some)
        rows[:1] |= not rows.any()
        arrays = {field.name: getattr(person, field.name)[rows] for field in fields(person)[1:]}
        kept.append(replace(person, **arrays))
    return kept


def with_gaps(frames: Index) -> Index:
    """Return frame numbers with the first and the last one of every gap among them, where nobody is there."""
    steps = np.diff(frames)
    usual = int(np.median(steps)) if len(steps) else 1
    ends = np.flatnonzero(steps > 1.5 * usual)
    return np.unique(np.concatenate([frames, frames[ends] + usual, frames[ends + 1] - usual]))

"""The page of several people: all of them in one scene, who is there when, numbers and findings of each."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array, Index
from skelsplat._atomic import atomic_write_text
from skelsplat.viz._people import PersonTrack, all_frames, spread_out
from skelsplat.viz._skeleton import Skeleton
from skelsplat.viz.report import _parts
from skelsplat.viz.report._parts import PageData, Table, TimeLines
from skelsplat.viz.report._scene import (
    CameraShapes,
    Sequence3D,
    as_text,
    frames_to_show,
    pack_scene,
    person_class,
)

# Views that place a person surely; two agree on whatever lies where their rays meet.
_CONFIRMED = 3
_PROGRAMS = ("decode.js", "body.js", "view.js", "charts.js", "player.js")


@dataclass(frozen=True)
class PeopleReportData(PageData):
    """A whole report of several people."""

    people: Sequence[PersonTrack]  # at least one, in the order of their identities
    findings: Sequence[Sequence[str]]  # sentences on each person
    table: Table  # a row per person
    bones: Table  # a row per bone, a column per person; no rows without any
    joint_names: Sequence[str]  # N names
    skeleton: Skeleton  # limbs
    shapes: CameraShapes
    up: Array  # (3,) the vertical: an axis of the world or its opposite
    frame_rate: float | None  # frames per second; None if unknown
    start_name: str  # what the poses before the refinement are, in words

    def sequence(self, frames: Index) -> Sequence3D:
        """Return all people in ``frames`` as one sequence, whose joints are those of one after the other."""

        def together(name: str, empty: object) -> Any:
            values = [spread_out(frames, one.frames, getattr(one, name), empty) for one in self.people]
            return np.concatenate(values, axis=1)

        return Sequence3D(
            start=together("start", np.nan),
            refined=together("refined", np.nan),
            error_bar=together("error_bar", np.nan),
            status=together("status", "unobserved"),
            frames=frames,
            frame_rate=self.frame_rate,
            joint_names=[f"{one.name}, {joint}" for one in self.people for joint in self.joint_names],
            skeleton=self.skeleton,
            up=self.up,
            start_name=self.start_name,
            people=[one.name for one in self.people],
            on_floor=well_seen(self.people),
        )


def write_people_report(path: str | os.PathLike[str], data: PeopleReportData) -> Path:
    """Write a report of several people as one HTML file, as `write_report` does.

    `_scene.MOST_POSITIONS` is the limit for all people together.
    """
    atomic_write_text(path, build_people_page(data))
    return Path(path)


def build_people_page(data: PeopleReportData) -> str:
    """Return the page's text."""
    frames = with_gaps(all_frames(data.people))
    places, every = frames_to_show(frames, len(data.people) * len(data.joint_names), data.wanted)
    sequence = data.sequence(frames[places])
    content = {
        "scene": pack_scene(sequence, data.shapes, np.arange(len(places))),
        "bars": _bars(data, frames[places]),
        "lines": [_parts.packed_line(line, places) for line in _lines(data.people, frames)],
    }
    known = sequence.status[np.isfinite(sequence.refined).all(axis=-1)]
    thinned = _parts.thinned(len(frames), len(places), every, "Tables")
    return _parts.assemble(
        _PROGRAMS,
        content,
        data,
        thinned,
        warnings=_warnings(data),
        warnings_kind="loud" if data.warnings or any(data.findings) else "quiet",
        player=_parts.fill(
            "player.html",
            start=escape(data.start_name),
            refined=sequence.refined_name,
            grey=escape(sequence.grey),
            alone="",
            ellipsoids="",
            follow=_follow(data.people),
            whom="people",
            groups=" ".join(_named(one.name, place) for place, one in enumerate(data.people)),
            walked="",
            hollow=_parts.hollow_key(known),
        ),
        sections=_parts.fill(
            "people.html",
            people=_parts.table(data.table),
            views=str(len(data.shapes.names)),
            meanings=_parts.meanings(data.table),
            findings=_findings(data),
            bones=_parts.fill("people_bones.html", bones=_parts.table(data.bones)) if data.bones.rows else "",
        ),
    )


def well_seen(people: Sequence[PersonTrack]) -> list[int]:
    """Return the places of the people whom usually three views or more see, or without any the most views."""
    views = [float(np.median(one.views)) if len(one.views) else 0.0 for one in people]
    return [place for place, own in enumerate(views) if own >= min(_CONFIRMED, max(views))]


def with_gaps(frames: Index) -> Index:
    """Return frame numbers with the first and the last one of every gap among them, where nobody is there."""
    steps = np.diff(frames)
    usual = int(np.median(steps)) if len(steps) else 1
    ends = np.flatnonzero(steps > 1.5 * usual)
    return np.unique(np.concatenate([frames, frames[ends] + usual, frames[ends + 1] - usual]))


def _bars(data: PeopleReportData, frames: Index) -> dict[str, Any]:
    """Return how many views see each person in each frame; −1 where they are not there."""
    return {
        "views": len(data.shapes.names),
        "people": [
            {
                "name": one.name,
                "colour": person_class(place),
                "views": as_text(spread_out(frames, one.frames, one.views, -1), "<i2"),
            }
            for place, one in enumerate(data.people)
        ],
    }


def _lines(people: Sequence[PersonTrack], frames: Index) -> list[TimeLines]:
    """Return the curves of everybody: errors, rejected detections, distance to the nearest person."""

    def curves(values: Sequence[Array]) -> list[tuple[str, str, Array]]:
        return [
            (one.name, person_class(place), spread_out(frames, one.frames, own, np.nan))
            for place, (one, own) in enumerate(zip(people, values, strict=True))
        ]

    lines = [
        TimeLines("Median reprojection error", "px", curves([one.error_px for one in people])),
        TimeLines("Detections rejected", "%", curves([100 * one.rejected for one in people]), peaks=True),
    ]
    if len(people) > 1:
        lines.append(TimeLines("Distance to the nearest other person", "m", _apart(people, frames)))
    return lines


def _apart(people: Sequence[PersonTrack], frames: Index) -> list[tuple[str, str, Array]]:
    """Return the distance in m from the middle of each person to that of the nearest other one."""
    middles = np.stack([spread_out(frames, one.frames, one.middle, np.nan) for one in people])
    curves = []
    for place, one in enumerate(people):
        others = np.delete(middles, place, axis=0)
        nearest = np.fmin.reduce(np.linalg.norm(others - middles[place], axis=-1), axis=0)
        curves.append((one.name, person_class(place), nearest / 1000.0))
    return curves


def _warnings(data: PeopleReportData) -> str:
    """Return the sentences on everybody, and links to those on each person."""
    counted = list(zip(data.people, data.findings, strict=True))
    links = ", ".join(
        f'<a href="#on-{place}">{escape(one.name)}</a> ({len(sentences)})'
        for place, (one, sentences) in enumerate(counted)
        if sentences
    )
    quiet = ", ".join(escape(one.name) for one, sentences in counted if not sentences)
    parts = [
        _parts.bullets(data.warnings),
        f"<p>On {links}: see below.</p>" if links else "",
        f"<p>None on {quiet}.</p>" if quiet else "",
    ]
    return "\n".join(part for part in parts if part)


def _findings(data: PeopleReportData) -> str:
    """Return the section with the sentences on each person; nothing without any."""
    parts = [
        f'<h3 id="on-{place}">{_named(one.name, place)}</h3>\n{_parts.bullets(sentences)}'
        for place, (one, sentences) in enumerate(zip(data.people, data.findings, strict=True))
        if sentences
    ]
    if not parts:
        return ""
    title = '<h2 id="findings-title">Warnings on each person</h2>'
    return "\n".join(
        ['<section aria-labelledby="findings-title" class="findings">', title, *parts, "</section>"]
    )


def _named(name: str, place: int) -> str:
    return f'<span class="person {person_class(place)}">{escape(name)}</span>'


def _follow(people: Sequence[PersonTrack]) -> str:
    """Return the choice of the person whom the view follows."""
    options = [f'<option value="{place}">{escape(one.name)}</option>' for place, one in enumerate(people)]
    nobody = '<option value="">nobody</option>'
    return f'<label>follow <select id="follow">{nobody}{"".join(options)}</select></label>'

"""A run as one HTML page, of one person or of several."""

from __future__ import annotations

import base64
import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from skelsplat._arrays import Array, ArrayFields, Index
from skelsplat._atomic import atomic_write_text
from skelsplat._json import plain
from skelsplat._optional import require
from skelsplat._words import Table
from skelsplat.viz import _style
from skelsplat.viz._body import not_ok_in_words
from skelsplat.viz.curves import limits
from skelsplat.viz.report import _html
from skelsplat.viz.report._html import Problem, Sentence, tag
from skelsplat.viz.report._scene import (
    CameraShapes,
    Sequence3D,
    as_text,
    frames_to_show,
    pack_scene,
    person_class,
)

# One program in several files, in this order; some are for single parts of the page.
_PROGRAMS = ("decode.js", "body.js", "view.js", "charts.js", "heat.js", "panels.js", "player.js")
_ZOOM = "Click to go to a frame, drag to zoom, double-click to zoom out."


@dataclass(frozen=True)
class TimeLines(ArrayFields):
    """Curves over the frames: per person or side of the body, or one, and what it is compared with."""

    title: str
    unit: str
    # name, name of the colour in the style ("start": grey, for what it is compared with), values (T,), NaN
    # where there is none
    curves: Sequence[tuple[str, str, Array]]
    peaks: bool = False  # of a sequence that is thinned out, keep the largest value between two frames shown
    sigmas: Sequence[Array] = ()  # of each curve the standard deviations (T,), as a band; NaN where unknown

    def packed(self, places: Index) -> dict[str, Any]:
        """Return the curves at ``places`` for the page."""
        thin = (lambda one: np.fmax.reduceat(one, places)) if self.peaks else (lambda one: one[places])
        curves = [
            {"name": name, "colour": colour, "values": as_text(thin(values), "<f4")}
            for name, colour, values in self.curves
        ]
        packed: dict[str, Any] = {"title": self.title, "unit": self.unit, "curves": curves}
        if self.sigmas:
            for curve, sigma in zip(curves, self.sigmas, strict=True):
                curve["sigma"] = as_text(sigma[places], "<f4")
            values, sigmas = np.stack([one[places] for _, _, one in self.curves]), np.stack(self.sigmas)
            low, high = limits(values, sigmas[:, places] / 2)  # which are of two σ
            packed["range"] = [min(low, 0.0), max(high, 0.0)]
        return packed


@dataclass(frozen=True)
class Heat(ArrayFields):
    """One choice of what a heat map shows."""

    name: str  # for the choice
    unit: str
    words: str  # on the cell under the pointer; ``%{z:.1f}`` is its value to one decimal
    values: Array  # (R, C); NaN where there is none
    most: float | None = None  # the value in full colour; None: the largest


@dataclass(frozen=True)
class HeatMap:
    """R rows and C columns of cells, with what they may show, the first of it at first."""

    title: str
    rows: Sequence[str]
    columns: Sequence[str]
    kinds: Sequence[Heat]
    hint: str = ""

    def packed(self) -> dict[str, Any]:
        """Return the map for the page."""
        kinds = [{**vars(kind), "values": as_text(kind.values, "<f4")} for kind in self.kinds]
        return {"rows": list(self.rows), "columns": list(self.columns), "kinds": kinds}

    def section(self) -> str:
        """Return its section of the page."""
        choices = [
            tag("label", f'<input type="radio" name="heat" value="{k}" {"" if k else "checked"}> {kind.name}')
            for k, kind in enumerate(self.kinds)
        ]
        shown = tag("fieldset", "\n".join(["<legend>Shown</legend>", *choices]))
        drawn = tag("div", "", id="heat", role="img", aria_label=f"Heat map: {self.title}")
        body = tag("div", shown, class_="choices") + "\n" + drawn
        return _html.section("heat-title", escape(self.title), body, self.hint)


@dataclass(frozen=True)
class ReportData(ArrayFields):
    """A whole report; T frames are those of ``sequence``, of several people those of all."""

    title: str  # what was refined
    facts: Sequence[tuple[str, str]]  # (name, value) pairs for the line below it
    warnings: Sequence[Sentence]  # of several people on everybody; empty without any
    notes: Sequence[Sentence | str]  # on how to read the numbers and on what was done to the poses
    numbers: Sequence[tuple[str, str, str]]  # (label, text, remark) of the numbers worth a glance
    problems: (
        Sequence[Problem] | None
    )  # stretches of frames with the same problem; None: it is not about them
    sequence: Sequence3D
    shapes: CameraShapes
    tables: Sequence[Table]
    lines: Sequence[TimeLines]
    # of several people: the sentences on each, or none at all, and (T,) how many cameras see them, −1 if they
    # are not there
    findings: Sequence[Sequence[Sentence]] = ()
    views: Sequence[Index] = ()
    heat: HeatMap | None = None
    heading: str = "The sequence in 3D"  # of the 3D view
    # (joint, joint, length, standard error) of the bones of a solution over time, in mm; NaN where unknown
    bones: Sequence[tuple[int, int, float, float]] = ()

    @property
    def by_person(self) -> list[tuple[int, tuple[str, Sequence[Sentence]]]]:
        """Place, name and sentences of each of several people; none without sentences on people."""
        people = self.sequence.people if self.findings else ()
        return list(enumerate(zip(people, self.findings, strict=True)))


def write_report(path: str | os.PathLike[str], data: ReportData) -> Path:
    """Write a report as one HTML file that needs no network, whole or not at all.

    A sequence of more than `_scene.MOST_POSITIONS` is thinned out, and the page says so.
    """
    plotly_js = require("plotly.offline", "report.html", "viz").get_plotlyjs()  # slow, and only needed here
    sequence, problems = data.sequence, data.problems or ()
    wanted = [number for first, last, _ in problems for number in (first, last)]
    places, every = frames_to_show(sequence.frames, len(sequence.joint_names), wanted)
    without = {"heat.js": data.heat is None, "panels.js": not sequence.has_trajectory}
    program = "\n".join(_resource(name) for name in _PROGRAMS if not without.get(name))
    # JSON that cannot end its element
    content = json.dumps(plain(_content(data, places)), allow_nan=False, separators=(",", ":"))
    for sign in "<>&":
        content = content.replace(sign, f"\\u{ord(sign):04x}")
    notes, count = list(data.notes), len(sequence.frames)
    if len(places) < count:
        notes.append(
            f"Of {count:,} frames, the 3D view and the curves show {len(places):,}: one in {every}, and "
            "those with a problem. Curves of counts and largest values keep the highest between two of them. "
            "Tables and the heat map cover all frames."
        )
    page = Template(_resource("page.html")).substitute(
        policy=_policy([plotly_js, program]),
        style=_resource("style.css"),
        plotly=plotly_js,
        program=program,
        data=content,
        title=escape(data.title),
        facts=_html.described(data.facts),
        warnings=_warnings(data),
        warnings_kind="loud" if data.warnings or any(data.findings) else "quiet",
        numbers=_html.described(data.numbers),
        **_player(data),
        sections=_sections(data),
        problems=_html.problem_rows(problems),
        notes=_html.bullets(notes),
    )
    atomic_write_text(path, page)
    return Path(path)


def _resource(name: str) -> str:
    return (files("skelsplat.viz.report") / name).read_text(encoding="utf-8")


def _content(data: ReportData, places: Index) -> dict[str, Any]:
    """Return the page's data."""
    sequence, names = data.sequence, list(data.shapes.names)
    content: dict[str, Any] = {
        "scene": pack_scene(sequence, data.shapes, places),
        "lines": [line.packed(places) for line in data.lines],
        "bones": None,
        "problems": [list(row) for row in data.problems or ()],
    }
    if data.heat is not None:
        content["heat"] = data.heat.packed()
    if sequence.alone is not None:
        bones = data.bones
        content["bones"] = [{"ends": [a, b], "length_mm": mm, "sigma_mm": sigma} for a, b, mm, sigma in bones]
    if data.views:
        people = [
            {"name": name, "colour": person_class(place), "views": as_text(views[places], "<i2")}
            for place, (name, views) in enumerate(zip(sequence.people, data.views, strict=True))
        ]
        content["bars"] = {"views": len(names), "people": people}
    return content


def _policy(programs: Sequence[str]) -> str:
    """Return a Content-Security-Policy that allows these programs and no connection of any kind.

    plotly.js sets styles of its own, and saves pictures by way of data and blob addresses.
    """
    digests = [hashlib.sha256(text.encode("utf-8")).digest() for text in programs]
    hashes = " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
    return (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )


def _warnings(data: ReportData) -> str:
    """Return the sentences on everything, and links to those on each person."""
    named = data.by_person
    links = [
        f"{tag('a', escape(name), href=f'#on-{place}')} ({len(own)})" for place, (name, own) in named if own
    ]
    quiet = [escape(name) for _, (name, own) in named if not own]
    parts = [_html.bullets(data.warnings)] if data.warnings else []
    parts += [tag("p", f"On {', '.join(links)}: see below.")] if links else []
    parts += [tag("p", f"None on {', '.join(quiet)}.")] if quiet else []
    below = "" if data.problems is None else " Frames with a problem are listed below."
    return "\n".join(parts or [tag("p", f"None.{below}")])


def _player(data: ReportData) -> dict[str, str]:
    """Return the title, the choices and the key of the 3D view."""
    sequence, sigmas = data.sequence, data.shapes.sigmas
    several = bool(sequence.people)
    follow = '<label><input type="checkbox" id="follow"> follow</label>'
    groups = [tag("span", side, class_=side) for side in _style.SIDES]
    if several:
        options = [tag("option", escape(name), value=str(k)) for k, name in enumerate(sequence.people)]
        options.insert(0, '<option value="">nobody</option>')
        follow = tag("label", "follow " + tag("select", "".join(options), id="follow"))
        groups = [_named(name, place) for place, name in enumerate(sequence.people)]
    alone = '<label><input type="radio" name="pose" value="alone"> frame by frame</label>'
    hollow = not_ok_in_words(sequence.status[np.isfinite(sequence.refined).all(axis=-1)])

    def only(wanted: bool) -> str:
        return "" if wanted else "hidden"

    return {
        "heading": data.heading,
        "refined_only": only(sequence.start is not None),
        "errors_only": only(bool(np.isfinite(sequence.error_bar).any())),
        "places_only": only(sigmas is not None),
        "problems_only": only(data.problems is not None),
        "places": "checked" if sigmas is not None else "",
        "sigmas": f"{sigmas or 0:g}",
        "start": escape(sequence.start_name),
        "refined": sequence.refined_name,
        "grey": escape(sequence.grey),
        "alone": "" if sequence.alone is None else alone,
        "ellipsoids": "" if several else "checked",
        "follow": follow,
        "whom": "people" if several else "person",
        "groups": " ".join(groups),
        "walked": "" if several else tag("span", "path on the floor", class_="walked"),
        "hollow": tag("span", escape(hollow), class_="hollow") if hollow else "",
    }


def _named(name: str, place: int) -> str:
    return tag("span", escape(name), class_=f"person {person_class(place)}")


def _sections(data: ReportData) -> str:
    """Return what lies between the 3D view and the frames with a problem."""
    sequence, parts = data.sequence, [_html.table(one) for one in data.tables]
    findings = [
        f"{tag('h3', _named(name, place), id=f'on-{place}')}\n{_html.bullets(sentences)}"
        for place, (name, sentences) in data.by_person
        if sentences
    ]
    if findings:
        title = "Warnings on each person"
        parts.append(_html.section("findings-title", title, "\n".join(findings), kind="findings"))
    if data.heat is not None:
        parts.append(data.heat.section())
    if data.lines:
        bars = f"Bars: in full colour where all {len(data.shapes.names)} cameras see the person, faint "
        bars += "where none. "
        lines = tag("div", _drawn("lines", "Curves") + '<div id="cursor" hidden></div>', class_="charts")
        parts.append(_html.section("over-time", "Over time", lines, f"{bars if data.views else ''}{_ZOOM}"))
    if sequence.has_trajectory:
        hint = f"Colour: {sequence.refined_name}, with a band of ±2 standard deviations; grey: "
        hint += f"{escape(sequence.grey)}. Click to go to a frame."
        choice = tag("label", 'Joint <select id="trajectory-joint"></select>')
        chart = tag("div", choice, class_="choices") + _drawn("trajectory", "Position of a joint")
        parts.append(_html.section("trajectory-title", "Trajectory", chart, hint))
    if sequence.alone is not None:
        hint = "Thin: frame by frame; thick: over time; band: length for all frames ± its standard error."
        bones = _drawn("bones", "Lengths of the bones")
        parts.append(_html.section("bones-title", "Bone lengths [mm]", bones, hint))
        parts.append(_html.section("speeds-title", "Speeds [m/s]", _drawn("speeds", "Speeds of the joints")))
    return "\n".join(parts)


def _drawn(name: str, what: str) -> str:
    return tag("div", "", id=name, role="img", aria_label=f"{what} over the frames")

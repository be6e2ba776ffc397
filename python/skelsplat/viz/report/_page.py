"""The page itself: template, style, programs and data in one file."""

from __future__ import annotations

import base64
import hashlib
import json
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
import numpy.typing as npt

from skelsplat._arrays import Array, ArrayFields, Index
from skelsplat._atomic import atomic_write_text
from skelsplat._json import plain
from skelsplat._optional import require
from skelsplat.viz import _style
from skelsplat.viz._skeleton import not_ok_in_words
from skelsplat.viz.report._scene import (
    CameraShapes,
    Sequence3D,
    as_text,
    frames_to_show,
    pack_scene,
    thin_line,
)

Problem = tuple[int, int, str]

_MOST_PROBLEMS = 500
# One program in several files, in this order.
_PROGRAMS = ("decode.js", "body.js", "view.js", "charts.js", "panels.js", "player.js")


_ALONE_CHOICE = '<label><input type="radio" name="pose" value="alone"> frame by frame</label>'
_IN_TIME = """<section aria-labelledby="bones-title">
<h2 id="bones-title">Bone lengths [mm]</h2>
<p class="hint">Thin: frame by frame; thick: in time; band: length for all frames ± its standard error.</p>
<div id="bones" role="img" aria-label="Lengths of the bones over the frames"></div>
</section>
<section aria-labelledby="speeds-title">
<h2 id="speeds-title">Speeds [m/s]</h2>
<div id="speeds" role="img" aria-label="Speeds of the joints over the frames"></div>
</section>"""


@dataclass(frozen=True)
class Table:
    """Cells as texts; the first of a row names it.

    Columns are (head, what its numbers are in words); ``total`` is a last row for all.
    """

    columns: Sequence[tuple[str, str]]
    rows: Sequence[Sequence[str]]
    total: Sequence[str] = ()


@dataclass(frozen=True)
class TimeLine(ArrayFields):
    """A curve over the frames."""

    # what the values are
    title: str
    unit: str
    values: Array  # (T,) NaN where there is none
    peaks: bool = False  # of a sequence that is thinned out, keep the largest value between two frames shown
    beside: Array | None = None  # (T,) a second curve in grey, called `beside_name`
    beside_name: str = ""


@dataclass(frozen=True)
class ReportData(ArrayFields):
    """A whole report."""

    title: str  # what was refined
    facts: Sequence[tuple[str, str]]  # (name, value) pairs for the line below it
    warnings: Sequence[str]  # sentences; empty without any
    notes: Sequence[str]  # sentences on how to read the numbers and on what was done to the poses
    numbers: Sequence[tuple[str, str, str]]  # (label, text, remark) of the numbers worth a glance
    sequence: Sequence3D
    shapes: CameraShapes
    cameras: Table
    joints: Table
    # (M, N) by camera and joint: median error in px, and the part of the detections that is rejected;
    # NaN where a camera has no detection of a joint that is used
    errors_px: Array
    rejected: Array
    lines: Sequence[TimeLine]
    # (first frame, last frame, words) of stretches of frames that have the same problem
    problems: Sequence[Problem]
    # (joint, joint, length, standard error) of the bones of a solution in time, in mm; NaN where unknown
    bones: Sequence[tuple[int, int, float, float]] = ()


def write_report(path: str | os.PathLike[str], data: ReportData) -> Path:
    """Write a report as one HTML file that needs no network, whole or not at all.

    plotly.js is 4.8 MB of it; a sequence takes 33 bytes per joint and frame, in time 44.
    One of more than `_scene.MOST_POSITIONS` is thinned out, and the page says so.
    """
    atomic_write_text(path, build_page(data))
    return Path(path)


def build_page(data: ReportData) -> str:
    """Return the page's text."""
    plotly_js = require("plotly.offline", "report.html", "viz").get_plotlyjs()  # slow, and only needed here
    sequence = data.sequence
    wanted = [number for first, last, _ in data.problems for number in (first, last)]
    places, every = frames_to_show(sequence.frames, len(sequence.joint_names), wanted)
    content = {
        "scene": pack_scene(sequence, data.shapes, places),
        "heat": {
            "cameras": list(data.shapes.names),
            "joints": list(sequence.joint_names),
            "errors": as_text(data.errors_px, "<f4"),
            "rejected": as_text(data.rejected, "<f4"),
        },
        "lines": [_line(line, places) for line in data.lines],
        "problems": [list(row) for row in data.problems],
        "bones": None if sequence.alone is None else [_bone(bone) for bone in data.bones],
        "colours": {"left": _style.LEFT, "right": _style.RIGHT},
    }
    programs = [plotly_js, "\n".join(_resource(name) for name in _PROGRAMS)]
    return Template(_resource("page.html")).substitute(
        policy=_policy(programs),
        title=escape(data.title),
        style=_resource("style.css"),
        facts="\n".join(
            f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in data.facts
        ),
        warnings=_bullets(data.warnings) or "<p>None. Frames with a problem are listed below.</p>",
        warnings_kind="loud" if data.warnings else "quiet",
        notes=_bullets([*data.notes, *_thinned(len(sequence.frames), len(places), every)]),
        numbers=_tiles(data.numbers),
        cameras=_table(data.cameras),
        joints=_table(data.joints),
        meanings=_meanings(data.joints),
        problems=_problems(data.problems),
        start=escape(sequence.start_name),
        refined=sequence.refined_name,
        grey=escape(sequence.grey),
        alone="" if sequence.alone is None else _ALONE_CHOICE,
        in_time="" if sequence.alone is None else _IN_TIME,
        hollow=_hollow_key(sequence.status),
        plotly=programs[0],
        program=programs[1],
        data=_json(content),
    )


def _policy(programs: list[str]) -> str:
    """Return a Content-Security-Policy that allows these programs and no connection of any kind.

    plotly.js sets styles of its own, and saves pictures by way of data and blob addresses.
    """
    hashes = " ".join(
        f"'sha256-{base64.b64encode(hashlib.sha256(text.encode('utf-8')).digest()).decode()}'"
        for text in programs
    )
    return (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )


def _line(line: TimeLine, places: Index) -> dict[str, Any]:
    def packed(values: Array) -> str:
        return as_text(thin_line(values, places, peaks=line.peaks), "<f4")

    return {
        "title": line.title,
        "unit": line.unit,
        "values": packed(line.values),
        "beside": None if line.beside is None else packed(line.beside),
        "beside_name": line.beside_name,
    }


def _bone(bone: tuple[int, int, float, float]) -> dict[str, Any]:
    a, b, length, sigma = bone
    return {"ends": [a, b], "length_mm": length, "sigma_mm": sigma}


def _thinned(count: int, shown: int, every: int) -> list[str]:
    if shown == count:
        return []
    return [
        f"Of {count:,} frames, the 3D view and the curves show {shown:,}: one in {every}, and frames with a "
        "problem. Curves of counts and of largest values keep the highest value between two of them. Tables "
        "and heat map cover all frames."
    ]


def _json(content: dict[str, Any]) -> str:
    """Return JSON that cannot end its element: ``<``, ``>`` and ``&`` are escaped."""
    text = json.dumps(plain(content), ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _resource(name: str) -> str:
    return (files("skelsplat.viz.report") / name).read_text(encoding="utf-8")


def _tiles(numbers: Iterable[tuple[str, str, str]]) -> str:
    """Return the key numbers, each with its label and remark."""
    return "\n".join(
        f'<div><dt>{escape(label)}</dt><dd>{escape(value)}</dd><dd class="remark">{escape(remark)}</dd></div>'
        for label, value, remark in numbers
    )


def _table(content: Table) -> str:
    """Return a table whose first column names the rows and whose heads are explained on hover."""
    heads = "".join(
        f'<th scope="col" title="{escape(meaning)}">{escape(head)}</th>' for head, meaning in content.columns
    )
    rows = "\n".join(_row(row) for row in content.rows)
    foot = f"<tfoot>{_row(content.total)}</tfoot>" if content.total else ""
    return f"<table>\n<thead><tr>{heads}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n{foot}\n</table>"


def _meanings(content: Table) -> str:
    """Return what the columns mean, for print and for readers without a pointer."""
    explained = [f"<b>{escape(head)}</b> {escape(meaning)}" for head, meaning in content.columns if meaning]
    return "; ".join(explained) + "."


def _problems(rows: Sequence[Problem]) -> str:
    """Return the frames with a problem, linked to the 3D view, the first `_MOST_PROBLEMS` rows of them."""
    if not rows:
        return "<p>None.</p>"
    shown = "\n".join(
        f'<tr><th scope="row">{_frames(first, last)}</th><td>{escape(words)}</td></tr>'
        for first, last, words in rows[:_MOST_PROBLEMS]
    )
    more = len(rows) - _MOST_PROBLEMS
    rest = f"<p>{more:,} more rows are omitted here; report.json lists all frames.</p>" if more > 0 else ""
    head = '<thead><tr><th scope="col">frames</th><th scope="col">problem</th></tr></thead>'
    return f"<table>\n{head}\n<tbody>\n{shown}\n</tbody>\n</table>\n{rest}"


def _hollow_key(status: npt.NDArray[np.str_]) -> str:
    """Return what hollow joints are, for the key of the 3D view; nothing without any."""
    words = not_ok_in_words(status)
    return f'<span class="hollow">{escape(words)}</span>' if words else ""


def _bullets(sentences: Sequence[str]) -> str:
    """Return sentences as a list; nothing without any."""
    items = "\n".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f"<ul>\n{items}\n</ul>" if items else ""


def _row(cells: Sequence[str]) -> str:
    rest = "".join(f"<td>{escape(cell)}</td>" for cell in cells[1:])
    return f'<tr><th scope="row">{escape(cells[0])}</th>{rest}</tr>'


def _frames(first: int, last: int) -> str:
    numbers = [first] if first == last else [first, last]
    return "–".join(f'<a href="#frame={number}">{number}</a>' for number in numbers)

"""What pages are made of: template, style, programs and data in one file, tables and lists as HTML."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

import numpy as np
import numpy.typing as npt

from skelsplat._arrays import Array, ArrayFields, Index
from skelsplat._json import plain
from skelsplat._optional import require
from skelsplat.viz._skeleton import not_ok_in_words
from skelsplat.viz.report._scene import as_text, thin_line
from skelsplat.viz.trajectories import limits

Problem = tuple[int, int, str]

_MOST_PROBLEMS = 500


@dataclass(frozen=True)
class Table:
    """Cells as texts; the first of a row names it.

    Columns are (head, what its numbers are in words); ``total`` is a last row for all. ``marks`` are, of each
    row, the class of its name in the page's style and the address that it links to, or ``""``.
    """

    columns: Sequence[tuple[str, str]]
    rows: Sequence[Sequence[str]]
    total: Sequence[str] = ()
    marks: Sequence[tuple[str, str]] = ()


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

    @property
    def curves(self) -> list[tuple[str, str, Array]]:
        """Name, colour and values of each curve; the last is the one that counts."""
        own = ("", "left", self.values)
        return [own] if self.beside is None else [(self.beside_name, "start", self.beside), own]


@dataclass(frozen=True)
class TimeLines(ArrayFields):
    """Curves over the frames, one per person or side of the body."""

    # what the values are
    title: str
    unit: str
    curves: Sequence[tuple[str, str, Array]]  # name, name of the colour in the style, values (T,)
    peaks: bool = False  # as of `TimeLine`
    sigmas: Sequence[Array] = ()  # of each curve the standard deviations (T,), as a band; NaN where unknown


@dataclass(frozen=True)
class PageData(ArrayFields):
    """What pages of one person and of several have in common."""

    title: str  # what was refined
    facts: Sequence[tuple[str, str]]  # (name, value) pairs for the line below it
    warnings: Sequence[str]  # sentences, of several people on everybody; empty without any
    notes: Sequence[str]  # sentences on how to read the numbers and on what was done to the poses
    numbers: Sequence[tuple[str, str, str]]  # (label, text, remark) of the numbers worth a glance
    # (first frame, last frame, words) of stretches of frames that have the same problem
    problems: Sequence[Problem]

    @property
    def wanted(self) -> list[int]:
        """Numbers of the frames to show in any case."""
        return [number for first, last, _ in self.problems for number in (first, last)]


def assemble(
    programs: Sequence[str], content: dict[str, Any], page: PageData, thinned: Sequence[str], **texts: str
) -> str:
    """Return a page of these programs and data; ``texts`` are further parts of ``page.html`` as HTML."""
    plotly_js = require("plotly.offline", "report.html", "viz").get_plotlyjs()  # slow, and only needed here
    program = "\n".join(resource(name) for name in programs)
    return Template(resource("page.html")).substitute(
        policy=_policy([plotly_js, program]),
        style=resource("style.css"),
        plotly=plotly_js,
        program=program,
        data=_json({**content, "problems": [list(row) for row in page.problems]}),
        title=escape(page.title),
        facts=facts(page.facts),
        numbers=tiles(page.numbers),
        problems=problem_rows(page.problems),
        notes=bullets([*page.notes, *thinned]),
        **texts,
    )


def fill(name: str, **texts: str) -> str:
    """Return a part of a page from its template; ``texts`` are HTML."""
    return Template(resource(name)).substitute(**texts)


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


def packed_line(line: TimeLine | TimeLines, places: Index) -> dict[str, Any]:
    """Return a curve, or several, at ``places`` for the page."""
    packed: dict[str, Any] = {
        "title": line.title,
        "unit": line.unit,
        "curves": [
            {
                "name": name,
                "colour": colour,
                "values": as_text(thin_line(values, places, peaks=line.peaks), "<f4"),
            }
            for name, colour, values in line.curves
        ],
    }
    if isinstance(line, TimeLines) and line.sigmas:
        values, sigmas = (
            np.stack([one[places] for one in each]) for each in ([c[2] for c in line.curves], line.sigmas)
        )
        for curve, sigma in zip(packed["curves"], sigmas, strict=True):
            curve["sigma"] = as_text(sigma, "<f4")
        low, high = limits(values, sigmas / 2, np.full(values.shape, np.nan))  # which are of two σ
        packed["range"] = [min(low, 0.0), max(high, 0.0)]
    return packed


def thinned(count: int, shown: int, every: int, whole: str = "Tables and heat map") -> list[str]:
    """Return a sentence on which of ``count`` frames are shown, if not all."""
    if shown == count:
        return []
    return [
        f"Of {count:,} frames, the 3D view and the curves show {shown:,}: one in {every}, and frames with a "
        "problem. Curves of counts and of largest values keep the highest value between two of them. "
        f"{whole} cover all frames."
    ]


def _json(content: dict[str, Any]) -> str:
    """Return JSON that cannot end its element: ``<``, ``>`` and ``&`` are escaped."""
    text = json.dumps(plain(content), ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def resource(name: str) -> str:
    """Return the text of a file of this folder."""
    return (files("skelsplat.viz.report") / name).read_text(encoding="utf-8")


def facts(pairs: Iterable[tuple[str, str]]) -> str:
    """Return names and values for the line below the title."""
    return "\n".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in pairs)


def tiles(numbers: Iterable[tuple[str, str, str]]) -> str:
    """Return the key numbers, each with its label and remark."""
    return "\n".join(
        f'<div><dt>{escape(label)}</dt><dd>{escape(value)}</dd><dd class="remark">{escape(remark)}</dd></div>'
        for label, value, remark in numbers
    )


def table(content: Table) -> str:
    """Return a table whose first column names the rows and whose heads are explained on hover."""
    heads = "".join(
        f'<th scope="col" title="{escape(meaning)}">{escape(head)}</th>' for head, meaning in content.columns
    )
    marks = content.marks or [("", "")] * len(content.rows)
    rows = "\n".join(_row(row, *mark) for row, mark in zip(content.rows, marks, strict=True))
    foot = f"<tfoot>{_row(content.total)}</tfoot>" if content.total else ""
    return f"<table>\n<thead><tr>{heads}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n{foot}\n</table>"


def _row(cells: Sequence[str], mark: str = "", address: str = "") -> str:
    name = escape(cells[0])
    name = f'<a href="{escape(address)}">{name}</a>' if address else name
    kind = f' class="{escape(mark)}"' if mark else ""
    rest = "".join(f"<td>{escape(cell)}</td>" for cell in cells[1:])
    return f'<tr><th scope="row"{kind}>{name}</th>{rest}</tr>'


def meanings(content: Table) -> str:
    """Return what the columns mean, for print and for readers without a pointer."""
    explained = [f"<b>{escape(head)}</b> {escape(meaning)}" for head, meaning in content.columns if meaning]
    return "; ".join(explained) + "."


def problem_rows(rows: Sequence[Problem]) -> str:
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


def hollow_key(status: npt.NDArray[np.str_]) -> str:
    """Return what hollow joints are, for the key of the 3D view; nothing without any."""
    words = not_ok_in_words(status)
    return f'<span class="hollow">{escape(words)}</span>' if words else ""


def bullets(sentences: Sequence[str]) -> str:
    """Return sentences as a list; nothing without any."""
    items = "\n".join(f"<li>{_unbroken(escape(sentence))}</li>" for sentence in sentences)
    return f"<ul>\n{items}\n</ul>" if items else ""


def _unbroken(text: str) -> str:
    """Return HTML in which no line ends within an option and its placeholder, such as ``--fill-gaps N``."""
    return re.sub(r"(?<![\w-])--[a-z][a-z-]*\w(?: [A-Z]+\b)?", r'<span class="option">\g<0></span>', text)


def _frames(first: int, last: int) -> str:
    numbers = [first] if first == last else [first, last]
    return "–".join(f'<a href="#frame={number}">{number}</a>' for number in numbers)

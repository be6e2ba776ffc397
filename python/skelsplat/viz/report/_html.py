"""Pieces of the page as HTML; every text from outside is escaped here."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from skelsplat.viz._skeleton import not_ok_in_words

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import numpy as np
    import numpy.typing as npt

    from skelsplat.viz.report._data import KeyNumber, ProblemRow, Table

MOST_PROBLEMS = 500


def facts_line(facts: Iterable[tuple[str, str]]) -> str:
    """Return name and value pairs as a description list."""
    return "\n".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in facts)


def warnings(sentences: Sequence[str]) -> str:
    """Return warnings as a list, or that there are none."""
    if not sentences:
        return "<p>None. Frames with a problem are listed below.</p>"
    return f"<ul>\n{_items(sentences)}\n</ul>"


def notes(sentences: Sequence[str]) -> str:
    """Return sentences as a list."""
    return f"<ul>\n{_items(sentences)}\n</ul>" if sentences else ""


def tiles(numbers: Iterable[KeyNumber]) -> str:
    """Return the key numbers, each with its label and remark."""
    return "\n".join(
        f"<div><dt>{escape(number.label)}</dt><dd>{escape(number.value)}</dd>"
        f'<dd class="remark">{escape(number.remark)}</dd></div>'
        for number in numbers
    )


def table(content: Table) -> str:
    """Return a table whose first column names the rows and whose heads say on hover what they mean."""
    heads = "".join(
        f'<th scope="col" title="{escape(column.meaning)}">{escape(column.head)}</th>'
        for column in content.columns
    )
    rows = "\n".join(_row(row) for row in content.rows)
    foot = f"<tfoot>{_row(content.total)}</tfoot>" if content.total else ""
    return f"<table>\n<thead><tr>{heads}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n{foot}\n</table>"


def meanings(content: Table) -> str:
    """Return what the columns mean, for print and for readers without a pointer."""
    said = [
        f"<b>{escape(column.head)}</b> {escape(column.meaning)}"
        for column in content.columns
        if column.meaning
    ]
    return "; ".join(said) + "."


def problems(rows: Sequence[ProblemRow]) -> str:
    """Return the frames with a problem, linked to the 3D view, the first `MOST_PROBLEMS` rows of them."""
    if not rows:
        return "<p>None.</p>"
    shown = "\n".join(
        f'<tr><th scope="row">{_frames(row)}</th><td>{escape(row.words)}</td></tr>'
        for row in rows[:MOST_PROBLEMS]
    )
    more = len(rows) - MOST_PROBLEMS
    rest = f"<p>{more:,} more rows are omitted here; report.json lists all frames.</p>" if more > 0 else ""
    head = '<thead><tr><th scope="col">frames</th><th scope="col">problem</th></tr></thead>'
    return f"<table>\n{head}\n<tbody>\n{shown}\n</tbody>\n</table>\n{rest}"


def hollow_key(status: npt.NDArray[np.str_]) -> str:
    """Return what hollow joints are, for the key of the 3D view; nothing without any."""
    words = not_ok_in_words(status)
    return f'<span class="hollow">{escape(words)}</span>' if words else ""


def _items(sentences: Iterable[str]) -> str:
    return "\n".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)


def _row(cells: Sequence[str]) -> str:
    rest = "".join(f"<td>{escape(cell)}</td>" for cell in cells[1:])
    return f'<tr><th scope="row">{escape(cells[0])}</th>{rest}</tr>'


def _frames(row: ProblemRow) -> str:
    numbers = [row.first] if row.first == row.last else [row.first, row.last]
    return "–".join(f'<a href="#frame={number}">{number}</a>' for number in numbers)

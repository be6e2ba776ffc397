"""Parts of a page as HTML: facts, numbers, tables, lists of sentences, frames with a problem."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

Problem = tuple[int, int, str]
"""First frame, last frame, and the words of what they have in common."""
Sentence = tuple[str, Sequence[str]]
"""A sentence, and what is typed or written somewhere because of it: settings, a command."""

_MOST_PROBLEMS = 500


@dataclass(frozen=True)
class Table:
    """Cells as texts; the first of a row names it.

    Columns are (head, what its numbers are in words); ``total`` is a last row for all. ``marks`` are, of each
    row, the class of its name in the page's style and the address that it links to, or ``""``.
    """

    title: str
    columns: Sequence[tuple[str, str]]
    rows: Sequence[Sequence[str]]
    total: Sequence[str] = ()
    marks: Sequence[tuple[str, str]] = ()
    hint: str = ""


def section(name: str, title: str, body: str, hint: str = "", kind: str = "") -> str:
    """Return a section of the page with its title, which has the id ``name``."""
    hint = f'<p class="hint">{hint}</p>\n' if hint else ""
    kind = f' class="{kind}"' if kind else ""
    return (
        f'<section aria-labelledby="{name}"{kind}>\n<h2 id="{name}">{title}</h2>\n{hint}{body}\n</section>\n'
    )


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
    """Return a section with a table, whose first column names the rows, and the meanings of its columns."""
    heads = "".join(
        f'<th scope="col" title="{escape(meaning)}">{escape(head)}</th>' for head, meaning in content.columns
    )
    marks = content.marks or [("", "")] * len(content.rows)
    rows = "\n".join(_row(row, *mark) for row, mark in zip(content.rows, marks, strict=True))
    foot = f"<tfoot>{_row(content.total)}</tfoot>" if content.total else ""
    body = f"<table>\n<thead><tr>{heads}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n{foot}\n</table>"
    # for print and for readers without a pointer
    explained = [f"<b>{escape(head)}</b> {escape(meaning)}" for head, meaning in content.columns if meaning]
    meanings = f'\n<p class="meanings">{"; ".join(explained)}.</p>' if explained else ""
    name = "table-" + re.sub(r"\W+", "-", content.title.lower()).strip("-")
    return section(name, escape(content.title), f'<div class="wide">\n{body}\n</div>{meanings}', content.hint)


def _row(cells: Sequence[str], mark: str = "", address: str = "") -> str:
    name = escape(cells[0])
    name = f'<a href="{escape(address)}">{name}</a>' if address else name
    kind = f' class="{escape(mark)}"' if mark else ""
    rest = "".join(f"<td>{escape(cell)}</td>" for cell in cells[1:])
    return f'<tr><th scope="row"{kind}>{name}</th>{rest}</tr>'


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


def _frames(first: int, last: int) -> str:
    numbers = [first] if first == last else [first, last]
    return "–".join(f'<a href="#frame={number}">{number}</a>' for number in numbers)


def bullets(sentences: Sequence[Sentence | str]) -> str:
    """Return sentences as a list, what is typed because of them as code; nothing without any."""
    items = "\n".join(f"<li>{_sentence(one)}</li>" for one in sentences)
    return f"<ul>\n{items}\n</ul>" if items else ""


def _sentence(sentence: Sentence | str) -> str:
    text, typed = (sentence, ()) if isinstance(sentence, str) else sentence
    words, rest = escape(text), []
    for one in typed:
        code = f"<code>{escape(one)}</code>"
        if one in text:
            words = words.replace(escape(one), code)
        else:
            rest.append(code)
    return f"{words} {'Settings: ' if len(rest) > 1 else 'Setting: '}{', '.join(rest)}" if rest else words

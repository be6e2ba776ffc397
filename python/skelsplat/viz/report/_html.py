"""Parts of a page as HTML: elements with escaped words, tables, lists of sentences."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from html import escape

from skelsplat._words import Table

Problem = tuple[int, int, str]
"""First frame, last frame, and the words of what they have in common."""
Sentence = tuple[str, Sequence[str]]
"""A sentence, and what is typed or written somewhere because of it: settings, a command."""

_MOST_PROBLEMS = 500


def tag(name: str, inner: str, **attributes: str) -> str:
    """Return an element around HTML, with its attributes but for empty ones; ``class_`` is ``class``."""
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(value)}"'
        for key, value in attributes.items()
        if value
    )
    return f"<{name}{given}>{inner}</{name}>"


def section(name: str, title: str, body: str, hint: str = "", kind: str = "") -> str:
    """Return a section of the page with its title, which has the id ``name``."""
    below = f"\n{tag('p', hint, class_='hint')}" if hint else ""
    inner = f"\n{tag('h2', title, id=name)}{below}\n{body}\n"
    return tag("section", inner, aria_labelledby=name, class_=kind) + "\n"


def described(terms: Iterable[Sequence[str]]) -> str:
    """Return names, each with a value and a remark if there is one, for a list of them."""
    lines = []
    for name, value, *remark in terms:
        parts = [tag("dt", escape(name)), tag("dd", escape(value))]
        parts += [tag("dd", escape(one), class_="remark") for one in remark]
        lines.append(tag("div", "".join(parts)))
    return "\n".join(lines)


def table(content: Table) -> str:
    """Return a section with a table, whose first column names the rows, and the meanings of its columns."""
    heads = [tag("th", escape(head), scope="col", title=meaning) for head, meaning in content.columns]
    marks = content.marks or [("", "")] * len(content.rows)
    rows = [_row(row, *mark) for row, mark in zip(content.rows, marks, strict=True)]
    body = _table(heads, rows, tag("tfoot", _row(content.total)) if content.total else "")
    # for print and for readers without a pointer
    explained = [
        f"{tag('b', escape(head))} {escape(meaning)}" for head, meaning in content.columns if meaning
    ]
    meanings = "\n" + tag("p", "; ".join(explained) + ".", class_="meanings") if explained else ""
    name = "table-" + re.sub(r"\W+", "-", content.title.lower()).strip("-")
    return section(name, escape(content.title), tag("div", body, class_="wide") + meanings, content.hint)


def _table(heads: Sequence[str], rows: Sequence[str], foot: str = "") -> str:
    lines = (tag("thead", tag("tr", "".join(heads))), tag("tbody", "\n".join(rows)), foot)
    return tag("table", "\n".join(lines))


def _row(cells: Sequence[str], mark: str = "", address: str = "") -> str:
    name = tag("a", escape(cells[0]), href=address) if address else escape(cells[0])
    rest = "".join(tag("td", escape(cell)) for cell in cells[1:])
    return tag("tr", tag("th", name, scope="row", class_=mark) + rest)


def problem_rows(problems: Sequence[Problem]) -> str:
    """Return the frames with a problem, linked to the 3D view, the first `_MOST_PROBLEMS` rows of them."""
    if not problems:
        return tag("p", "None.")
    rows = [
        tag("tr", tag("th", _frames(first, last), scope="row") + tag("td", escape(words)))
        for first, last, words in problems[:_MOST_PROBLEMS]
    ]
    more = len(problems) - _MOST_PROBLEMS
    rest = f"{more:,} more rows are omitted here; report.json lists all frames."
    heads = [tag("th", head, scope="col") for head in ("frames", "problem")]
    return _table(heads, rows) + (tag("p", rest) if more > 0 else "")


def _frames(first: int, last: int) -> str:
    return "–".join(tag("a", str(number), href=f"#frame={number}") for number in sorted({first, last}))


def bullets(sentences: Sequence[Sentence | str]) -> str:
    """Return sentences as a list, what is typed because of them as code; nothing without any."""
    items = [tag("li", _sentence(*([one, ()] if isinstance(one, str) else one))) for one in sentences]
    return tag("ul", "\n".join(items)) if items else ""


def _sentence(text: str, typed: Sequence[str]) -> str:
    words = escape(text)
    for one in typed:
        words = words.replace(escape(one), tag("code", escape(one)))
    rest = ", ".join(tag("code", escape(one)) for one in typed if one not in text)
    return f"{words} {'Settings' if rest.count('<code>') > 1 else 'Setting'}: {rest}" if rest else words

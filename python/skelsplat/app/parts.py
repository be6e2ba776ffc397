"""Parts of pages: sentences, facts, tables, text to copy, and how far a command is."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from html import escape
from typing import Any
from urllib.parse import quote, urlencode

from nicegui import run, ui

from skelsplat._escape import escaped
from skelsplat.cli.process import CANCELLED, FAILED, RUNNING, Work
from skelsplat.cli.settings import worded
from skelsplat.exceptions import SkelSplatError
from skelsplat.run.found import Lack

_EVERY_S = 0.25


def address(page: str, **query: str) -> str:
    """Return the address of a page, or a file, about a folder."""
    return f"{quote(page)}?{urlencode(query)}"


def html(text: str) -> ui.html:
    """Show HTML of our own, in which all else is escaped."""
    return ui.html(text, sanitize=False)


def shown(text: object) -> str:
    """Return a text from elsewhere as HTML."""
    return escape(escaped(str(text)))


def section(name: str) -> ui.element:
    """Return a part of a page, to be entered."""
    made = ui.element("section").classes("s-card").props(f'aria-label="{name}"')
    with made:
        html(f"<h2>{name}</h2>")
    return made


def head(text: str) -> None:
    """Show the head of a smaller part."""
    html(f"<h3>{shown(text)}</h3>")


def note(kind: str, text: str) -> ui.element:
    """Show a sentence behind a line in the colour of its kind: error, warning, lack, note; return its box."""
    word = {"error": "<b>Error.</b> ", "warning": "<b>Warning.</b> "}.get(kind, "")
    role = "alert" if kind == "error" else "note"
    with ui.element("div").classes(f"s-note s-{kind}").props(f"role={role}") as box:
        html(f"<p>{word}{shown(worded(text))}</p>")
    return box


def facts(named: Mapping[str, str]) -> None:
    """Show values, each above its name."""
    cells = (
        f"<div class='s-fact'><b>{shown(text)}</b><span>{shown(name)}</span></div>"
        for name, text in named.items()
    )
    html("".join(cells)).classes("s-facts")


def table(heads: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Show a table; None is a dash, a text with an address a link."""

    def shown_in(cell: object) -> str:
        if isinstance(cell, tuple):
            return f"<a href='{escape(cell[1])}'>{shown(cell[0])}</a>"
        return "–" if cell is None else shown(cell)

    def row(cells: Sequence[object], kind: str) -> str:
        return f"<tr>{''.join(f'<{kind}>{shown_in(cell)}</{kind}>' for cell in cells)}</tr>"

    body = "".join(row(cells, "td") for cells in rows)
    html(f"<table class='s-table'>{row(heads, 'th')}{body}</table>").classes("s-wide")


def button(text: str, action: Callable[..., Any], *, first: bool = False, enabled: bool = True) -> ui.button:
    """Show a button; the ``first`` is that which most people press next."""
    made = ui.button(text, on_click=action).props("no-caps color=primary")
    made.set_enabled(enabled)
    return made.props("unelevated" if first else "outline")


def code(text: str, name: str) -> None:
    """Show text to be copied."""

    def copy() -> None:
        ui.clipboard.write(text)
        ui.notify(f"Copied {name}.", position="bottom")

    with ui.element("div").classes("s-code"):
        html(f"<pre>{escape(text)}</pre>")
        made = ui.button(icon="content_copy", on_click=copy)
        made.props(f'flat dense round size=sm aria-label="Copy {name}"')


def choices(lack: Lack, choose: Callable[[str, str], Any]) -> None:
    """Show a button for each value that helps against a lack; the one that was given stays among them."""
    for value, text in lack.values.items():
        made = button(text, partial(choose, lack.setting, value), first=value == lack.value)
        made.props(f"aria-pressed={str(value == lack.value).lower()}")


async def attempt(action: Callable[..., object], *given: object) -> str:
    """Do what a button is for, and return what was wrong, if anything was."""
    try:
        await run.io_bound(action, *given)
    except (SkelSplatError, OSError) as error:
        return str(error)
    return ""


def progress(work: Work, ended: Callable[[], object]) -> None:
    """Show a bar with the time left and a button that cancels, and call ``ended`` once; or how it ended."""
    if work.state in (FAILED, CANCELLED):
        note("error" if work.state == FAILED else "note", work.words_of_end)
    if work.state != RUNNING:
        return
    with ui.element("div").classes("s-bar"):
        label = ui.label(work.words_of_bar).props("role=status")
        bar = ui.linear_progress(value=0.0, show_value=False, size="8px")
        bar.props('rounded indeterminate aria-label="Progress"')
        button("Cancel", work.cancel).classes("self-start")

    def tick() -> None:
        if work.state != RUNNING:
            timer.deactivate()
            ended()
            return
        label.set_text(work.words_of_bar)
        if work.bar.share is not None:
            bar.props(remove="indeterminate").set_value(round(work.bar.share, 3))

    timer = ui.timer(_EVERY_S, tick)

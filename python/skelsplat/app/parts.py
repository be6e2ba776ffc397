"""Small parts of pages: sentences, tables, facts, text to copy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from urllib.parse import urlencode

from nicegui import ui

from skelsplat._escape import escaped


def address(page: str, at: str, **more: str) -> str:
    """Return the address of a page about a folder."""
    query = urlencode({key: value for key, value in {"at": at, **more}.items() if value})
    return f"{page}?{query}" if query else page


def html(text: str) -> ui.html:
    """Show HTML of our own, in which all else is escaped."""
    return ui.html(text, sanitize=False)


def part(head: str, level: int = 2) -> None:
    """Show the head of a part."""
    html(f"<h{level}>{escape(head)}</h{level}>")


def note(kind: str, text: str) -> ui.element:
    """Show a sentence after a line in the colour of its kind: error, warning, lack or note; return its box."""
    word = {"error": "<b>Error.</b> ", "warning": "<b>Warning.</b> "}.get(kind, "")
    role = "alert" if kind == "error" else "note"
    with ui.element("div").classes(f"s-note s-{kind}").props(f"role={role}") as box:
        html(f"<p>{word}{escape(escaped(text))}</p>")
    return box


def facts(named: Mapping[str, str]) -> None:
    """Show values, each above its name."""
    cells = (
        f"<div class='s-fact'><b>{escape(escaped(value))}</b><span>{escape(escaped(name))}</span></div>"
        for name, value in named.items()
    )
    html("".join(cells)).classes("s-facts")


def table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Show a table of texts."""
    head = "".join(f"<th scope=col>{escape(text)}</th>" for text in heads)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(escaped(text))}</td>' for text in row)}</tr>" for row in rows
    )
    html(f"<table class='s-table'><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>")


def button(text: str, action: object, *, first: bool = False, icon: str = "") -> ui.button:
    """Show a button; the ``first`` is that which most people press next."""
    made = ui.button(text, on_click=action, icon=icon or None)  # type: ignore[arg-type]
    return made.props("no-caps unelevated color=primary" if first else "no-caps outline color=primary")


def code(text: str, name: str) -> None:
    """Show text that is copied, as commands are."""
    with ui.element("div").classes("s-code"):
        html(f"<pre>{escape(escaped(text)) if chr(10) not in text else escape(text)}</pre>")
        copy = ui.button(icon="content_copy", on_click=lambda: _copy(text, name))
        copy.props(f'flat dense round size=sm aria-label="Copy {name}"')


def _copy(text: str, name: str) -> None:
    ui.clipboard.write(text)
    ui.notify(f"Copied {name}.", position="bottom")

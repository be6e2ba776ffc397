"""What commands print: results and JSON on stdout; findings, messages and progress bars on stderr."""

from __future__ import annotations

import contextlib
import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextvars import ContextVar
from functools import partial
from typing import Any

import typer
from rich.cells import cell_len
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TaskID,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from skelsplat._escape import escaped
from skelsplat._json import to_text
from skelsplat.findings import Finding, Remedy

# What is pasted into a shell, and so not broken over lines: an option and its value, a command.
_OPTION = r"--[a-z][a-z-]* \S+"
_PASTED = rf"pip install \S+|(?:skelsplat [a-z-]+(?: [A-Z]{{3,}})*|{_OPTION})(?: {_OPTION})*"
_drawn_on: list[Console] = []  # those with a bar, the innermost last
options: ContextVar[frozenset[str]] = ContextVar("options", default=frozenset())
"""The options of the command that runs."""
# Where options are that help against what other commands find.
_ELSEWHERE = {"adjust_cameras": "refine", "move": "adjust-cameras"}
_quiet: ContextVar[bool] = ContextVar("quiet", default=False)
Bar = Callable[[str, int | None, int | None], None]
"""Is called with a name, what is done and the total."""
_heard_by: ContextVar[Bar | None] = ContextVar("heard_by", default=None)


@contextlib.contextmanager
def during(variable: ContextVar[Any], value: Any) -> Iterator[None]:
    """Let a variable have a value while this is open."""
    before = variable.set(value)
    try:
        yield
    finally:
        variable.reset(before)


heard = partial(during, _heard_by)
"""Call a function with all that bars show while this is open."""
quieter = partial(during, _quiet)
"""Draw no bar and print no note while this is open, if given True."""


class Terminal(Console):
    """A console that shows names as they are: nothing in them is markup, and control characters are escaped.

    This holds for strings; line breaks of our own are in a `rich.text.Text`, whose other parts are `escaped`.
    """

    def __init__(self, *, stderr: bool = False) -> None:
        super().__init__(stderr=stderr, highlight=False, markup=False, emoji=False)

    def render_str(self, text: str, **given: Any) -> Text:
        """Return a string as text, in one line."""
        return super().render_str(escaped(text), **given)


def say(*lines: str, err: bool = False) -> None:
    """Print lines on stdout, however long, with control characters escaped."""
    typer.echo("\n".join(map(escaped, lines)), err=err)


def print_json(document: Any) -> None:
    """Print a document on stdout; a number that does not exist is null."""
    typer.echo(to_text(document), nl=False)


def print_message(text: str, whole: Sequence[str] = ()) -> None:
    """Print on stderr, above a bar: on a terminal as `print_text` does, else one line, to be searched for."""
    console = _drawn_on[-1] if _drawn_on else Terminal(stderr=True)
    if console.is_terminal:
        print_text(console, text, whole)
    else:
        typer.echo(escaped(text), err=True)


def print_text(console: Console, text: str, whole: Sequence[str] = ()) -> None:
    """Print text wrapped between words, not within the parts `whole`, paths, options and commands."""
    lines = [""]
    parts = "|".join([*map(re.escape, whole), _PASTED])
    for word in re.findall(rf"\(?(?:{parts})\S*|\S+", escaped(text)):
        line = f"{lines[-1]} {word}".lstrip()
        lines[-1:] = [line] if cell_len(line) <= console.width else [lines[-1], word]
    console.print(Text("\n".join(filter(None, lines))), soft_wrap=True)


def tell(finding: Finding, of: str = "") -> None:
    """Print a finding on stderr after its severity, and ``of``, whom it is of; no note if `quieter`."""
    if not (_quiet.get() and finding.severity == "note"):
        advice = _advice(_lacking(finding))
        print_message(f"{finding.severity}: {of}{finding.text}{advice}", _pasted(finding))


def print_findings(findings: Iterable[Finding], console: Console, of: str = "") -> None:
    """Print findings on stdout, after ``!`` unless they are notes, and ``of``."""
    for finding in findings:
        mark = "" if finding.severity == "note" else "! "
        print_text(console, f"{mark}{of}{finding.text}{_advice(_lacking(finding))}", _pasted(finding))


def tell_all(findings: Iterable[Finding], _console: Console | None = None, of: str = "") -> None:
    """Print findings on stderr as `tell` does."""
    for finding in findings:
        tell(finding, of)


def option_words(remedy: Remedy) -> str:
    """Return a remedy as it is pasted into a shell: ``--without cam_03``."""
    flag = "--" + remedy.setting.replace("_", "-")
    return " ".join(f"{flag} {shlex.quote(text)}" for text in remedy.texts) or flag


def _remedy_words(remedy: Remedy) -> str:
    """Return `option_words`, after the command whose option it is if the one that runs does not have it."""
    words, running = option_words(remedy), options.get()
    other = _ELSEWHERE.get(remedy.setting)
    there = other is None or not running or words.partition(" ")[0] in running
    return words if there else f"skelsplat {other} {words}"


def _lacking(finding: Finding) -> list[str]:
    """Return the remedies in words, unless the sentence has them."""
    options = [_remedy_words(remedy) for remedy in finding.remedy]
    return [] if all(option in finding.text for option in options) else options


def _advice(options: Sequence[str]) -> str:
    return f" Try {', '.join(options)}." if options else ""


def _pasted(finding: Finding) -> list[str]:
    """Return the options that are pasted from a finding's words."""
    return [*map(_remedy_words, finding.remedy)]


@contextlib.contextmanager
def progress(unit: str, *, first: str | None = None, time: ProgressColumn | None = None) -> Iterator[Bar]:
    """Yield a function of (name, done, total) that draws a bar of a unit for each name.

    With ``first``, the first name, there is one bar, with the last name before it; None leaves a number as it
    is. Nothing is drawn where stderr is no terminal.
    """
    console = Terminal(stderr=True)
    tasks: dict[str, TaskID] = {}
    listener = _heard_by.get()
    with Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeRemainingColumn() if time is None else time,
        console=console,
        transient=True,
        disable=_quiet.get() or not console.is_terminal,
    ) as bar:

        def update(name: str, done: int | None, total: int | None) -> None:
            key = name if first is None else first
            if key not in tasks:
                tasks[key] = bar.add_task(escaped(name), total=total)
            bar.update(tasks[key], description=escaped(name), completed=done, total=total)
            if listener is not None:
                listener(name, done, total)

        if first is not None:
            update(first, None, None)
        _drawn_on.append(console)
        try:
            yield update
        finally:
            _drawn_on.remove(console)

"""JSON on stdout, warnings and progress bars on stderr."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator, Sequence
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

# What is pasted into a shell, and so not broken over lines: an option and its value, a command.
_OPTION = r"--[a-z][a-z-]* \S+"
_PASTED = rf"pip install \S+|(?:skelsplat [a-z-]+(?: [A-Z]{{3,}})*|{_OPTION})(?: {_OPTION})*"
_drawn_on: list[Console] = []  # those with a bar, the innermost last


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


@contextlib.contextmanager
def bar_of(unit: str, *, shown: bool, time: ProgressColumn | None = None) -> Iterator[Progress]:
    """Yield a bar that counts `unit`, with a description; nothing is drawn where stderr is no terminal."""
    console = Terminal(stderr=True)
    with Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeRemainingColumn() if time is None else time,
        console=console,
        transient=True,
        disable=not (shown and console.is_terminal),
    ) as bar:
        _drawn_on.append(console)
        try:
            yield bar
        finally:
            _drawn_on.remove(console)


@contextlib.contextmanager
def described(
    first: str, *, shown: bool, unit: str = "poses", time: ProgressColumn | None = None
) -> Iterator[Callable[[str, int | None, int | None], None]]:
    """Yield a function of (text, done, total) that draws one bar of a unit, with that text before it.

    Numbers that are None stay as they are.
    """
    with bar_of(unit, shown=shown, time=time) as bar:
        task = bar.add_task(first, total=None)
        yield lambda text, done, total: bar.update(
            task, description=escaped(text), completed=done, total=total
        )


@contextlib.contextmanager
def counting(unit: str, *, shown: bool) -> Iterator[Callable[[str, int, int], None]]:
    """Yield a function of (name, done, total) that draws a bar for each name."""
    with bar_of(unit, shown=shown) as bar:
        tasks: dict[str, TaskID] = {}

        def update(name: str, done: int, total: int) -> None:
            if name not in tasks:
                tasks[name] = bar.add_task(escaped(name), total=total)
            bar.update(tasks[name], completed=done, total=total)

        yield update

"""The progress bar of long work, on stderr."""

from __future__ import annotations

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)


def bar_of(unit: str, *, shown: bool, time: ProgressColumn | None = None) -> Progress:
    """Return a bar that counts `unit`, with a description; nothing is drawn where stderr is no terminal."""
    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeRemainingColumn() if time is None else time,
        console=console,
        transient=True,
        disable=not (shown and console.is_terminal),
    )

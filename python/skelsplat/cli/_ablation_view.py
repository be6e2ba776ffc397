"""How an ablation is shown: progress, tables in the terminal, and the chart."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich import box
from rich.console import Console
from rich.progress import TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from skelsplat._optional import can_draw
from skelsplat.cli.output import bar_of
from skelsplat.cli.table import tell
from skelsplat.evaluation import ablations
from skelsplat.findings import Finding

if TYPE_CHECKING:
    from skelsplat.evaluation.ablations import Record, Row

# Beyond so many settings they become rows, for 80 columns; names of methods keep at least so much room.
_MOST_COLUMNS, _LEAST_NAME = 6, 26
_STYLES = {"measured": "bold", "paper": "dim", "theory": "dim"}


@contextmanager
def progress_bar(*, shown: bool) -> Iterator[ablations.Progress]:
    """Yield what an ablation reports to: a bar on stderr, if that is a terminal."""
    with bar_of("poses", shown=shown, time=TimeElapsedColumn()) as bar:
        task = bar.add_task("reading", total=None)
        yield lambda text, done, total: bar.update(task, description=text, completed=done, total=total)


def print_record(console: Console, record: Record) -> None:
    """Print tables, each with its source under it, claims and notes."""
    for table in record.outcome.tables:
        console.print(_upright(table) if len(table.columns) <= _MOST_COLUMNS else _turned(table))
        console.print(record.line, style="yellow" if record.simulated else "")
        console.print()
    print_claims(console, record)
    for note in (*record.notes, *record.sources):
        console.print(f"· {note}", style="dim")


def _upright(table: ablations.Table) -> Table:
    """Return a table whose rows are methods."""
    shown = Table(title=f"{table.title} ({table.unit})", box=box.SIMPLE_HEAD, title_justify="left")
    longest = max(len(_name(row)) for row in table.rows)
    shown.add_column(table.corner, overflow="fold", min_width=min(longest, _LEAST_NAME))
    for column in table.columns:
        shown.add_column(column, justify="right", overflow="fold")
    for row in table.rows:
        figures = (ablations.cell(value, table.digits) for value in row.values)
        shown.add_row(_name(row), *figures, style=_STYLES[row.origin])
    return shown


def _turned(table: ablations.Table) -> Table:
    """Return a table whose columns are methods: there are too many settings for the width."""
    shown = Table(title=f"{table.title} ({table.unit})", box=box.SIMPLE_HEAD, title_justify="left")
    shown.add_column(table.corner)
    for row in table.rows:
        shown.add_column(_name(row), justify="right", overflow="fold", style=_STYLES[row.origin])
    for k, column in enumerate(table.columns):
        shown.add_row(column, *(ablations.cell(row.values[k], table.digits) for row in table.rows))
    return shown


def _name(row: Row) -> str:
    return ", ".join(part for part in (row.method, row.data) if part)


def print_claims(console: Console, record: Record) -> None:
    """Print what became of the paper's claims."""
    shown = Table(title="Claims of the paper", box=box.SIMPLE_HEAD, title_justify="left")
    for column in ("claim", "reported", "here", ""):
        shown.add_column(column, overflow="fold")
    for claim in record.outcome.claims:
        outcome = Text(claim.verdict, "green" if claim.reproduced else "red")
        shown.add_row(claim.claim, claim.paper, claim.measured, outcome)
    console.print(shown)


def draw(folder: Path, record: Record) -> list[Path]:
    """Write the chart ``NAME.png``; without the extra ``viz`` say what it needs."""
    if not can_draw():
        tell(Finding("no_pictures"))
        return []
    from skelsplat import viz  # matplotlib takes long to load, and --help does without

    panels = [
        viz.Panel(
            table.title,
            table.corner,
            table.unit,
            table.columns,
            [
                viz.Line(
                    _name(row),
                    [float("nan") if value is None else value for value in row.values],
                    row.origin != "measured",
                )
                for row in table.rows
            ],
        )
        for table in record.outcome.tables
        if table.chart
    ]
    return [viz.write_panels(folder / f"{record.ablation.name}.png", panels, caption=record.line)]

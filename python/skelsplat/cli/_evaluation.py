"""What ``skelsplat evaluate`` prints and writes, and its progress bar."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table as Drawn
from rich.text import Text

from skelsplat._optional import can_draw
from skelsplat.cli.output import bar_of
from skelsplat.cli.table import tell
from skelsplat.evaluation import export, tables
from skelsplat.evaluation._table import Row, Table
from skelsplat.evaluation.report import Evaluation
from skelsplat.findings import Finding
from skelsplat.io._atomic import atomic_write_text

if TYPE_CHECKING:
    from skelsplat.viz import BarData

WIDTH = 100
_NAME_WIDTH = 32


def print_evaluation(console: Console, evaluation: Evaluation, *, per_joint: bool) -> None:
    """Print the table of methods, that of actions if there are several, and what they mean."""
    overall = tables.overall(evaluation)
    shown = [overall]
    if len(evaluation.headers) > 1:
        shown.append(tables.actions(evaluation))
        if evaluation.protocol.parts:
            shown.append(tables.actions(evaluation, "pcp"))
    if per_joint:
        shown.append(tables.joints(evaluation))
    for table in shown:
        for part, gap in _fitting(table):
            console.print(_drawn(part, gap))
    for note in overall.notes:
        console.print(note, style="dim")


def _fitting(table: Table) -> list[tuple[Table, int]]:
    """Cut a table that is too wide into parts of about equally many columns; with the gap between columns."""
    name = min(_NAME_WIDTH, max(len(row.name) for row in table.rows))
    widths = [
        max(_longest_word(column.header), *(len(table.text(row, k)) for row in table.rows))
        for k, column in enumerate(table.columns)
    ]
    for parts in range(1, len(widths) + 1):
        count = -(-len(widths) // parts)
        groups = [widths[k : k + count] for k in range(0, len(widths), count)]
        for gap in (2, 1):
            if count == 1 or all(name + sum(g) + gap * len(g) <= WIDTH - 2 for g in groups):
                return [(part, gap) for part in table.split(count)]
    return [(table, 1)]


def _longest_word(header: str) -> int:
    return max(len(word) for word in header.replace("-", "- ").replace("/", "/ ").split())


def _drawn(table: Table, gap: int) -> Drawn:
    drawn = Drawn(
        title=Text(table.title) if table.title else None,
        title_justify="left",
        box=box.SIMPLE_HEAD,
        padding=(0, gap, 0, 0),
        pad_edge=False,
    )
    drawn.add_column(table.first, max_width=_NAME_WIDTH)
    for column in table.columns:
        drawn.add_column(_breakable(column.header), justify="right")
    measured = [row for row in table.rows if not row.reported]
    reported = [row for row in table.rows if row.reported]
    for row in measured:
        drawn.add_row(*_cells(table, row), end_section=bool(reported) and row is measured[-1])
    if reported:
        drawn.add_row(Text("reported:", style="dim"))
    for row in reported:
        drawn.add_row(*_cells(table, row), style="italic")
    return drawn


def _breakable(header: str) -> str:
    return (
        header.replace("-", "-\n").replace("/", "/\n").replace("PCK ", "PCK\n").replace("95 % CI", "95 %\nCI")
    )


def _cells(table: Table, row: Row) -> list[Text]:
    return [
        Text(row.name),
        *(
            Text(table.text(row, k), style="bold" if table.is_best(row, k) else "")
            for k in range(len(table.columns))
        ),
    ]


def write_evaluation(folder: Path, evaluation: Evaluation) -> list[str]:
    """Write ``report.md``, ``.csv``, ``.json`` and ``bars.png``; return their names."""
    names = ["report.md", "report.csv", "report.json"]
    for name, text in (
        ("report.md", export.markdown(evaluation)),
        ("report.csv", export.to_csv(evaluation)),
        ("report.json", export.to_json(evaluation)),
    ):
        atomic_write_text(folder / name, text)
    if not can_draw():
        tell(Finding("no_pictures"))
        return names
    from skelsplat import viz  # matplotlib takes long to load, and --help does without

    viz.write_bars(folder / "bars.png", _bars(evaluation))
    return [*names, "bars.png"]


def _bars(evaluation: Evaluation) -> BarData:
    from skelsplat import viz  # as in write_evaluation

    overall = tables.overall(evaluation)
    rows = [row for row in overall.rows if row.cells[0] is not None]
    intervals = {s.method: (s.absolute.low, s.absolute.high) for s in evaluation.scores}
    ends = [(np.nan, np.nan) if row.reported else intervals[row.name] for row in rows]
    real = " on the real data set" if evaluation.simulated else ""
    others = f" Grey: reported{real}, not measured here." if evaluation.published else ""
    return viz.BarData(
        names=tuple(row.name for row in rows),
        values=np.array([row.cells[0] for row in rows], dtype=np.float64),
        low=np.array([low for low, _ in ends]),
        high=np.array([high for _, high in ends]),
        measured=np.array([not row.reported for row in rows]),
        title=overall.title.partition(":")[0],
        axis="absolute MPJPE, mm, with 95 % interval over takes",
        caption=f"{evaluation.dataset.source or evaluation.dataset.name}.{others}",
    )


@contextmanager
def progress(*, shown: bool) -> Iterator[Callable[[str, str, int, int], None]]:
    """Yield what `evaluate` reports to: a bar of poses on stderr, if that is a terminal."""
    with bar_of("poses", shown=shown) as bar:
        task = bar.add_task("evaluating", total=None)

        def report(method: str, take: str, done: int, total: int) -> None:
            bar.update(task, completed=done, total=total, description=f"{method}, {take}")

        yield report

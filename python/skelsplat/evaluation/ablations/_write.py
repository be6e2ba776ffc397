"""Running an ablation, and its Markdown, CSV, JSON and chart."""

from __future__ import annotations

import csv
import io
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from skelsplat._atomic import atomic_write_text
from skelsplat._json import to_text
from skelsplat._optional import can_draw
from skelsplat._skelsplat import __version__
from skelsplat.evaluation.ablations._source import Choices, Source
from skelsplat.evaluation.ablations._sweep import Ablation, Outcome, Row
from skelsplat.evaluation.ablations._table import get
from skelsplat.evaluation.reported import reported
from skelsplat.evaluation.tables import grid

_CSV = ("table", "unit", "method", "data", "origin", "column", "value")


@dataclass(frozen=True, slots=True)
class Record:
    """All that is written about one run."""

    ablation: Ablation
    outcome: Outcome
    choices: Choices
    simulated: bool
    line: str  # what the data are; stands under every table
    command: str  # what makes it again

    @property
    def sources(self) -> tuple[str, ...]:
        """What the paper's rows are, and where they are from."""
        tables = map(reported, self.ablation.labels)
        return tuple(f"Reported: {table.title}; {table.source}" for table in tables)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of the ablation, and of the published tables."""
        published = (note for label in self.ablation.labels for note in reported(label).notes)
        return (*self.outcome.notes, *(f"Paper: {note}" for note in published))


def run(name: str, source: Source, *, command: str = "") -> Record:
    """Run the ablation of that name; `command` is what the files say it is repeated with.

    Raises `InvalidInputError` if there is no such ablation, or the source lacks the poses that it needs.
    """
    ablation = get(name)
    outcome = ablation.run(source)
    outcome = replace(outcome, notes=(*outcome.notes, *(f"{note}." for note in source.notes)))
    return Record(ablation, outcome, source.choices, source.simulated, source.line(), command)


def cell(value: float | None, digits: int) -> str:
    """Return a figure as it is shown."""
    return "–" if value is None else f"{value:.{digits}f}"


def to_markdown(record: Record) -> str:
    """Return the tables, each with its source, and the claims."""
    parts = [f"# {record.ablation.title}", f"`{record.command}` (skelsplat {__version__})"]
    for table in record.outcome.tables:
        rows = [(r.method, r.data, *(cell(value, table.digits) for value in r.values)) for r in table.rows]
        figures = grid((table.corner, "data", *table.columns), rows, numeric=len(table.columns))
        parts += [f"## {table.title} ({table.unit})", figures, record.line]
    claims = [(c.claim, c.paper, c.measured, f"**{c.verdict}**") for c in record.outcome.claims]
    parts += ["## Claims", grid(("claim", "reported", "here", ""), claims, numeric=0)]
    parts += ["\n".join(f"- {text}" for text in (*record.notes, *record.sources))]
    return "\n\n".join(parts) + "\n"


def to_csv(record: Record) -> str:
    """Return every figure on a line of its own, with all its digits."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(_CSV)
    for table in record.outcome.tables:
        for row in table.rows:
            for column, value in zip(table.columns, row.values, strict=True):
                figure = "" if value is None else repr(value)
                writer.writerow((table.title, table.unit, row.method, row.data, row.origin, column, figure))
    return stream.getvalue()


def as_dict(record: Record) -> dict[str, Any]:
    """Return everything as values of JSON."""
    return {
        "ablation": record.ablation.name,
        "title": record.ablation.title,
        "version": __version__,
        "command": record.command,
        "simulated": record.simulated,
        "data": record.line,
        "choices": asdict(record.choices),
        "tables": [asdict(table) for table in record.outcome.tables],
        "claims": [asdict(claim) for claim in record.outcome.claims],
        "notes": record.notes,
        "sources": record.sources,
    }


def write(folder: Path, record: Record) -> list[Path]:
    """Write ``NAME.md``, ``.csv``, ``.json`` and ``.png`` into a folder, which is made; return their paths.

    The chart needs the extra ``viz`` and is left out without it. Raises `DatasetError` if a file cannot be
    written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    out = []
    for suffix, text in (
        ("md", to_markdown),
        ("csv", to_csv),
        ("json", lambda record: to_text(as_dict(record))),
    ):
        out.append(folder / f"{record.ablation.name}.{suffix}")
        atomic_write_text(out[-1], text(record))
    return [*out, _write_chart(folder / f"{record.ablation.name}.png", record)] if can_draw() else out


def _write_chart(path: Path, record: Record) -> Path:
    from skelsplat import viz  # matplotlib takes long to load, and text does without

    def line(row: Row) -> viz.Line:
        values = [float("nan") if value is None else value for value in row.values]
        return viz.Line(row.name, values, row.origin != "measured")

    panels = [
        viz.Panel(table.title, table.corner, table.unit, table.columns, list(map(line, table.rows)))
        for table in record.outcome.tables
        if table.chart
    ]
    return viz.write_panels(path, panels, caption=record.line)

"""An ablation as Markdown, CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from skelsplat._skelsplat import __version__
from skelsplat.evaluation.ablations._model import Ablation, Outcome, Table
from skelsplat.evaluation.ablations._source import Choices
from skelsplat.evaluation.reported import reported
from skelsplat.io._atomic import atomic_write_text

_CSV = ("table", "unit", "method", "data", "origin", "column", "value")


@dataclass(frozen=True, slots=True)
class Record:
    """All that is written about one run.

    Attributes
    ----------
    ablation : Ablation
    outcome : Outcome
    choices : Choices
    simulated : bool
    line : str
        What the data are; stands under every table.
    command : str
        What makes it again.
    """

    ablation: Ablation
    outcome: Outcome
    choices: Choices
    simulated: bool
    line: str
    command: str

    @property
    def sources(self) -> tuple[str, ...]:
        """Where the paper's rows are from."""
        return tuple(f"{label}: {reported(label).source}" for label in self.ablation.labels)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of the ablation, and of the published tables."""
        published = (note for label in self.ablation.labels for note in reported(label).notes)
        return (*self.outcome.notes, *(f"Paper: {note}" for note in published))


def cell(value: float | None, digits: int) -> str:
    """Return a figure as it is shown."""
    return "–" if value is None else f"{value:.{digits}f}"


def to_markdown(record: Record) -> str:
    """Return the tables, each with its source, and the findings."""
    parts = [f"# {record.ablation.title}", f"`{record.command}` (skelsplat {__version__})"]
    for table in record.outcome.tables:
        parts += [f"## {table.title} ({table.unit})", _grid(table), record.line]
    findings = [(f.claim, f.paper, f.measured, f"**{f.verdict}**") for f in record.outcome.findings]
    parts += ["## Findings", _lines(("finding", "paper", "here", ""), findings, numeric=0)]
    parts += ["\n".join(f"- {text}" for text in (*record.notes, *record.sources))]
    return "\n\n".join(parts) + "\n"


def _grid(table: Table) -> str:
    rows = [(r.method, r.data, *(cell(value, table.digits) for value in r.values)) for r in table.rows]
    return _lines((table.corner, "data", *table.columns), rows, numeric=len(table.columns))


def _lines(header: Sequence[str], rows: Sequence[Sequence[str]], *, numeric: int) -> str:
    rule = [*["---"] * (len(header) - numeric), *["---:"] * numeric]
    return "\n".join("| " + " | ".join(row) + " |" for row in (header, rule, *rows))


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


def to_json(record: Record) -> str:
    """Return everything as a JSON object."""
    return json.dumps(as_dict(record), indent=2, ensure_ascii=False) + "\n"


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
        "findings": [asdict(finding) for finding in record.outcome.findings],
        "notes": record.notes,
        "sources": record.sources,
    }


def write(folder: Path, record: Record) -> list[Path]:
    """Write ``NAME.md``, ``NAME.csv`` and ``NAME.json`` into a folder, which is made; return their paths.

    Raises
    ------
    DatasetError
        If a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    out = []
    for suffix, text in (("md", to_markdown), ("csv", to_csv), ("json", to_json)):
        out.append(folder / f"{record.ablation.name}.{suffix}")
        atomic_write_text(out[-1], text(record))
    return out

"""Running an ablation, and what is printed and written of it."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

from skelsplat._skelsplat import __version__
from skelsplat.evaluation.ablations._source import Choices, Source
from skelsplat.evaluation.ablations._sweep import Ablation, Outcome
from skelsplat.evaluation.ablations._table import get
from skelsplat.evaluation.report import Report
from skelsplat.evaluation.reported import reported
from skelsplat.evaluation.tables import Row, Table, grid

_CSV = ("table", "unit", "method", "data", "origin", "column", "value")


@dataclass(frozen=True, slots=True)
class Record:
    """Everything about one run."""

    ablation: Ablation
    outcome: Outcome
    choices: Choices
    simulated: bool
    line: str  # what the data are; stands under every table
    command: str  # what makes it again

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes of the ablation and of the published tables, and where these are from."""
        tables = [reported(label) for label in self.ablation.labels]
        published = (f"Paper: {note}" for table in tables for note in table.notes)
        sources = (f"Reported: {table.title}; {table.source}" for table in tables)
        return (*self.outcome.notes, *published, *sources)

    def report(self) -> Report:
        """Return the tables, each with what the data are under it, and the claims."""
        tables = tuple(replace(table, notes=(self.line,)) for table in self.outcome.tables)
        claims = [(c.claim, c.paper, c.measured, f"**{c.verdict}**") for c in self.outcome.claims]
        text = grid(("claim", "reported", "here", ""), claims, numeric=0)
        notes = "\n".join(
            f"- {text}" for text in (f"`{self.command}` (skelsplat {__version__})", *self.notes)
        )
        return Report(
            title=self.ablation.title,
            tables=tables,
            shown=len(tables),
            fields=_CSV,
            rows=tuple(
                dict(zip(_CSV, (t.title, t.unit, r.name, r.data, r.origin, c.header, value), strict=True))
                for t in tables
                for r in t.rows
                for c, cell in zip(t.columns, r.cells, strict=True)
                for value in [None if cell is None else repr(cell)]  # with all its digits
            ),
            values={
                "ablation": self.ablation.name,
                "title": self.ablation.title,
                "version": __version__,
                "command": self.command,
                "simulated": self.simulated,
                "data": self.line,
                "choices": asdict(self.choices),
                "tables": [asdict(table) for table in self.outcome.tables],
                "claims": [{**asdict(claim), "verdict": claim.verdict} for claim in self.outcome.claims],
                "notes": self.notes,
            },
            text=f"\n### Claims\n\n{text}\n\n{notes}\n",
            draw=partial(_draw, self),
        )


def run(name: str, source: Source, *, command: str = "") -> Record:
    """Run the ablation of that name; `command` is what the files say it is repeated with.

    Raises `InvalidInputError` if there is no such ablation, or the source lacks the poses that it needs.
    """
    ablation = get(name)
    outcome = ablation.run(source)
    outcome = replace(outcome, notes=(*outcome.notes, *(f"{note}." for note in source.notes)))
    return Record(ablation, outcome, source.choices, source.simulated, source.line(), command)


def _draw(record: Record, path: Path) -> Path:
    from skelsplat import viz  # matplotlib takes long to load, and text does without

    def line(row: Row) -> viz.Line:
        values = [float("nan") if cell is None else float(cell) for cell in row.cells]
        return viz.Line(row.label, values, row.origin != "measured")

    def panel(table: Table) -> viz.Panel:
        heads = tuple(column.header for column in table.columns)
        return viz.Panel(table.title, table.first, table.unit, heads, list(map(line, table.rows)))

    panels = [panel(table) for table in record.outcome.tables if table.chart]
    return viz.write_panels(path, panels, caption=record.line)

"""What an ablation is and gives, and the common kind: one setting, varied on the same poses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from skelsplat._arrays import Array
from skelsplat._skelsplat import __version__
from skelsplat.evaluation.ablations._source import CHOICES, PAPER, Errors, Kind, Sample, Source
from skelsplat.evaluation.reported import reported
from skelsplat.evaluation.tables import Column, Report, Row, Table
from skelsplat.exceptions import InvalidInputError

REPORTED = "SkelSplat (reported)"
_CSV = ("table", "unit", "method", "data", "origin", "column", "value")

Outcome = tuple[tuple[Table, ...], tuple[str, ...]]
"""Tables, and what to know about them."""


@dataclass(frozen=True, slots=True)
class Ablation:
    """An ablation of the paper."""

    name: str  # on the command line
    title: str
    labels: tuple[str, ...]  # of the paper's tables
    poses: int  # how many are taken unless told otherwise: so many that two cores are done within a minute
    measure: Callable[[Source], Outcome]  # measures everything on a source of poses

    def run(self, source: Source, *, command: str = "") -> Report:
        """Return the tables, each with what the data are under it; `command` is what repeats them.

        Raises `InvalidInputError` if the source lacks the poses that it needs.
        """
        tables, known = self.measure(source)
        theirs = [reported(label) for label in self.labels]
        notes = [*known, *(f"{note}." for note in dict.fromkeys(source.notes))]
        notes += [f"Paper: {note}" for table in theirs for note in table.notes]
        notes += [f"Reported: {table.title}; {table.source}" for table in theirs]
        line = source.line()
        cells = (
            (t.title, t.unit, r.name, r.data, r.origin, c.header, None if cell is None else repr(cell))
            for t in tables
            for r in t.rows
            for c, cell in zip(t.columns, r.cells, strict=True)
        )
        return Report(
            title=self.title,
            tables=tuple(replace(table, notes=(line,)) for table in tables),
            shown=len(tables),
            fields=_CSV,
            rows=[dict(zip(_CSV, one, strict=True)) for one in cells],
            values={
                "ablation": self.name,
                "title": self.title,
                "version": __version__,
                "command": command,
                "simulated": source.simulated,
                "data": line,
                "choices": {choice: getattr(source, choice) for choice in CHOICES},
                "tables": [asdict(table) for table in tables],
                "notes": notes,
            },
            text="".join(f"\n- {note}" for note in (f"`{command}` (skelsplat {__version__})", *notes)) + "\n",
        )


def reported_rows(label: str, keys: Sequence[str]) -> tuple[Row, ...]:
    """Return the paper's rows with the columns `keys`; None in columns that the paper does not have."""
    found = {}
    for row in (row for row in reported(label).rows if row.method == "SkelSplat"):
        marks = [*row.setting.values(), *([row.detector] if row.detector else [])]
        found[", ".join(marks)] = row.cells(keys)
    return tuple(Row(REPORTED, values, "reported", data) for data, values in found.items())


Trial = tuple[Sample, list[Array]]
"""Poses and starts that a value of a setting is measured on."""


@dataclass(frozen=True, slots=True)
class Line:
    """A row of the table."""

    name: str
    # Value → what it changes in the settings of the method; None for a value that is not measured. Without it
    # the starts themselves are measured.
    fields: Callable[[Any], Mapping[str, Any] | None] | None = None
    method: str = PAPER


def as_in_the_paper(source: Source, sample: Sample, _: Any) -> Trial:
    """Start where the paper does, at every value."""
    return sample, sample.starts(source.start_kind(sample))


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """A setting that is varied."""

    label: str  # the paper's table
    title: str  # of our table
    corner: str  # what its columns are
    values: Mapping[Any, str]  # values, which are also the columns of the paper's table, to headers
    lines: tuple[Line, ...]
    kinds: tuple[Kind, ...] = ("plain",)  # what of the source is measured
    notes: tuple[str, ...] = ()
    trial: Callable[[Source, Sample, Any], Trial] = as_in_the_paper
    up_to_views: bool = False  # values are numbers of views: those above the sample's are left out
    steps: str = ""  # title of a second table, with the steps taken; "" is none
    more: Callable[[Source], Outcome] = lambda _: ((), ())  # what else is measured

    def __call__(self, source: Source) -> Outcome:
        """Measure every value on every sample."""
        rows: dict[str, list[Row]] = {"mpjpe": [], "steps": []}
        for sample in source.samples(*self.kinds):
            for name, by in self._measured(source, sample).items():
                for figure, found in rows.items():
                    cells = (by[v][figure] if v in by else None for v in self.values)
                    found.append(Row(name, tuple(cells), data=sample.name))
        rows["mpjpe"] += reported_rows(
            self.label, [v if isinstance(v, str) else f"{v:g}" for v in self.values]
        )
        headers = self.values.values()
        errors, steps = map(tuple, rows.values())
        tables = [Table(self.title, self.corner, tuple(map(Column, headers)), errors, unit="mm")]
        if self.steps:
            columns = tuple(Column(header, 0) for header in headers)
            tables.append(Table(self.steps, self.corner, columns, steps, unit="steps"))
        others, notes = self.more(source)
        return (*tables, *others), (*self.notes, *notes)

    def _measured(self, source: Source, sample: Sample) -> dict[str, dict[Any, Errors]]:
        """Return errors by row and value."""
        n_views = min(len(group.rig) for group in sample.groups)
        values = [v for v in self.values if not (self.up_to_views and v > n_views)]
        if len(values) < 2:
            expected = f"at least {sorted(self.values)[1]} cameras in {sample.name}"
            raise InvalidInputError(f"views: expected {expected}, got {n_views}")
        found: dict[str, dict[Any, Errors]] = {line.name: {} for line in self.lines}
        for value in values:
            poses, starts = self.trial(source, sample, value)
            for line in self.lines:
                if line.fields is None:
                    found[line.name][value] = poses.errors(starts)
                elif (fields := line.fields(value)) is not None:
                    doing = f"{self.corner} {self.values[value]}"
                    found[line.name][value] = source.errors(line.method, poses, starts, doing, **fields)
        return found

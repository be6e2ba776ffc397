"""Tables of experiments: rows of measured and of reported figures, as text, Markdown and CSV."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

Cell = float | str | None
Origin = Literal["measured", "reported", "theory"]
MISSING = "–"


@dataclass(frozen=True, slots=True)
class Column:
    """Header, decimals of its numbers (None: two below 1, else one), and which end of them is the better."""

    header: str
    digits: int | None = 1
    best: Literal["low", "high"] | None = None


@dataclass(frozen=True, slots=True)
class Row:
    """Name and one cell per column; what is not measured was published, or is what theory says."""

    name: str
    cells: tuple[Cell, ...]
    origin: Origin = "measured"
    data: str = ""  # what it was measured on, where a table has several

    @property
    def label(self) -> str:
        """Name and data."""
        return ", ".join(part for part in (self.name, self.data) if part)


@dataclass(frozen=True, slots=True)
class Table:
    """What is printed and written."""

    #: title, first: `first` heads the column of names.
    title: str
    first: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()  #: sentences under the table
    unit: str = ""
    chart: bool = True  #: whether it belongs into a chart

    @classmethod
    def of(
        cls,
        title: str,
        first: str,
        rows: Mapping[str, Mapping[str, Cell]],
        notes: Sequence[str] = (),
        digits: int | None = None,
    ) -> Table:
        """Return the table of cells by row and column; a row need not have every column."""
        names = list(dict.fromkeys(name for row in rows.values() for name in row))
        cells = [Row(row, tuple(values.get(name) for name in names)) for row, values in rows.items()]
        columns = tuple(Column(name, digits) for name in names)
        return cls(title, first, columns, tuple(cells), tuple(dict.fromkeys(notes)))

    @property
    def heading(self) -> str:
        """Title, with the unit."""
        return f"{self.title} ({self.unit})" if self.unit else self.title

    def text(self, row: Row, k: int) -> str:
        """Return the cell of a row in column `k` as it is printed."""
        cell, digits = row.cells[k], self.columns[k].digits
        if isinstance(cell, str):
            return cell
        if cell is None or not math.isfinite(cell):
            return MISSING
        if digits is None:
            digits = 0 if isinstance(cell, int) else 2 if abs(cell) < 1 else 1
        return f"{cell:.{digits}f}"

    def is_best(self, row: Row, k: int) -> bool:
        """Whether a measured row prints the best number of column `k`, if more than one is measured."""
        best = self.columns[k].best
        measured = [(r, r.cells[k]) for r in self.rows if r.origin == "measured"]
        numbers = [(r, c) for r, c in measured if isinstance(c, float) and math.isfinite(c)]
        if best is None or len(numbers) < 2 or row.origin != "measured":
            return False
        pick = min if best == "low" else max
        winner = pick(numbers, key=lambda pair: pair[1])[0]
        return self.text(row, k) == self.text(winner, k)

    def by_figures(self) -> list[Table]:
        """Return the table; if nothing is reported in some columns, the reported rows as a second one.

        That has only the columns in which something is reported. Notes stay with the last table.
        """
        columns = range(len(self.columns))
        measured = [row for row in self.rows if row.origin == "measured"]
        reported = [row for row in self.rows if row.origin != "measured"]
        known = [k for k in columns if any(row.cells[k] is not None for row in reported)]
        if not reported or len(known) == len(columns):
            return [self]
        return [self._part(columns, measured, True, False), self._part(known, reported, False, True)]

    def _part(self, columns: Sequence[int], rows: Sequence[Row], is_first: bool, is_last: bool) -> Table:
        """Return some columns; the first part has the title, the last one the notes."""
        cut = [replace(row, cells=tuple(row.cells[k] for k in columns)) for row in rows]
        return replace(
            self,
            title=self.title if is_first else "",
            columns=tuple(self.columns[k] for k in columns),
            rows=tuple(row for row in cut if row.origin == "measured" or set(row.cells) != {None}),
            notes=self.notes if is_last else (),
        )

    def turned(self) -> Table:
        """Return the table with its columns as rows, all with the digits of the first."""
        digits = self.columns[0].digits
        columns = tuple(Column(row.label.replace(", ", ",\n"), digits) for row in self.rows)
        rows = [Row(c.header, tuple(row.cells[k] for row in self.rows)) for k, c in enumerate(self.columns)]
        return replace(self, columns=columns, rows=tuple(rows))

    def markdown(self) -> str:
        """Return the table as Markdown, best numbers in bold, reported rows in italics."""
        on_data = any(row.data for row in self.rows)
        rows = []
        for row in self.rows:
            texts = [self.text(row, k) for k in range(len(self.columns))]
            cells = [f"**{text}**" if self.is_best(row, k) else text for k, text in enumerate(texts)]
            name = row.name if row.origin == "measured" else f"*{row.name}*"
            rows.append([name, *([row.data] if on_data else []), *cells])
        header = [self.first, *(["data"] if on_data else []), *(column.header for column in self.columns)]
        title = [f"### {self.heading}"] if self.title else []
        return "\n\n".join([*title, grid(header, rows, numeric=len(self.columns)), *self.notes]) + "\n"


def grid(header: Sequence[str], rows: Iterable[Sequence[str]], *, numeric: int) -> str:
    """Return a table in Markdown, whose last `numeric` columns are aligned to the right."""
    rule = [*["---"] * (len(header) - numeric), *["---:"] * numeric]
    lines = [[cell.replace("|", "\\|") for cell in cells] for cells in (header, rule, *rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def csv_text(fields: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    """Return rows by field as a table with a header; empty where a row has no number."""
    stream = io.StringIO(newline="")
    writer = csv.DictWriter(stream, fields, restval="", lineterminator="\n")
    writer.writeheader()
    for row in rows:
        known = {key: value for key, value in row.items() if not _is_missing(value)}
        writer.writerow({key: f"{v:.6g}" if isinstance(v, float) else v for key, v in known.items()})
    return stream.getvalue()


def _is_missing(value: object) -> bool:
    return value is None or (isinstance(value, float) and not math.isfinite(value))


def interval(low: float, high: float) -> str:
    """Return an interval as it is printed."""
    return f"{low:.1f}–{high:.1f}" if math.isfinite(low) else MISSING

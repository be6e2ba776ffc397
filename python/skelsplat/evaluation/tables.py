"""Tables of experiments, as text and Markdown: rows of measured and of reported figures. Their reports."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from skelsplat._atomic import atomic_write_text
from skelsplat._json import to_text

Cell = float | str | None
Origin = Literal["measured", "reported", "theory"]
MISSING = "–"


@dataclass(frozen=True, slots=True)
class Column:
    """Header, decimals of its numbers (None: two below 1, else one), and which end of them is the better."""

    header: str
    digits: int | None = 1
    best: Literal["low", "high"] | None = None

    def text(self, cell: Cell) -> str:
        """Return a cell as it is printed."""
        if isinstance(cell, str):
            return cell
        if cell is None or not math.isfinite(cell):
            return MISSING
        digits = self.digits
        if digits is None:
            digits = 0 if isinstance(cell, int) else 2 if abs(cell) < 1 else 1
        return f"{round(cell, digits) + 0.0:.{digits}f}"  # never −0.0


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

    title: str
    first: str  #: heads the column of names
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = ()  #: sentences under the table
    unit: str = ""

    @classmethod
    def of(
        cls,
        title: str,
        first: str,
        rows: Mapping[str, Mapping[str, Cell]],
        notes: Iterable[str] = (),
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
        return self.columns[k].text(row.cells[k])

    def is_best(self, row: Row, k: int) -> bool:
        """Whether a measured row prints the best number of column `k`, if more than one is measured."""
        measured = [other.cells[k] for other in self.rows if other.origin == "measured"]
        numbers = [cell for cell in measured if isinstance(cell, float) and math.isfinite(cell)]
        pick = {"low": min, "high": max}.get(self.columns[k].best or "")
        if pick is None or len(numbers) < 2 or row.origin != "measured":
            return False
        return self.text(row, k) == self.columns[k].text(pick(numbers))

    def by_figures(self) -> list[Table]:
        """Return the table; if nothing is reported in some columns, the reported rows as a second one.

        That has only the columns in which something is reported, and the notes.
        """
        reported = [row for row in self.rows if row.origin != "measured"]
        known = [k for k in range(len(self.columns)) if any(row.cells[k] is not None for row in reported)]
        if not reported or len(known) == len(self.columns):
            return [self]
        measured = tuple(row for row in self.rows if row.origin == "measured")
        cut = [replace(row, cells=tuple(row.cells[k] for k in known)) for row in reported]
        others = tuple(row for row in cut if set(row.cells) != {None})
        columns = tuple(self.columns[k] for k in known)
        return [replace(self, rows=measured, notes=()), replace(self, title="", columns=columns, rows=others)]

    def turned(self, first: str | None = None) -> Table:
        """Return the table with its columns as rows, all with the digits of the first."""
        columns = tuple(Column(row.label.replace(", ", ",\n"), self.columns[0].digits) for row in self.rows)
        rows = [Row(c.header, tuple(row.cells[k] for row in self.rows)) for k, c in enumerate(self.columns)]
        return replace(self, first=self.first if first is None else first, columns=columns, rows=tuple(rows))

    def markdown(self) -> str:
        """Return the table as Markdown, best numbers in bold, reported rows in italics."""
        with_data = any(row.data for row in self.rows)
        rows = []
        for row in self.rows:
            texts = [self.text(row, k) for k in range(len(self.columns))]
            cells = [f"**{text}**" if self.is_best(row, k) else text for k, text in enumerate(texts)]
            name = row.name if row.origin == "measured" else f"*{row.name}*"
            rows.append([name, *([row.data] * with_data), *cells])
        header = [self.first, *(["data"] * with_data), *(column.header for column in self.columns)]
        rule = ["---", *(["---"] * with_data), *(["---:"] * len(self.columns))]
        lines = [" | ".join(cell.replace("|", "\\|") for cell in cells) for cells in (header, rule, *rows)]
        title = [f"### {self.heading}"] if self.title else []
        return "\n\n".join([*title, "\n".join(f"| {line} |" for line in lines), *self.notes]) + "\n"


def interval(low: float, high: float) -> str:
    """Return an interval as it is printed."""
    return f"{low:.1f}–{high:.1f}" if math.isfinite(low) else MISSING


@dataclass(frozen=True, kw_only=True)
class Report:
    """What is printed and written of an experiment."""

    title: str
    tables: tuple[Table, ...]
    shown: int = 1  #: how many of the tables are printed; the rest where details are asked for
    fields: tuple[str, ...]  #: columns of the CSV
    rows: Sequence[Mapping[str, Any]]  #: lines of the CSV, by field
    values: Mapping[str, Any]  #: everything, as values of JSON; a number that does not exist becomes null
    text: str = ""  #: Markdown under the tables

    def markdown(self) -> str:
        """Return all tables as Markdown."""
        return f"# {self.title}\n\n" + "\n".join(table.markdown() for table in self.tables) + self.text

    def csv(self) -> str:
        """Return the figures line by line, with all digits that mean something; empty where there is none."""
        stream = io.StringIO(newline="")
        writer = csv.DictWriter(stream, self.fields, restval="", extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        for row in self.rows:
            numbers = {key: f"{v:.6g}" for key, v in row.items() if isinstance(v, float) and math.isfinite(v)}
            words = {key: v for key, v in row.items() if v is not None and not isinstance(v, float)}
            writer.writerow(words | numbers)
        return stream.getvalue()

    def write(self, folder: Path, name: str = "report") -> list[str]:
        """Write ``NAME.md``, ``.csv`` and ``.json`` into a folder, and return their names.

        Raises `DatasetError` if a file cannot be written.
        """
        folder.mkdir(parents=True, exist_ok=True)
        texts = {"md": self.markdown(), "csv": self.csv(), "json": to_text(dict(self.values))}
        for suffix, text in texts.items():
            atomic_write_text(folder / f"{name}.{suffix}", text)
        return [f"{name}.{suffix}" for suffix in texts]

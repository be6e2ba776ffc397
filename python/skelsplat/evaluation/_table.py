"""A table as data, and its Markdown."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

Cell = float | str | None
MISSING = "–"


@dataclass(frozen=True, slots=True)
class Column:
    """Header, decimals of its numbers, and which end of them is the better one."""

    header: str
    digits: int = 1
    best: Literal["low", "high"] | None = None


@dataclass(frozen=True, slots=True)
class Row:
    """Name and one cell per column; reported rows are published figures, not measured ones."""

    name: str
    cells: tuple[Cell, ...]
    reported: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """What is printed and written.

    Attributes
    ----------
    title, first : str
        `first` heads the column of names.
    columns : tuple of Column
    rows : tuple of Row
    notes : tuple of str
        Sentences under the table.
    """

    title: str
    first: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = field(default=())

    def text(self, row: Row, k: int) -> str:
        """Return the cell of a row in column `k` as it is printed."""
        cell = row.cells[k]
        if isinstance(cell, str):
            return cell
        return MISSING if cell is None or not math.isfinite(cell) else f"{cell:.{self.columns[k].digits}f}"

    def is_best(self, row: Row, k: int) -> bool:
        """Whether a measured row prints the best number of column `k`, if more than one is measured."""
        best = self.columns[k].best
        measured = [(r, r.cells[k]) for r in self.rows if not r.reported]
        numbers = [(r, c) for r, c in measured if isinstance(c, float) and math.isfinite(c)]
        if best is None or len(numbers) < 2 or row.reported:
            return False
        pick = min if best == "low" else max
        winner = pick(numbers, key=lambda pair: pair[1])[0]
        return self.text(row, k) == self.text(winner, k)

    def split(self, columns_per_part: int) -> list[Table]:
        """Cut into tables of so many columns; rows with nothing to say in a part are left out of it.

        Notes stay with the last part.
        """
        starts = range(0, len(self.columns), columns_per_part)
        parts = [slice(start, start + columns_per_part) for start in starts]
        return [
            Table(
                self.title if k == 0 else "",
                self.first,
                self.columns[part],
                tuple(
                    Row(row.name, row.cells[part], row.reported)
                    for row in self.rows
                    if not row.reported or any(cell is not None for cell in row.cells[part])
                ),
                self.notes if k == len(parts) - 1 else (),
            )
            for k, part in enumerate(parts)
        ]

    def markdown(self) -> str:
        """Return the table as Markdown, best numbers in bold, reported rows in italics."""
        lines = [f"### {self.title}", ""] if self.title else []
        lines.append(_line([self.first, *(column.header for column in self.columns)]))
        lines.append(_line(["---", *["---:"] * len(self.columns)]))
        for row in self.rows:
            cells = [
                f"**{self.text(row, k)}**" if self.is_best(row, k) else self.text(row, k)
                for k in range(len(self.columns))
            ]
            lines.append(_line([f"*{row.name}*" if row.reported else row.name, *cells]))
        lines += [line for note in self.notes for line in ("", note)]
        return "\n".join(lines) + "\n"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"

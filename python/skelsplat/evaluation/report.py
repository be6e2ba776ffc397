"""What methods reach on a data set: lines of figures, and the tables and files that are made of them."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from skelsplat import _skelsplat
from skelsplat.datasets import Dataset
from skelsplat.evaluation.protocols import SIMULATED, Protocol
from skelsplat.evaluation.reported import Published, published
from skelsplat.evaluation.tables import Cell, Column, Row, Table

Figures = dict[str, Any]
Heard = Callable[[str, str, int, int], None]
"""Called with method, take, poses done so far, and poses in all (of all methods)."""


def lines(method: str, groups: Mapping[str, Mapping[str, Figures]]) -> list[Figures]:
    """Return the figures of a method as lines, from figures by group and name."""
    return [
        {"method": method, "group": group, "name": name, **figures}
        for group, named in groups.items()
        for name, figures in named.items()
    ]


@dataclass(frozen=True, slots=True)
class Figure(Column):
    """A figure as a column of the table of methods: its title elsewhere, and by what it is multiplied."""

    title: str = ""
    factor: float = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """Figures of some methods on a data set."""

    dataset: Dataset
    protocol: Protocol
    settings: Mapping[str, Mapping[str, Any]]  #: what the poses of each method depend on
    subject: str  #: the data in short, for titles
    #: Figures by name of each ``method``, in the order asked for: of the ``group`` "all", and of every
    #: ``name`` of others. Lengths are in mm, shares from 0 to 1, NaN means that nothing counts.
    lines: tuple[Figures, ...]
    columns: Mapping[str, Figure]  #: of the table of methods, by figure

    @property
    def published(self) -> Published | None:
        """What others reported of this data set."""
        return published(self.dataset, self.protocol)

    @property
    def methods(self) -> tuple[str, ...]:
        """The methods, in the order asked for."""
        return tuple(dict.fromkeys(line["method"] for line in self.lines))

    def figures(self, method: str, group: str = "all", name: str = "") -> Figures:
        """Return the figures of a method, over everything or of a part; empty where it has none."""
        wanted = (method, group, name)
        return next((x for x in self.lines if (x["method"], x["group"], x["name"]) == wanted), {})

    def overall(self, title: str, *notes: str) -> Table:
        """One row per method, and those reported; under it the data, their notes, and these."""
        rows = [
            Row(method, tuple(self._cell(key, self.figures(method)) for key in self.columns))
            for method in self.methods
        ]
        if self.published is not None:
            rows += self.published.rows([self._published(key) for key in self.columns])
        data = self.dataset
        own = [f"Data: {data.source or data.name}.", *(f"Note: {note}" for note in data.notes)]
        lines = tuple(" ".join(line.split()) for line in (*own, *notes) if line)
        return Table(f"{self.subject}: {title}", "method", tuple(self.columns.values()), tuple(rows), lines)

    def by(self, group: str, key: str, what: str, whole: str | None = None) -> Table:
        """One row per method, one column per name of a group, and one, headed `whole`, over all of them."""
        figure = self.columns[key]
        names = list(dict.fromkeys(line["name"] for line in self.lines if line["group"] == group))
        rows = []
        for method in self.methods:
            parts = [self.figures(method, group, name) for name in names]
            parts += [self.figures(method)] * (whole is not None)
            rows.append(Row(method, tuple(self._cell(key, part) for part in parts)))
        average, others = self._published(key), self.published
        if others is not None and average is not None and set(names) <= set(others.table.keys):
            rows += others.rows([*names, average])
        heads = [self.protocol.columns.get(name, name) for name in names]
        columns = [Column(head, best=figure.best) for head in (*heads, *([whole] if whole else []))]
        title = f"{self.subject}: {figure.title}, per {what}"
        return Table(title, "method", tuple(columns), tuple(rows))

    def _cell(self, key: str, figures: Figures) -> Cell:
        cell: Cell = figures.get(key)
        return cell if cell is None or isinstance(cell, str) else self.columns[key].factor * cell

    def _published(self, key: str) -> str | None:
        """Return the published column of a figure."""
        if self.published is None or key not in ("absolute_mm", "mean_mm", "pcp"):
            return None
        return self.published.pcp if key == "pcp" else self.published.absolute

    def values(self, **more: Any) -> dict[str, Any]:
        """Return everything as values of JSON, with what only one kind of evaluation has."""
        data, protocol = self.dataset, self.protocol
        about = {name: getattr(data, name) for name in ("name", "detector", "source", "notes")}
        about |= {"simulated": data.name in SIMULATED, "layout": data.layout.name}
        versions = {
            "skelsplat": _skelsplat.__version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "platform": platform.platform(),
        }
        rules = {"name": protocol.name, "text": protocol.text, **more.pop("protocol")}
        whole = {"versions": versions, "dataset": about, "protocol": rules, "settings": self.settings}
        return {**whole, "figures": list(self.lines), **more}

"""What an experiment found, as files: Markdown, CSV, JSON and a chart."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat import _skelsplat
from skelsplat._atomic import atomic_write_text
from skelsplat._json import to_text
from skelsplat._optional import can_draw
from skelsplat.datasets import Dataset
from skelsplat.evaluation.protocols import SIMULATED
from skelsplat.evaluation.tables import Table, csv_text


@dataclass(frozen=True, kw_only=True)
class Report:
    """What is printed and written of an experiment."""

    title: str
    tables: tuple[Table, ...]
    shown: int = 1  #: how many of the tables are printed; the rest where details are asked for
    fields: tuple[str, ...]  #: columns of the CSV
    rows: tuple[Mapping[str, Any], ...]  #: lines of the CSV, by field
    values: Mapping[str, Any]  #: everything, as values of JSON
    text: str = ""  #: Markdown under the tables
    draw: Callable[[Path], Path] | None = None  #: writes the chart

    def markdown(self) -> str:
        """Return all tables as Markdown."""
        return f"# {self.title}\n\n" + "\n".join(table.markdown() for table in self.tables) + self.text

    def csv(self) -> str:
        """Return the figures line by line, with all digits that mean something."""
        return csv_text(self.fields, self.rows)

    def json(self) -> str:
        """Return everything that is known; a number that does not exist is null."""
        return to_text(dict(self.values))

    def write(self, folder: Path, name: str = "report", chart: str = "bars.png") -> list[str]:
        """Write ``NAME.md``, ``.csv``, ``.json`` and the chart into a folder, and return their names.

        The chart needs the extra ``viz`` and is left out without it. Raises `DatasetError` if a file cannot
        be written.
        """
        folder.mkdir(parents=True, exist_ok=True)
        texts = {"md": self.markdown, "csv": self.csv, "json": self.json}
        for suffix, text in texts.items():
            atomic_write_text(folder / f"{name}.{suffix}", text())
        files = [f"{name}.{suffix}" for suffix in texts]
        return [*files, self.draw(folder / chart).name] if self.draw and can_draw() else files


def versions() -> dict[str, str]:
    """Return the versions and the platform that results depend on."""
    return {
        "skelsplat": _skelsplat.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "platform": platform.platform(),
    }


def about_dataset(data: Dataset) -> dict[str, Any]:
    """Return what the data are."""
    return {
        "name": data.name,
        "detector": data.detector,
        "simulated": data.name in SIMULATED,
        "source": data.source,
        "notes": list(data.notes),
        "layout": data.layout.name,
    }


def paragraphs(data: Dataset, *lines: str) -> tuple[str, ...]:
    """Return what goes under the first table: the data and their notes, then these lines."""
    own = [f"Data: {data.source or data.name}.", *(f"Note: {note}" for note in data.notes)]
    return tuple(" ".join(line.split()) for line in (*own, *lines) if line)

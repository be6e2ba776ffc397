"""The figures of one measurement, as a dict and as one table on the terminal."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from scenarios import FloatArray, Scene

import skelsplat as sk

Rows = Mapping[str, Mapping[str, Any]]


def figures(title: str, head: str, rows: Rows, notes: list[str], **about: Any) -> dict[str, Any]:
    """Assemble a measurement: ``rows[row][column]`` are the numbers, `about` the conditions."""
    return {"title": title, "head": head, "rows": rows, "notes": list(dict.fromkeys(notes)), **about}


def mpjpe(pose: FloatArray, scene: Scene) -> float:
    """MPJPE in mm over the joints that at least two views detect."""
    return float(sk.metrics.mpjpe(pose, scene.judged))


def missing(columns: Mapping[str, FloatArray], scene: Scene, where: str) -> list[str]:
    """Note for each column the share of evaluated joints without a position, if any."""
    shares = {name: float(sk.metrics.missing_rate(pose, scene.judged)) for name, pose in columns.items()}
    return [
        f"{where}: {name} leaves {100 * s:.2f} % of the joints out" for name, s in shares.items() if s > 0
    ]


def show(measured: Mapping[str, Any]) -> None:
    """Print one table, the conditions and the notes, at most 110 characters wide."""
    console = Console(width=110, highlight=False)
    table = Table(
        title=measured["title"], title_justify="left", box=SIMPLE_HEAD, pad_edge=False, collapse_padding=True
    )
    table.add_column(measured["head"], no_wrap=True)
    names = list(dict.fromkeys(name for row in measured["rows"].values() for name in row))
    for name in names:
        table.add_column(name, justify="right", overflow="fold")
    for row, values in measured["rows"].items():
        table.add_row(row, *[_text(values.get(name)) for name in names])
    console.print(table)
    about = {k: v for k, v in measured.items() if k not in ("title", "head", "rows", "notes", "details")}
    console.print(" · ".join(f"{name} {value}" for name, value in about.items()), markup=False)
    for note in measured["notes"]:
        console.print(f"- {note}", markup=False)
    console.print(f"python {shlex.join(sys.argv)}", markup=False)


def _text(value: object) -> str:
    if value is None:
        return "–"
    if isinstance(value, float | np.floating):
        return f"{value:.2f}" if abs(value) < 1 else f"{value:.1f}"
    return str(value)

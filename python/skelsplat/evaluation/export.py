"""An evaluation as Markdown, CSV, JSON and a chart."""

from __future__ import annotations

import csv
import io
import json
import math
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat import _skelsplat
from skelsplat._atomic import atomic_write_text
from skelsplat._json import plain
from skelsplat._optional import can_draw
from skelsplat.datasets import Dataset
from skelsplat.evaluation.protocols import SIMULATED
from skelsplat.evaluation.report import Evaluation
from skelsplat.evaluation.scores import FIGURES
from skelsplat.evaluation.tables import all_tables, overall

CSV_FIELDS = ("method", "reported", "group", "name", *FIGURES)
"""Columns of the CSV: ``group`` is all, action or joint; shares are from 0 to 1; empty means no number."""


def markdown(evaluation: Evaluation) -> str:
    """Return all tables as Markdown."""
    title = f"# {evaluation.dataset.name}\n\n"
    return title + "\n".join(table.markdown() for table in all_tables(evaluation))


def to_csv(evaluation: Evaluation) -> str:
    """Return one line per method and group, with all digits that mean something (see `CSV_FIELDS`)."""
    rows = []
    for method, reported, group, name, figures in _lines(evaluation):
        numbers = {
            key: f"{value:{'d' if key == 'poses' else '.6g'}}"
            for key, value in figures.items()
            if value is not None and math.isfinite(value)
        }
        own = {"method": method, "reported": int(reported), "group": group, "name": name}
        rows.append({**own, **numbers})
    return csv_text(CSV_FIELDS, rows)


def csv_text(fields: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    """Return rows by field as a table with a header; a field that a row does not have is empty."""
    stream = io.StringIO(newline="")
    writer = csv.DictWriter(stream, fields, restval="", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()


def _lines(evaluation: Evaluation) -> Iterator[tuple[str, bool, str, str, Mapping[str, float | None]]]:
    """Yield method, whether it is reported, group, name, figures; of reports the average and the actions."""
    for s in evaluation.scores:
        yield s.method, False, "all", "", {key: read(s) for key, read in FIGURES.items()}
        for group, means in (("action", s.columns), ("joint", s.joints)):
            for name, g in means.items():
                errors = {f"{kind}_mm": getattr(g, kind) for kind in ("absolute", "relative", "procrustes")}
                yield s.method, False, group, name, {"poses": g.poses, **errors, "pcp": g.pcp}
    others = evaluation.published
    if others is None:
        return
    for row in others.table:
        pcp = others.value(row, others.pcp)
        average = {
            "absolute_mm": others.value(row, others.absolute),
            "pcp": None if pcp is None else pcp / 100,
        }
        yield others.name(row), True, "all", "", average
        for key in evaluation.headers:
            if key in others.table.keys:
                yield others.name(row), True, "action", key, {"absolute_mm": others.value(row, key)}


def to_json(evaluation: Evaluation) -> str:
    """Return everything that is known of the evaluation; a number that does not exist is null."""
    return as_text(as_dict(evaluation))


def as_text(values: dict[str, Any]) -> str:
    """Return values as JSON text; a number that does not exist is null."""
    return json.dumps(plain(values), indent=1, ensure_ascii=False) + "\n"


def write(folder: Path, evaluation: Evaluation) -> list[str]:
    """Write ``report.md``, ``.csv``, ``.json`` and ``bars.png`` into a folder; return their names.

    The chart needs the extra ``viz`` and is left out without it. Raises `DatasetError` if a file cannot be
    written.
    """
    files = {"report.md": markdown, "report.csv": to_csv, "report.json": to_json}
    for name, text in files.items():
        atomic_write_text(folder / name, text(evaluation))
    return [*files, _write_bars(folder / "bars.png", evaluation).name] if can_draw() else [*files]


def _write_bars(path: Path, evaluation: Evaluation) -> Path:
    from skelsplat import viz  # matplotlib takes long to load, and text does without

    table = overall(evaluation)
    rows = [row for row in table.rows if row.cells[0] is not None]
    intervals = {s.method: (s.absolute.low, s.absolute.high) for s in evaluation.scores}
    ends = np.array([(np.nan, np.nan) if row.reported else intervals[row.name] for row in rows])
    real = " on the real data set" if evaluation.simulated else ""
    others = f" Grey: reported{real}, not measured here." if evaluation.published else ""
    data = viz.BarData(
        names=tuple(row.name for row in rows),
        values=np.array([row.cells[0] for row in rows], dtype=np.float64),
        low=ends[:, 0],
        high=ends[:, 1],
        measured=np.array([not row.reported for row in rows]),
        title=table.title.partition(":")[0],
        axis="absolute MPJPE, mm, with 95 % interval over takes",
        caption=f"{evaluation.dataset.source or evaluation.dataset.name}.{others}",
    )
    return viz.write_bars(path, data)


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


def as_dict(evaluation: Evaluation) -> dict[str, Any]:
    """Return data, protocol, settings, scores and reported rows as JSON values."""
    rules, others = evaluation.protocol, evaluation.published
    return {
        "versions": versions(),
        "dataset": about_dataset(evaluation.dataset),
        "protocol": {
            "name": rules.name,
            "text": rules.text,
            "undistort": evaluation.options.undistort,
            "views": sorted({len(case.take.rig) for case in evaluation.cases}),
            "every": rules.every,
            "min_visible_views": rules.min_visible_views,
            "takes": len(evaluation.cases),
        },
        "columns": dict(evaluation.headers),
        "settings": evaluation.settings,
        "scores": [asdict(s) for s in evaluation.scores],
        "reported": None if others is None else asdict(others.table),
    }

"""An evaluation as Markdown, CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from skelsplat import _skelsplat
from skelsplat.evaluation.report import Evaluation
from skelsplat.evaluation.scores import Scores
from skelsplat.evaluation.tables import all_tables

CSV_FIELDS = (
    "method",
    "reported",
    "group",
    "name",
    "poses",
    "absolute_mm",
    "absolute_low_mm",
    "absolute_high_mm",
    "relative_mm",
    "procrustes_mm",
    "median_mm",
    "pck_50",
    "pck_100",
    "pck_150",
    "pcp",
    "missing",
    "ms_per_pose",
)
"""Columns of the CSV: ``group`` is all, action or joint; shares are from 0 to 1; empty means no number."""


def markdown(evaluation: Evaluation) -> str:
    """Return all tables as Markdown."""
    title = f"# {evaluation.dataset.name}\n\n"
    return title + "\n".join(table.markdown() for table in all_tables(evaluation))


def to_csv(evaluation: Evaluation) -> str:
    """Return one line per method and group, with all digits that mean something (see `CSV_FIELDS`)."""
    stream = io.StringIO(newline="")
    writer = csv.DictWriter(stream, CSV_FIELDS, restval="", lineterminator="\n")
    writer.writeheader()
    for s in evaluation.scores:
        writer.writerow(_all(s))
        for group, means in (("action", s.columns), ("joint", s.joints)):
            writer.writerows(_group(s.method, group, name, asdict(g)) for name, g in means.items())
    if evaluation.published is not None:
        writer.writerows(_reported(evaluation))
    return stream.getvalue()


def to_json(evaluation: Evaluation) -> str:
    """Return everything that is known of the evaluation; a number that does not exist is null."""
    return json.dumps(_plain(as_dict(evaluation)), indent=1, ensure_ascii=False) + "\n"


def as_dict(evaluation: Evaluation) -> dict[str, Any]:
    """Return data, protocol, settings, scores and reported rows as JSON values."""
    rules, data = evaluation.protocol, evaluation.dataset
    others = evaluation.published
    return {
        "versions": {
            "skelsplat": _skelsplat.__version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "platform": platform.platform(),
        },
        "dataset": {
            "name": data.name,
            "detector": data.detector,
            "simulated": evaluation.simulated,
            "source": data.source,
            "notes": list(data.notes),
            "layout": data.layout.name,
        },
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


def _all(s: Scores) -> dict[str, Any]:
    return {
        **_group(s.method, "all", "", {"poses": s.poses}),
        "absolute_mm": _number(s.absolute.mean),
        "absolute_low_mm": _number(s.absolute.low),
        "absolute_high_mm": _number(s.absolute.high),
        "relative_mm": _number(s.relative.mean),
        "procrustes_mm": _number(s.procrustes.mean),
        "median_mm": _number(s.median),
        **{f"pck_{mm}": _number(share) for mm, share in s.pck.items()},
        "pcp": _number(s.pcp),
        "missing": _number(s.missing),
        "ms_per_pose": _number(s.ms_per_pose),
    }


def _group(method: str, group: str, name: str, means: Mapping[str, Any]) -> dict[str, Any]:
    numbers = {
        f"{key}_mm": _number(means[key]) for key in ("absolute", "relative", "procrustes") if key in means
    }
    pcp = {"pcp": _number(means["pcp"])} if "pcp" in means else {}
    return {
        "method": method,
        "reported": 0,
        "group": group,
        "name": name,
        "poses": means["poses"],
        **numbers,
        **pcp,
    }


def _reported(evaluation: Evaluation) -> Sequence[dict[str, Any]]:
    """Return the published rows: the average, and the actions if the table has them."""
    others = evaluation.published
    if others is None:
        return []
    lines = []
    for row in others.table:
        keys = {"": others.absolute, **{key: key for key in evaluation.headers if key in others.table.keys}}
        for name, key in keys.items():
            value, group = others.value(row, key), "action" if name else "all"
            line = {"method": others.name(row), "reported": 1, "group": group, "name": name}
            pcp = None if name else others.value(row, others.pcp)
            lines.append(
                {**line, "absolute_mm": _number(value), "pcp": _number(None if pcp is None else pcp / 100)}
            )
    return lines


def _number(value: float | None) -> str:
    return "" if value is None or not math.isfinite(value) else f"{value:.6g}"


def _plain(value: Any) -> Any:
    """Turn NaN into None and mappings and tuples into what JSON has."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value

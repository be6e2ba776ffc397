"""An evaluation of several people as tables, Markdown, CSV and JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from skelsplat._atomic import atomic_write_text
from skelsplat.evaluation.export import about_dataset, as_text, csv_text, versions
from skelsplat.evaluation.people import PeopleEvaluation
from skelsplat.evaluation.tables import Cell, Column, Row, Table, interval, one_paragraph, reported_rows

# Columns by figure, and by what the figure is multiplied.
_COLUMNS: dict[str, tuple[Column, float]] = {
    "precision": (Column("prec.", best="high"), 100),
    "recall": (Column("rec.", best="high"), 100),
    "mean_mm": (Column("MPJPE", best="low"), 1),
    "interval": (Column("95 % CI"), 1),
    "pcp": (Column("PCP", best="high"), 100),
    "idf1": (Column("IDF1", best="high"), 100),
    "identity_switches": (Column("IDS", 0), 1),
    "fragmentations": (Column("frag", 0), 1),
    "scenes_clean": (Column("clean", 0), 100),
    "scenes_swapped": (Column("swap", 0), 100),
    "change": (Column("vs. oracle"), 100),
    "ms_per_frame": (Column("ms/frame", 2), 1),
}
CSV_FIELDS = ("method", "group", "name", *(key for key in _COLUMNS if key != "interval"), "person_frames")
"""Columns of the CSV: ``group`` is all, scene or person; shares are from 0 to 1; empty means no number."""


def overall(evaluation: PeopleEvaluation) -> Table:
    """One row per method."""
    rows = []
    for method in evaluation.tallies:
        figures = evaluation.figures(method)
        cells: dict[str, Cell] = {
            key: factor * figures[key] for key, (_, factor) in _COLUMNS.items() if key != "interval"
        }
        cells["change"] = round(100 * figures["change"], 1) + 0.0  # never −0.0
        cells["interval"] = interval(figures["mean_low_mm"], figures["mean_high_mm"])
        rows.append(Row(method, tuple(cells[key] for key in _COLUMNS)))
    others = evaluation.published
    if others is not None:
        columns = {"mean_mm": others.absolute, "pcp": others.pcp}
        rows += reported_rows(others, [columns.get(key) for key in _COLUMNS])
    title = f"{_subject(evaluation)}: precision, recall, PCP and IDF1 in %, MPJPE in mm"
    return Table(
        title, "method", tuple(column for column, _ in _COLUMNS.values()), tuple(rows), notes(evaluation)
    )


def persons(evaluation: PeopleEvaluation, figure: str) -> Table:
    """One row per method, one column per person, of PCP, recall (%) or mean error (mm)."""
    column, factor = _COLUMNS[figure]
    tables = {method: tally.people() for method, tally in evaluation.tallies.items()}
    names = list(dict.fromkeys(name for table in tables.values() for name in table))
    headers = [Column(evaluation.protocol.columns.get(name, name), best=column.best) for name in names]
    rows = []
    for method, table in tables.items():
        values = [factor * table[name][figure] if name in table else None for name in names]
        rows.append(Row(method, (*values, factor * evaluation.figures(method)[figure])))
    title = f"{_subject(evaluation)}: {column.header}, {'mm' if factor == 1 else '%'}, per person"
    return Table(title, "method", (*headers, Column("all", best=column.best)), tuple(rows))


def all_tables(evaluation: PeopleEvaluation) -> list[Table]:
    """Return every table that is written to files."""
    figures = ("pcp", "mean_mm", "recall") if evaluation.protocol.parts else ("mean_mm", "recall")
    return [overall(evaluation), *(persons(evaluation, figure) for figure in figures)]


def notes(evaluation: PeopleEvaluation) -> tuple[str, ...]:
    """Return what goes under the first table: data, protocol, what the columns mean."""
    several = " People without a truth in a frame may be real; whoever finds them loses precision."
    real = "" if evaluation.protocol.least_views else several
    lines = [
        f"Data: {evaluation.dataset.source or evaluation.dataset.name}. Who is who is not given, except to "
        "oracle, which takes the detections that the ground truth associates with each person.",
        *(f"Note: {note}" for note in evaluation.dataset.notes),
        f"Protocol: {evaluation.protocol.text} Estimates are assigned to people frame by frame, up to 500 mm "
        f"of mean joint distance; MPJPE is of the assigned ones.{real}",
        "IDS, frag: identity switches and fragmentations (CLEAR MOT), in all scenes; clean: scenes without "
        "a switch, %; swap: scenes in which one identity follows two people for half a second each, %. "
        "vs. oracle: change of MPJPE, %, where both methods have a person and neither confuses them. "
        "95 % CI: of MPJPE, by bootstrap over scenes. Time: the method alone.",
    ]
    others = evaluation.published
    if others is not None:
        table = others.table
        lines.append(f"Reported (in italics), not measured here: {table.source}. {' '.join(table.notes)}")
    return tuple(one_paragraph(line) for line in lines)


def _subject(evaluation: PeopleEvaluation) -> str:
    data, scenes = evaluation.dataset, evaluation.cases
    views = sorted({len(case.scene.rig) for case in scenes})
    each = f"{', '.join(map(str, views))} view{'s' * (views != [1])}"
    count = f"{len(scenes)} scene{'s' * (len(scenes) != 1)}"
    return f"{data.name} ({data.detector or 'no detections'}), {each}, {count}"


def _lines(evaluation: PeopleEvaluation) -> Iterator[tuple[str, str, str, Mapping[str, float]]]:
    """Yield method, group, name and figures."""
    for method, tally in evaluation.tallies.items():
        yield method, "all", "", evaluation.figures(method)
        for key in tally.scenes:
            yield method, "scene", key, evaluation.figures(method, key)
        for name, figures in tally.people().items():
            yield method, "person", name, figures


def to_csv(evaluation: PeopleEvaluation) -> str:
    """Return one line per method and group (see `CSV_FIELDS`)."""
    rows = []
    for method, group, name, figures in _lines(evaluation):
        known = {
            key: f"{figures[key]:.6g}" for key in CSV_FIELDS if math.isfinite(figures.get(key, math.nan))
        }
        rows.append({"method": method, "group": group, "name": name, **known})
    return csv_text(CSV_FIELDS, rows)


def as_dict(evaluation: PeopleEvaluation) -> dict[str, Any]:
    """Return data, protocol, settings and figures as JSON values."""
    rules = evaluation.protocol
    return {
        "versions": versions(),
        "dataset": about_dataset(evaluation.dataset),
        "protocol": {"name": rules.name, "text": rules.text, "least_views": rules.least_views},
        "settings": evaluation.settings,
        "scenes": [
            {
                "key": c.scene.key,
                "frames": int(c.judged.sum()),
                "people": list(c.scene.names),
                "views": len(c.scene.rig),
            }
            for c in evaluation.cases
        ],
        "figures": [
            {"method": m, "group": group, "name": name, **values}
            for m, group, name, values in _lines(evaluation)
        ],
    }


def write(folder: Path, evaluation: PeopleEvaluation) -> list[str]:
    """Write ``report.md``, ``.csv`` and ``.json`` into a folder; return their names."""
    title = f"# {evaluation.dataset.name}\n\n"
    texts = {
        "report.md": title + "\n".join(table.markdown() for table in all_tables(evaluation)),
        "report.csv": to_csv(evaluation),
        "report.json": as_text(as_dict(evaluation)),
    }
    for name, text in texts.items():
        atomic_write_text(folder / name, text)
    return list(texts)

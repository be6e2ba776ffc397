"""Tables of an evaluation: all methods, per action, per joint; measured rows first, then reported ones."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from skelsplat.evaluation.report import Evaluation, Published
from skelsplat.evaluation.scores import FIGURES, PCK_MM

Cell = float | str | None
Metric = Literal["absolute", "relative", "procrustes", "pcp"]
_TITLES = {
    "absolute": "Absolute MPJPE, mm",
    "relative": "Root-relative MPJPE, mm",
    "procrustes": "PA-MPJPE, mm",
    "pcp": "PCP, %",
}
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
    """What is printed and written."""

    #: title, first: `first` heads the column of names.
    title: str
    first: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    notes: tuple[str, ...] = field(default=())  #: sentences under the table

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
        columns = range(len(self.columns))
        starts = columns[::columns_per_part]
        return [
            self._part(columns[k : k + columns_per_part], self.rows, k == starts[0], k == starts[-1])
            for k in starts
        ]

    def by_figures(self) -> list[Table]:
        """Return the table; if nothing is reported in some columns, the reported rows as a second one.

        That has only the columns in which something is reported. Notes stay with the last table.
        """
        columns = range(len(self.columns))
        measured, reported = ([row for row in self.rows if row.reported == kind] for kind in (False, True))
        known = [k for k in columns if any(row.cells[k] is not None for row in reported)]
        if not reported or len(known) == len(columns):
            return [self]
        return [self._part(columns, measured, True, False), self._part(known, reported, False, True)]

    def _part(self, columns: Sequence[int], rows: Sequence[Row], is_first: bool, is_last: bool) -> Table:
        """Return some columns; the first part has the title, the last one the notes."""
        cells = [(row, tuple(row.cells[k] for k in columns)) for row in rows]
        return Table(
            self.title if is_first else "",
            self.first,
            tuple(self.columns[k] for k in columns),
            tuple(
                Row(row.name, own, row.reported)
                for row, own in cells
                if not row.reported or any(cell is not None for cell in own)
            ),
            self.notes if is_last else (),
        )

    def markdown(self) -> str:
        """Return the table as Markdown, best numbers in bold, reported rows in italics."""
        rows = []
        for row in self.rows:
            cells = [
                f"**{self.text(row, k)}**" if self.is_best(row, k) else self.text(row, k)
                for k in range(len(self.columns))
            ]
            rows.append([f"*{row.name}*" if row.reported else row.name, *cells])
        header = [self.first, *(column.header for column in self.columns)]
        title = [f"### {self.title}"] if self.title else []
        return "\n\n".join([*title, grid(header, rows, numeric=len(self.columns)), *self.notes]) + "\n"


def grid(header: Sequence[str], rows: Iterable[Sequence[str]], *, numeric: int) -> str:
    """Return a table in Markdown, whose last `numeric` columns are aligned to the right."""
    rule = [*["---"] * (len(header) - numeric), *["---:"] * numeric]
    lines = [[cell.replace("|", "\\|") for cell in cells] for cells in (header, rule, *rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


_INTERVAL = "interval"
# Columns of the table of methods by figure, and by what the figure is multiplied.
_OVERALL: dict[str, tuple[Column, float]] = {
    "absolute_mm": (Column("abs", best="low"), 1),
    _INTERVAL: (Column("95 % CI"), 1),
    "relative_mm": (Column("rel", best="low"), 1),
    "procrustes_mm": (Column("PA", best="low"), 1),
    "median_mm": (Column("median", best="low"), 1),
    **{f"pck_{mm}": (Column(f"PCK {mm}", best="high"), 100) for mm in PCK_MM},
    "pcp": (Column("PCP", best="high"), 100),
    "missing": (Column("missing", digits=2), 100),
    "acceleration_m_s2": (Column("acc", best="low"), 1),
    "ms_per_pose": (Column("ms/pose", digits=2), 1),
}


def overall(evaluation: Evaluation) -> Table:
    """One row per method: errors, shares, time."""
    without = set() if evaluation.protocol.parts else {"pcp"}
    if not _rated(evaluation):
        without.add("acceleration_m_s2")
    shown = {key: cell for key, cell in _OVERALL.items() if key not in without}
    rows = [
        Row(
            s.method,
            tuple(
                interval(s.absolute.low, s.absolute.high) if key == _INTERVAL else factor * FIGURES[key](s)
                for key, (_, factor) in shown.items()
            ),
        )
        for s in evaluation.scores
    ]
    others = evaluation.published
    if others is not None:
        columns = {"absolute_mm": others.absolute, "pcp": others.pcp}
        rows += reported_rows(others, [columns.get(key) for key in shown])
    return Table(
        f"{_subject(evaluation)}: MPJPE in mm (absolute, root-relative, Procrustes), shares in %",
        "method",
        tuple(column for column, _ in shown.values()),
        tuple(rows),
        notes(evaluation),
    )


def actions(evaluation: Evaluation, metric: Metric = "absolute") -> Table:
    """One row per method, one column per action of the protocol and their average over poses."""
    share = 100.0 if metric == "pcp" else 1.0
    best: Literal["low", "high"] = "high" if metric == "pcp" else "low"
    columns = [Column(header, best=best) for header in evaluation.headers.values()]
    rows = []
    for s in evaluation.scores:
        values = [share * getattr(group, metric) for group in s.columns.values()]
        average = s.pcp if metric == "pcp" else getattr(s, metric).mean
        rows.append(Row(s.method, (*values, share * average)))
    others = evaluation.published
    if others is not None and metric == "absolute" and set(evaluation.headers) <= set(others.table.keys):
        rows += reported_rows(others, (*evaluation.headers, others.absolute))
    rules = evaluation.protocol
    kind = "actor" if rules.parts else "action" if rules.columns else "sequence"
    return Table(
        f"{_subject(evaluation)}: {_TITLES[metric]}, per {kind}",
        "method",
        (*columns, Column("Avg", best=best)),
        tuple(rows),
    )


def reported_rows(others: Published, keys: Sequence[str | None]) -> list[Row]:
    """Return a row per published one, with these of its columns; None is a column that it does not have."""
    return [
        Row(others.name(row), tuple(others.value(row, key) for key in keys), reported=True)
        for row in others.table
    ]


def joints(evaluation: Evaluation, metric: Literal["absolute", "relative"] = "absolute") -> Table:
    """One row per joint, one column per method."""
    names = evaluation.dataset.layout.joints
    columns = tuple(Column(s.method) for s in evaluation.scores)
    rows = [Row(name, tuple(getattr(s.joints[name], metric) for s in evaluation.scores)) for name in names]
    return Table(f"{_subject(evaluation)}: {_TITLES[metric]}, per joint", "joint", columns, tuple(rows))


def all_tables(evaluation: Evaluation) -> list[Table]:
    """Return every table that is written to files."""
    several = len(evaluation.headers) > 1
    kinds: list[Metric] = ["absolute", "relative", "procrustes"]
    if evaluation.protocol.parts:
        kinds.append("pcp")
    return [
        overall(evaluation),
        *(actions(evaluation, kind) for kind in kinds if several),
        joints(evaluation, "absolute"),
        joints(evaluation, "relative"),
    ]


def notes(evaluation: Evaluation) -> tuple[str, ...]:
    """Return what goes under the first table: data, protocol, settings, what the columns mean."""
    options, rules = evaluation.options, evaluation.protocol
    threads = options.n_threads or os.cpu_count() or 1
    lens = "removed from the detections" if options.undistort else "ignored, as the paper does (K alone)"
    lines = [
        f"Data: {evaluation.dataset.source or evaluation.dataset.name}.",
        *(f"Note: {note}" for note in evaluation.dataset.notes),
        f"Protocol: {rules.text} {_counted(evaluation)}",
        f"Lens distortion: {lens}. {_starts(evaluation)}",
        "95 % CI: of abs, by bootstrap over takes. Joints without a position (missing, %) are in no "
        f"distance, and wrong in PCK. Time: the method alone, compiled methods on {threads} "
        f"thread{'s' * (threads != 1)}; no 2D detector or monocular estimator.",
    ]
    if _rated(evaluation):
        rates = sorted({f"{case.take.fps:g}" for case in evaluation.cases if case.take.fps is not None})
        lines.append(
            f"acc: mean error of the acceleration, m/s², of consecutive frames at {' or '.join(rates)} Hz. "
            "annealed-butterworth, annealed-kalman and over-time use all frames of a take, not across gaps."
        )
    if evaluation.published is not None:
        table = evaluation.published.table
        real = ", on the real data set" if evaluation.simulated else ""
        lines.append(
            f"Reported (in italics), not measured here{real}: {table.source}. {' '.join(table.notes)}"
        )
    return tuple(one_paragraph(line) for line in lines)


def one_paragraph(text: str) -> str:
    """Return a text with single spaces."""
    return " ".join(text.split())


def _rated(evaluation: Evaluation) -> bool:
    """Whether a method has an error of the acceleration."""
    return any(math.isfinite(s.acceleration) for s in evaluation.scores)


def interval(low: float, high: float) -> str:
    """Return an interval as it is printed."""
    return f"{low:.1f}–{high:.1f}" if math.isfinite(low) else MISSING


def _subject(evaluation: Evaluation) -> str:
    detector = evaluation.dataset.detector or "no detections"
    views = {len(case.take.rig) for case in evaluation.cases}
    return f"{evaluation.dataset.name} ({detector}), {', '.join(map(str, sorted(views)))} views"


def _counted(evaluation: Evaluation) -> str:
    first = evaluation.scores[0]
    text = f"Poses: {first.absolute_poses} absolute, {first.poses} relative"
    expected = evaluation.protocol.expected_poses
    if expected is not None and expected != (first.absolute_poses, first.poses):
        text += f" (the published evaluation has {expected[0]} and {expected[1]})"
    least = evaluation.protocol.min_visible_views
    return f"{text}; joints seen by at least {least} views only." if least else f"{text}."


def _starts(evaluation: Evaluation) -> str:
    words = {"dlt": "DLT", "fusion": "fused monocular poses", "none": "the solver's own triangulation"}
    starts = []
    for name, settings in evaluation.settings.items():
        if "start" in settings:
            sigma = settings.get("init_sigma_mm")
            prior = "" if sigma is None else f" as a prior of {sigma:g} mm per axis"
            starts.append(f"{name} from {words[settings['start']]}{prior}")
    return f"Starts: {', '.join(starts)}." if starts else ""

"""Evaluation of methods that solve one person: a data set and names of methods in, scores and tables out.

>>> from skelsplat import datasets
>>> from skelsplat.evaluation import single
>>> data = datasets.read("synthetic", "data/h36m-like")                                   # doctest: +SKIP
>>> print(single.evaluate(data, ["dlt", "annealed"]).report().markdown())                 # doctest: +SKIP
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import numpy as np

from skelsplat.datasets import Dataset
from skelsplat.evaluation import methods, protocols, runs
from skelsplat.evaluation.methods import Method, Options
from skelsplat.evaluation.protocols import Case, Protocol
from skelsplat.evaluation.published import Published, published
from skelsplat.evaluation.report import Report, about_dataset, paragraphs, versions
from skelsplat.evaluation.scores import FIGURES, PCK_MM, Scores, score
from skelsplat.evaluation.tables import Column, Row, Table, interval
from skelsplat.exceptions import InvalidInputError

Metric = Literal["absolute", "relative", "procrustes", "pcp"]
_TITLES: dict[Metric, str] = {
    "absolute": "Absolute MPJPE, mm",
    "relative": "Root-relative MPJPE, mm",
    "procrustes": "PA-MPJPE, mm",
    "pcp": "PCP, %",
}
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
_STARTS = {"dlt": "DLT", "fusion": "fused monocular poses", "none": "the solver's own triangulation"}
CSV_FIELDS = ("method", "reported", "group", "name", *FIGURES)
"""Columns of the CSV: ``group`` is all, action or joint; shares are from 0 to 1; empty means no number."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evaluation:
    """What `evaluate` found."""

    dataset: Dataset
    protocol: Protocol
    cases: tuple[Case, ...]
    headers: Mapping[str, str]  #: columns that occur, key to header
    options: Options
    settings: Mapping[str, Mapping[str, Any]]  #: what the poses of each method depend on
    scores: tuple[Scores, ...]  #: one per method, in the order asked for
    published: Published | None  #: what others reported of this data set

    @property
    def rated(self) -> bool:
        """Whether a method has an error of the acceleration."""
        return any(math.isfinite(s.acceleration) for s in self.scores)

    def report(self) -> Report:
        """Return tables, figures and chart; printed are those of methods and actions."""
        several = len(self.headers) > 1
        kinds: list[Metric] = ["absolute", "relative", "procrustes"]
        first: list[Metric] = ["absolute"]
        if self.protocol.parts:
            kinds.append("pcp")
            first.append("pcp")
        ordered = [*first, *(kind for kind in kinds if kind not in first)] if several else []
        shown = [overall(self), *(actions(self, kind) for kind in ordered)]
        return Report(
            title=self.dataset.name,
            tables=(*shown, joints(self, "absolute"), joints(self, "relative")),
            shown=1 + several * len(first),
            fields=CSV_FIELDS,
            rows=tuple(_lines(self)),
            values=_values(self),
            draw=partial(_draw, self),
        )


def evaluate(
    dataset: Dataset,
    names: Sequence[str] = (),
    options: Options | None = None,
    *,
    protocol: Protocol | None = None,
    folder: Path | None = None,
    report: runs.Report | None = None,
) -> Evaluation:
    """Run methods on a data set and score them.

    Parameters
    ----------
    dataset : Dataset
    names : sequence of str
        Of `methods.names`; none: all that the data allow except the one that renders pixels; ``"all"``
        alone: all, but of those over time only what the data allow.
    options : Options, optional
        `paper_fields` and `paper_start` are filled in from the protocol.
    protocol : Protocol, optional
        Default: that of the data set's name.
    folder : Path, optional
        Where the poses of every take are kept, so that a stopped evaluation goes on.
    report : callable, optional
        As `runs.Report`.

    Raises
    ------
    InvalidInputError
        An unknown method, or nothing to evaluate.
    DatasetError
        A take lacks what a method needs, or results cannot be written.
    """
    rules = protocols.get(dataset.name) if protocol is None else protocol
    cases = rules.cases(dataset)
    # As in the paper, or by DLT if there are no monocular poses.
    fused = rules.paper_start == "fusion" and all(case.take.monocular is not None for case in cases)
    start = "fusion" if fused else "dlt"
    chosen = replace(options or Options(), paper_fields=dict(rules.paper_fields), paper_start=start)
    picked = select(names, cases, chosen)
    source = {
        "dataset": dataset.name,
        "detector": dataset.detector,
        "layout": dataset.layout.name,
        "protocol": rules.name,
    }
    store = None if folder is None else runs.Store(folder, source)
    solutions = runs.run(cases, dataset.layout, picked, chosen, store=store, report=report)
    return Evaluation(
        dataset=dataset,
        protocol=rules,
        cases=cases,
        headers=rules.headers(cases),
        options=chosen,
        settings={method.name: method.settings(chosen) for method in picked},
        scores=tuple(score(m.name, cases, solutions[m.name], dataset.layout, rules) for m in picked),
        published=published(dataset, rules),
    )


def select(names: Sequence[str], cases: Sequence[Case], options: Options) -> list[Method]:
    """Return the methods of these names, each once; none: all that the data allow and that render no pixels.

    Raises `InvalidInputError` for an unknown name, or if the data allow no method.
    """

    def allowed(method: Method) -> bool:
        given, settings = (case.given(method.over_time) for case in cases), method.settings(options)
        there = find_spec(method.package) is not None
        return there and all(method.lacks(take, settings) is None for take in given)

    every = [methods.get(name) for name in methods.names]
    if list(names) == ["all"]:
        return [method for method in every if not method.over_time or allowed(method)]
    if names:
        return [methods.get(name) for name in dict.fromkeys(names)]
    picked = [method for method in every if not method.by_pixels and allowed(method)]
    if not picked:
        raise InvalidInputError("methods: expected takes with detections or monocular poses, got neither")
    return picked


def overall(found: Evaluation) -> Table:
    """One row per method: errors, shares, time."""
    without = set() if found.protocol.parts else {"pcp"}
    if not found.rated:
        without.add("acceleration_m_s2")
    shown = {key: cell for key, cell in _OVERALL.items() if key not in without}
    rows = []
    for s in found.scores:
        figures = {key: factor * FIGURES[key](s) for key, (_, factor) in shown.items() if key != _INTERVAL}
        ends = interval(s.absolute.low, s.absolute.high)
        rows.append(Row(s.method, tuple(figures.get(key, ends) for key in shown)))
    if found.published is not None:
        columns = {"absolute_mm": found.published.absolute, "pcp": found.published.pcp}
        rows += found.published.rows([columns.get(key) for key in shown])
    title = f"{_subject(found)}: MPJPE in mm (absolute, root-relative, Procrustes), shares in %"
    columns_shown = tuple(column for column, _ in shown.values())
    return Table(title, "method", columns_shown, tuple(rows), notes(found))


def actions(found: Evaluation, metric: Metric = "absolute") -> Table:
    """One row per method, one column per action of the protocol and their average over poses."""
    share = 100.0 if metric == "pcp" else 1.0
    best: Literal["low", "high"] = "high" if metric == "pcp" else "low"
    columns = [Column(header, best=best) for header in (*found.headers.values(), "Avg")]
    rows = []
    for s in found.scores:
        values = [share * getattr(group, metric) for group in s.columns.values()]
        average = s.pcp if metric == "pcp" else getattr(s, metric).mean
        rows.append(Row(s.method, (*values, share * average)))
    others = found.published
    if others is not None and metric == "absolute" and set(found.headers) <= set(others.table.keys):
        rows += others.rows((*found.headers, others.absolute))
    kind = "actor" if found.protocol.parts else "action" if found.protocol.columns else "sequence"
    title = f"{_subject(found)}: {_TITLES[metric]}, per {kind}"
    return Table(title, "method", tuple(columns), tuple(rows))


def joints(found: Evaluation, metric: Literal["absolute", "relative"] = "absolute") -> Table:
    """One row per joint, one column per method."""
    columns = tuple(Column(s.method) for s in found.scores)
    rows = [
        Row(name, tuple(getattr(s.joints[name], metric) for s in found.scores))
        for name in found.dataset.layout.joints
    ]
    return Table(f"{_subject(found)}: {_TITLES[metric]}, per joint", "joint", columns, tuple(rows))


def notes(found: Evaluation) -> tuple[str, ...]:
    """Return what goes under the first table: data, protocol, settings, what the columns mean."""
    options, rules = found.options, found.protocol
    threads = options.n_threads or os.cpu_count() or 1
    lens = "removed from the detections" if options.undistort else "ignored, as the paper does (K alone)"
    rated = ""
    if found.rated:
        rates = sorted({f"{case.take.fps:g}" for case in found.cases if case.take.fps is not None})
        rated = (
            f"acc: mean error of the acceleration, m/s², of consecutive frames at {' or '.join(rates)} Hz. "
            "annealed-butterworth, annealed-kalman and over-time use all frames of a take, not across gaps."
        )
    real = ", on the real data set" if found.dataset.name in protocols.SIMULATED else ""
    return paragraphs(
        found.dataset,
        f"Protocol: {rules.text} {_counted(found)}",
        f"Lens distortion: {lens}. {_starts(found)}",
        "95 % CI: of abs, by bootstrap over takes. Joints without a position (missing, %) are in no "
        f"distance, and wrong in PCK. Time: the method alone, compiled methods on {threads} "
        f"thread{'s' * (threads != 1)}; no 2D detector or monocular estimator.",
        rated,
        "" if found.published is None else found.published.note(real),
    )


def _subject(found: Evaluation) -> str:
    views = ", ".join(map(str, sorted({len(case.take.rig) for case in found.cases})))
    return f"{found.dataset.name} ({found.dataset.detector or 'no detections'}), {views} views"


def _counted(found: Evaluation) -> str:
    first = found.scores[0]
    text = f"Poses: {first.absolute_poses} absolute, {first.poses} relative"
    expected = found.protocol.expected_poses
    if expected is not None and expected != (first.absolute_poses, first.poses):
        text += f" (the published evaluation has {expected[0]} and {expected[1]})"
    least = found.protocol.min_visible_views
    return f"{text}; joints seen by at least {least} views only." if least else f"{text}."


def _starts(found: Evaluation) -> str:
    starts = []
    for name, settings in found.settings.items():
        if "start" in settings:
            sigma = settings.get("init_sigma_mm")
            prior = "" if sigma is None else f" as a prior of {sigma:g} mm per axis"
            starts.append(f"{name} from {_STARTS[settings['start']]}{prior}")
    return f"Starts: {', '.join(starts)}." if starts else ""


def _lines(found: Evaluation) -> Iterator[dict[str, Any]]:
    """Yield the figures of each method and group; of reports the average and the actions."""
    for s in found.scores:
        own = {"method": s.method, "reported": 0}
        yield own | {"group": "all", "name": ""} | {key: read(s) for key, read in FIGURES.items()}
        for group, means in (("action", s.columns), ("joint", s.joints)):
            for name, g in means.items():
                errors = {f"{kind}_mm": getattr(g, kind) for kind in ("absolute", "relative", "procrustes")}
                yield own | {"group": group, "name": name, "poses": g.poses, "pcp": g.pcp} | errors
    others = found.published
    if others is None:
        return
    for row in others.table:
        own = {"method": others.name(row), "reported": 1}
        pcp = others.value(row, others.pcp)
        average = {"absolute_mm": others.value(row, others.absolute), "pcp": pcp and pcp / 100}
        yield own | {"group": "all", "name": ""} | average
        for key in found.headers:
            if key in others.table.keys:
                yield own | {"group": "action", "name": key, "absolute_mm": others.value(row, key)}


def _values(found: Evaluation) -> dict[str, Any]:
    rules, others = found.protocol, found.published
    return {
        "versions": versions(),
        "dataset": about_dataset(found.dataset),
        "protocol": {
            "name": rules.name,
            "text": rules.text,
            "undistort": found.options.undistort,
            "views": sorted({len(case.take.rig) for case in found.cases}),
            "every": rules.every,
            "min_visible_views": rules.min_visible_views,
            "takes": len(found.cases),
        },
        "columns": dict(found.headers),
        "settings": found.settings,
        "scores": [asdict(s) for s in found.scores],
        "reported": None if others is None else asdict(others.table),
    }


def _draw(found: Evaluation, path: Path) -> Path:
    from skelsplat import viz  # matplotlib takes long to load, and text does without

    table = overall(found)
    rows = [row for row in table.rows if row.cells[0] is not None]
    intervals = {s.method: (s.absolute.low, s.absolute.high) for s in found.scores}
    measured = np.array([row.origin == "measured" for row in rows])
    ends = np.array([intervals[row.name] if row.origin == "measured" else (np.nan, np.nan) for row in rows])
    real = " on the real data set" if found.dataset.name in protocols.SIMULATED else ""
    others = f" Grey: reported{real}, not measured here." if found.published else ""
    data = viz.BarData(
        names=tuple(row.name for row in rows),
        values=np.array([row.cells[0] for row in rows], dtype=np.float64),
        low=ends[:, 0],
        high=ends[:, 1],
        measured=measured,
        title=table.title.partition(":")[0],
        axis="absolute MPJPE, mm, with 95 % interval over takes",
        caption=f"{found.dataset.source or found.dataset.name}.{others}",
    )
    return viz.write_bars(path, data)

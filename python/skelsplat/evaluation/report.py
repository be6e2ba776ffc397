"""An evaluation from start to end: a data set and names of methods in, scores out.

>>> from skelsplat import datasets
>>> from skelsplat.evaluation import report, tables
>>> data = datasets.read("synthetic", "data/h36m-like")                                    # doctest: +SKIP
>>> print(tables.overall(report.evaluate(data, ["dlt", "annealed"])).markdown())          # doctest: +SKIP
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from skelsplat.datasets import Dataset
from skelsplat.evaluation import methods, protocols, runs
from skelsplat.evaluation.methods import Method, Options
from skelsplat.evaluation.protocols import Case, Protocol
from skelsplat.evaluation.reported import ReportedRow, ReportedTable, reported
from skelsplat.evaluation.scores import Scores, score
from skelsplat.exceptions import InvalidInputError


@dataclass(frozen=True, slots=True)
class Published:
    """A published table and its columns that can be compared."""

    table: ReportedTable
    #: absolute, pcp: Keys of the columns with the average absolute error, mm, and the PCP, %.
    absolute: str | None
    pcp: str | None = None

    def name(self, row: ReportedRow) -> str:
        """Name of a row, with its detector."""
        return row.method if row.detector is None else f"{row.method} ({row.detector})"

    def value(self, row: ReportedRow, key: str | None) -> float | None:
        """Return a row's number in a column that may not be there."""
        return row.value(key) if key is not None and key in self.table.keys else None


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
    def simulated(self) -> bool:
        """Whether no camera saw what was evaluated."""
        return self.dataset.name in protocols.SIMULATED


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
    chosen = replace(
        options or Options(), paper_fields=dict(rules.paper_fields), paper_start=start_of_paper(rules, cases)
    )
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

    Raises `InvalidInputError` for an unknown name, or the data allow no method.
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


def start_of_paper(protocol: Protocol, cases: Sequence[Case]) -> str:
    """Return where the paper's presets start: as in the paper, or by DLT if there are no monocular poses."""
    fused = protocol.paper_start == "fusion" and all(case.take.monocular is not None for case in cases)
    return "fusion" if fused else "dlt"


def occlusion_of(dataset: Dataset) -> str | None:
    """Return the variant of Human3.6M-Occ that a data set is; None if nothing says so."""
    variant = re.search(r"occ-(2|3-hard|3)\b", f"{dataset.name} {dataset.source}".lower())
    return variant[1] if variant else None


def published(dataset: Dataset, protocol: Protocol) -> Published | None:
    """Return the table that was published of this data set and number of views, if there is one."""
    n_views = len(dataset.takes[0].rig) if protocol.n_views is None else protocol.n_views
    if protocol.name == "human36m":
        return Published(reported("tab:h36m"), "average")
    if protocol.name == "human36m-occ":
        variant = occlusion_of(dataset)
        return Published(reported("tab:h36m-occ"), variant) if variant else None
    if protocol.name == "panoptic":
        if n_views == 4:
            return Published(reported("tab:cmu"), "average")
        return Published(reported("tab:abl-views"), str(n_views))
    if protocol.name == "occlusion-person":
        return Published(reported("tab:occ-pers"), str(n_views))
    if protocol.name in ("shelf", "campus"):
        return Published(reported(f"xrmocap:{protocol.name}"), "mpjpe", "pcp")
    return None

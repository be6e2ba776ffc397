"""Evaluation of methods that solve one person: a data set and names of methods in, scores and tables out.

>>> data = datasets.read("synthetic", "data/h36m-like")                                   # doctest: +SKIP
>>> print(single.evaluate(data, ["dlt", "annealed"]).report().markdown())                 # doctest: +SKIP
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.util import find_spec

from skelsplat import datasets
from skelsplat._skelsplat import Layout
from skelsplat.datasets import Dataset
from skelsplat.datasets._registry import options_of
from skelsplat.evaluation import methods, protocols
from skelsplat.evaluation.methods import Method, Options, Solution, Start
from skelsplat.evaluation.protocols import Case, Protocol
from skelsplat.evaluation.report import Evaluation, Figure, Figures, Heard
from skelsplat.evaluation.scores import PCK_MM, score
from skelsplat.evaluation.tables import Report, Table
from skelsplat.exceptions import InvalidInputError

_COLUMNS = {
    "absolute_mm": Figure("abs", best="low", title="Absolute MPJPE, mm"),
    "interval": Figure("95 % CI"),
    "relative_mm": Figure("rel", best="low", title="Root-relative MPJPE, mm"),
    "procrustes_mm": Figure("PA", best="low", title="PA-MPJPE, mm"),
    "every_joint_mm": Figure("all", best="low"),
    "offsets_out_mm": Figure("offsets out", best="low"),
    "median_mm": Figure("median", best="low"),
    **{f"pck_{mm}": Figure(f"PCK {mm}", best="high", factor=100) for mm in PCK_MM},
    "pcp": Figure("PCP", best="high", title="PCP, %", factor=100),
    "missing": Figure("missing", digits=2, factor=100),
    "acceleration_m_s2": Figure("acc", best="low"),
    "ms_per_pose": Figure("ms/pose", digits=2),
}
CSV_FIELDS = (
    *("method", "reported", "group", "name", "poses", "absolute_mm", "absolute_low_mm", "absolute_high_mm"),
    *(key for key in _COLUMNS if key not in ("absolute_mm", "interval")),
)
"""Columns of the CSV: ``group`` is all, action or joint; shares are from 0 to 1; empty means no number."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Single(Evaluation):
    """What `evaluate` found."""

    cases: tuple[Case, ...]
    options: Options
    left_out: Mapping[str, str]  #: methods that were to run if the data allow, and what they lack

    def report(self) -> Report:
        """Return tables and figures; printed are those of methods and actions."""
        pcp = ["pcp"] * bool(self.protocol.parts)
        several = len({case.column for case in self.cases}) > 1
        kinds = ["absolute_mm", *pcp, "relative_mm", "procrustes_mm"] if several else []
        kind = "actor" if self.protocol.parts else "action" if self.protocol.columns else "sequence"
        return Report(
            title=self.dataset.name,
            tables=(
                self.methods_table(),
                *(self.by("action", key, kind, "Avg") for key in kinds),
                *(self.by("joint", key, "joint").turned("joint") for key in ("absolute_mm", "relative_mm")),
            ),
            shown=1 + several * (1 + len(pcp)),
            fields=CSV_FIELDS,
            rows=[*({"reported": 0, **line} for line in self.lines), *self._reported()],
            values=self.values(
                protocol={
                    "undistort": self.options.undistort,
                    "views": sorted({len(case.take.rig) for case in self.cases}),
                    "every": self.protocol.every,
                    "takes": len(self.cases),
                },
                columns=self.protocol.headers(self.cases),
                reported=None if self.published is None else asdict(self.published.table),
            ),
        )

    def methods_table(self) -> Table:
        """One row per method: errors, shares, time; and under it what the columns mean."""
        real = ", on the real data set" if self.dataset.name in protocols.SIMULATED else ""
        threads = self.options.n_threads or os.cpu_count() or 1
        lens = "removed from the detections" if self.options.undistort else "ignored, as the paper does"
        rates = sorted({f"{case.take.fps:g}" for case in self.cases if case.take.fps is not None})
        return self.overall(
            "MPJPE in mm (absolute, root-relative, Procrustes), shares in %",
            f"Protocol: {self.protocol.text} {self._counted()}",
            f"Lens distortion: {lens}.",
            "95 % CI: of abs, by bootstrap over takes. Joints without a position (missing, %) are in no "
            f"distance, and wrong in PCK. Time: the method alone, compiled methods on {threads} "
            f"thread{'s' * (threads != 1)}; no 2D detector or monocular estimator.",
            f"acc: mean error of the acceleration, m/s², of consecutive frames at {' or '.join(rates)} Hz. "
            "annealed-butterworth and over-time use all frames of a take, not across gaps."
            if "acceleration_m_s2" in self.columns
            else "",
            "" if self.published is None else self.published.note(real),
            *(f"Not run: {method}, which needs {lacking}." for method, lacking in self.left_out.items()),
        )

    def _counted(self) -> str:
        figures = self.figures(self.methods[0])
        found = figures["absolute_poses"], figures["poses"]
        text = f"Poses: {found[0]} absolute, {found[1]} relative"
        expected = self.protocol.expected_poses
        if expected is not None and expected != found:
            text += f" (the published evaluation has {expected[0]} and {expected[1]})"
        return f"{text}."

    def _reported(self) -> Iterator[Figures]:
        """Yield of each published row its average and the actions."""
        for row in self.published.table.rows if self.published is not None else ():
            own = {"method": row.name, "reported": 1}
            absolute, pcp = row.cells([self._published("absolute_mm"), self._published("pcp")])
            yield {**own, "group": "all", "absolute_mm": absolute, "pcp": pcp and pcp / 100}
            for key in self.protocol.headers(self.cases):
                if key in row.keys:
                    yield {**own, "group": "action", "name": key, "absolute_mm": row.cells([key])[0]}


def evaluate(
    dataset: Dataset,
    names: Sequence[str] = (),
    options: Options | None = None,
    *,
    protocol: Protocol | None = None,
    report: Heard | None = None,
) -> Single:
    """Run methods on a data set and score them.

    `names` are as of `select`; of the `options` those of the paper are filled in from the protocol, by
    default that of the data set's name. Raises `InvalidInputError` for an unknown method, or if there is
    nothing to evaluate, `DatasetError` if a take lacks what a method needs, before any work.
    """
    rules = protocols.get(dataset.name) if protocol is None else protocol
    cases = rules.cases(dataset)
    # As in the paper, or by DLT if there are no monocular poses.
    fused = rules.paper_start == "fusion" and all(case.take.monocular is not None for case in cases)
    start: Start = "fusion" if fused else "dlt"
    chosen = replace(options or Options(), paper_fields=dict(rules.paper_fields), paper_start=start)
    picked, left_out = select(names, cases, chosen)
    ways = options_of(dataset.name) if dataset.name in datasets.names() else ()
    for method in picked:
        for case in cases:
            method.check(case.given(method.over_time), method.settings(chosen), ways)
    lines: list[Figures] = []
    for k, method in enumerate(picked):
        solved = _solve(method, cases, dataset.layout, chosen, (k, len(picked)), report)
        lines += score(method.name, cases, solved, dataset.layout, rules)
    rated = any(math.isfinite(line.get("acceleration_m_s2", math.nan)) for line in lines)
    some = dict.fromkeys(("every_joint_mm", "offsets_out_mm"), bool(rules.joints))
    known = {"pcp": bool(rules.parts), "acceleration_m_s2": rated, **some}
    views = ", ".join(map(str, sorted({len(case.take.rig) for case in cases})))
    return Single(
        dataset=dataset,
        protocol=rules,
        settings={method.name: method.settings(chosen) for method in picked},
        subject=f"{dataset.name} ({dataset.detector or 'no detections'}), {views} views",
        lines=tuple(lines),
        columns={key: figure for key, figure in _COLUMNS.items() if known.get(key, True)},
        cases=cases,
        options=chosen,
        left_out=left_out,
    )


def _solve(
    method: Method,
    cases: Sequence[Case],
    layout: Layout,
    options: Options,
    place: tuple[int, int],
    report: Heard | None,
) -> list[Solution]:
    """Return the poses that count in every case; `place` is that of the method among how many."""
    per_method, settings = sum(len(case.take) for case in cases), method.settings(options)
    solutions, done = [], place[0] * per_method
    for case in cases:

        def told(now: int, _: int = 0, case: Case = case, done: int = done) -> None:
            if report is not None:
                report(method.name, case.take.key, done + now, place[1] * per_method)

        told(0)
        whole = case.given(method.over_time)
        found = method.solve(whole, layout, settings, told if method.by_pixels else None)
        if whole is not case.take:
            found = Solution(found.pose[case.rows], len(case.take) / len(whole) * found.seconds)
        solutions.append(found)
        done += len(case.take)
    return solutions


def select(
    names: Sequence[str], cases: Sequence[Case], options: Options
) -> tuple[list[Method], dict[str, str]]:
    """Return the methods of these names, each once, and those left out, with what they lack.

    ``"all"`` alone: all that the data allow; no names: all of them but those that render pixels. Raises
    `InvalidInputError` for an unknown name, or if nothing is left.
    """
    if names and list(names) != ["all"]:
        return [methods.get(name) for name in dict.fromkeys(names)], {}
    wanted = [one for one in map(methods.get, methods.names) if names or not one.by_pixels]
    lacking = {one.name: _lacking(one, cases, options) for one in wanted}
    picked = [one for one in wanted if lacking[one.name] is None]
    if not picked:
        raise InvalidInputError("methods: expected takes with detections or monocular poses, got neither")
    return picked, {name: words for name, words in lacking.items() if words is not None}


def _lacking(method: Method, cases: Sequence[Case], options: Options) -> str | None:
    """Return what a method needs and does not have, in words."""
    if find_spec(method.package) is None:
        return f"the package {method.package}"
    settings = method.settings(options)
    fields = (method.lacks(case.given(method.over_time), settings) for case in cases)
    return next((methods.FIELDS[field] for field in fields if field is not None), None)

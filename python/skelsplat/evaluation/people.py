"""Evaluation of several people without oracle association: who is found, how well, under how many names.

>>> from skelsplat.evaluation import people
>>> people.names
('track', 'affinity', 'oracle')
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skelsplat._arrays import Mask
from skelsplat._people import track
from skelsplat._sequence import refine_sequence
from skelsplat._skelsplat import Layout, RefineConfig
from skelsplat.datasets import Dataset, PeopleTake
from skelsplat.evaluation import protocols
from skelsplat.evaluation.baselines import affinity
from skelsplat.evaluation.methods import Options, stretches, without_lens
from skelsplat.evaluation.people_scores import Tally, Tracks
from skelsplat.evaluation.protocols import Protocol
from skelsplat.evaluation.published import Published, published
from skelsplat.evaluation.report import Report, about_dataset, paragraphs, versions
from skelsplat.evaluation.runs import Report as Heard
from skelsplat.evaluation.tables import Cell, Column, Row, Table, interval
from skelsplat.exceptions import DatasetError, one_of
from skelsplat.io import convert_unit


def _track(scene: PeopleTake, layout: Layout, config: RefineConfig) -> Tracks:
    found = track(scene.people, scene.rig, fps=scene.fps, layout=layout, config=config)
    mm = scene.rig.mm_per_unit
    return [(one.id, one.frames, mm * one.refinement.pose) for one in found]


def _oracle(scene: PeopleTake, layout: Layout, config: RefineConfig) -> Tracks:
    """Solve every person from the detections that are theirs, where two views have them."""
    out = []
    for q, detections in enumerate(scene.detections()):
        (frames,) = np.nonzero((scene.slots[q] >= 0).sum(axis=-1) >= 2)
        if len(frames):
            solved = refine_sequence(detections, scene.rig, fps=scene.fps, layout=layout, config=config)
            out.append((q, frames, scene.rig.mm_per_unit * solved.pose[frames]))
    return out


def _affinity(scene: PeopleTake, *_: object) -> Tracks:
    return affinity.track(scene.people, convert_unit(scene.rig, "mm"), fps=scene.fps)


METHODS: Mapping[str, Callable[[PeopleTake, Layout, RefineConfig], Tracks]] = {
    "track": _track,  # skelsplat.track
    "affinity": _affinity,  # affinity of rays, greedy groups, DLT, nearest neighbour
    "oracle": _oracle,  # over time, with detections associated by the ground truth
}
"""By name, what makes tracks of a scene: frames are places in the take, poses in mm."""

names: tuple[str, ...] = tuple(METHODS)

# Columns of the table of methods by figure, and by what the figure is multiplied.
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


@dataclass(frozen=True, slots=True, eq=False)
class PeopleCase:
    """Consecutive frames of a scene, and which of them count."""

    scene: PeopleTake
    judged: Mask  # (T,)


@dataclass(frozen=True, kw_only=True, eq=False)
class PeopleEvaluation:
    """What `evaluate` found."""

    dataset: Dataset
    protocol: Protocol
    cases: tuple[PeopleCase, ...]
    settings: Mapping[str, Mapping[str, Any]]
    tallies: Mapping[str, Tally]  #: by method, in the order asked for
    published: Published | None

    def figures(self, method: str, scene: str | None = None) -> dict[str, float]:
        """Return the figures of a method, over all scenes or of one; the reference is `oracle`."""
        reference = None if method == "oracle" else self.tallies.get("oracle")
        return self.tallies[method].figures(reference, scene)

    def report(self) -> Report:
        """Return tables and figures; printed are that of methods and the first by person."""
        figures = ("pcp", "mean_mm", "recall") if self.protocol.parts else ("mean_mm", "recall")
        return Report(
            title=self.dataset.name,
            tables=(overall(self), *(persons(self, figure) for figure in figures)),
            shown=2,
            fields=CSV_FIELDS,
            rows=tuple({key: row[key] for key in CSV_FIELDS if key in row} for row in _lines(self)),
            values=_values(self),
        )


def cases(dataset: Dataset, protocol: Protocol) -> tuple[PeopleCase, ...]:
    """Cut the scenes into stretches of consecutive frames, of which some count.

    Raises `DatasetError` if the data set has no detections of several people, or no frame counts.
    """
    if not dataset.scenes:
        expected = "detections of everybody in view, in any order (docs/howto/evaluation.md)"
        raise DatasetError(dataset.name, "people", expected, "none, or those of one person each")
    found = []
    for scene in dataset.scenes:
        keep = protocol.counted(scene.frames)
        parts = [part for part in stretches(scene.frames) if keep[part].any()]
        for k, part in enumerate(parts):
            key = scene.key if len(parts) == 1 else f"{scene.key}, part {k + 1}"
            found.append(PeopleCase(replace(scene.select(part), key=key), keep[part]))
    if not found:
        raise DatasetError(dataset.name, "frames", f"frames for the protocol {protocol.name}", "none")
    return tuple(found)


def evaluate(
    dataset: Dataset,
    chosen: Sequence[str] = (),
    options: Options | None = None,
    *,
    protocol: Protocol | None = None,
    report: Heard | None = None,
) -> PeopleEvaluation:
    """Run methods on the scenes of a data set and score them.

    Parameters
    ----------
    dataset : Dataset
    chosen : sequence of str
        Of `names`; none: all.
    options : Options, optional
        `undistort` and `n_threads` apply.
    protocol : Protocol, optional
        Default: that of the data set's name.
    report : callable, optional
        Called with method, scene, frames done so far, and frames in all (of all methods).

    Raises `InvalidInputError` for an unknown method, `DatasetError` without detections of several people.
    """
    options = options or Options()
    rules = protocols.get(dataset.name) if protocol is None else protocol
    picked = list(dict.fromkeys(chosen or names))
    for name in picked:
        one_of("methods", name, names)
    parts, config = cases(dataset, rules), RefineConfig(n_threads=options.n_threads)
    total, done = len(picked) * sum(len(case.scene) for case in parts), 0
    tallies = {name: Tally() for name in picked}
    for name in picked:
        for case in parts:
            if report is not None:
                report(name, case.scene.key, done, total)
            lens = case.scene.rig if options.undistort else without_lens(case.scene.rig)
            seen = replace(case, scene=replace(case.scene, rig=lens))
            _score(tallies[name], name, seen, dataset.layout, config, rules)
            done += len(case.scene)
    shared = {"undistort": options.undistort}
    solver = {**shared, "config": config.to_dict()}
    return PeopleEvaluation(
        dataset=dataset,
        protocol=rules,
        cases=parts,
        settings={name: shared if name == "affinity" else solver for name in picked},
        tallies=tallies,
        published=published(dataset, rules),
    )


def _score(
    tally: Tally, name: str, case: PeopleCase, layout: Layout, config: RefineConfig, rules: Protocol
) -> None:
    scene = case.scene
    begun = time.perf_counter()
    tracks = METHODS[name](scene, layout, config)
    seconds = time.perf_counter() - begun
    place = np.where(case.judged, np.cumsum(case.judged) - 1, -1)  # among the frames that count
    judged = [(who, place[frames], pose) for who, frames, pose in tracks]
    tally.add(
        scene.key,
        [(who, frames[frames >= 0], pose[frames >= 0]) for who, frames, pose in judged],
        scene.rig.mm_per_unit * scene.truth[:, case.judged],
        scene.optional(rules.least_views)[:, case.judged],
        seconds * float(case.judged.mean()),
        fps=scene.fps,
        names=scene.names,
        parts=rules.parts or None,
    )


def overall(found: PeopleEvaluation) -> Table:
    """One row per method."""
    rows = []
    for method in found.tallies:
        figures = found.figures(method)
        cells: dict[str, Cell] = {k: f * figures[k] for k, (_, f) in _COLUMNS.items() if k != "interval"}
        cells["change"] = round(100 * figures["change"], 1) + 0.0  # never −0.0
        cells["interval"] = interval(figures["mean_low_mm"], figures["mean_high_mm"])
        rows.append(Row(method, tuple(cells[key] for key in _COLUMNS)))
    if found.published is not None:
        columns = {"mean_mm": found.published.absolute, "pcp": found.published.pcp}
        rows += found.published.rows([columns.get(key) for key in _COLUMNS])
    title = f"{_subject(found)}: precision, recall, PCP and IDF1 in %, MPJPE in mm"
    return Table(title, "method", tuple(c for c, _ in _COLUMNS.values()), tuple(rows), notes(found))


def persons(found: PeopleEvaluation, figure: str) -> Table:
    """One row per method, one column per person, of PCP, recall (%) or mean error (mm)."""
    column, factor = _COLUMNS[figure]
    tables = {method: tally.people() for method, tally in found.tallies.items()}
    people = list(dict.fromkeys(name for table in tables.values() for name in table))
    headers = [found.protocol.columns.get(name, name) for name in people]
    rows = []
    for method, table in tables.items():
        values = [factor * table[name][figure] if name in table else None for name in people]
        rows.append(Row(method, (*values, factor * found.figures(method)[figure])))
    title = f"{_subject(found)}: {column.header}, {'mm' if factor == 1 else '%'}, per person"
    columns = tuple(Column(header, best=column.best) for header in (*headers, "all"))
    return Table(title, "method", columns, tuple(rows))


def notes(found: PeopleEvaluation) -> tuple[str, ...]:
    """Return what goes under the first table: data, protocol, what the columns mean."""
    least = found.protocol.least_views
    several = (
        "" if least else " People without a truth in a frame may be real; whoever finds them loses precision."
    )
    return paragraphs(
        found.dataset,
        "Who is who is not given, except to oracle, which takes the detections that the ground truth "
        "associates with each person.",
        f"Protocol: {found.protocol.text} Estimates are assigned to people frame by frame, up to 500 mm "
        f"of mean joint distance; MPJPE is of the assigned ones.{several}",
        "IDS, frag: identity switches and fragmentations (CLEAR MOT), in all scenes; clean: scenes without "
        "a switch, %; swap: scenes in which one identity follows two people for half a second each, %. "
        "vs. oracle: change of MPJPE, %, where both methods have a person and neither confuses them. "
        "95 % CI: of MPJPE, by bootstrap over scenes. Time: the method alone.",
        "" if found.published is None else found.published.note(),
    )


def _subject(found: PeopleEvaluation) -> str:
    data, scenes = found.dataset, found.cases
    views = sorted({len(case.scene.rig) for case in scenes})
    each = f"{', '.join(map(str, views))} view{'s' * (views != [1])}"
    count = f"{len(scenes)} scene{'s' * (len(scenes) != 1)}"
    return f"{data.name} ({data.detector or 'no detections'}), {each}, {count}"


def _lines(found: PeopleEvaluation) -> Iterator[dict[str, Any]]:
    """Yield the figures of each method, over all and of each scene and person."""
    for method, tally in found.tallies.items():
        groups = {("all", ""): found.figures(method)}
        groups |= {("scene", key): found.figures(method, key) for key in tally.scenes}
        groups |= {("person", name): figures for name, figures in tally.people().items()}
        for (group, name), figures in groups.items():
            yield {"method": method, "group": group, "name": name, **figures}


def _values(found: PeopleEvaluation) -> dict[str, Any]:
    rules = found.protocol
    return {
        "versions": versions(),
        "dataset": about_dataset(found.dataset),
        "protocol": {"name": rules.name, "text": rules.text, "least_views": rules.least_views},
        "settings": found.settings,
        "scenes": [
            {
                "key": case.scene.key,
                "frames": int(case.judged.sum()),
                "people": list(case.scene.names),
                "views": len(case.scene.rig),
            }
            for case in found.cases
        ],
        "figures": list(_lines(found)),
    }

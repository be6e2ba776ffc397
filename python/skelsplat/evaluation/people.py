"""Evaluation of several people without oracle association: who is found, how well, under how many names.

>>> from skelsplat.evaluation import people
>>> people.names
('track', 'affinity', 'oracle')
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

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
from skelsplat.evaluation.report import Evaluation, Figure, Figures
from skelsplat.evaluation.reported import published
from skelsplat.evaluation.runs import Report as Heard
from skelsplat.evaluation.tables import Report, Table
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

_COLUMNS = {
    "precision": Figure("prec.", best="high", factor=100),
    "recall": Figure("rec.", best="high", title="recall, %", factor=100),
    "mean_mm": Figure("MPJPE", best="low", title="MPJPE, mm"),
    "interval": Figure("95 % CI"),
    "pcp": Figure("PCP", best="high", title="PCP, %", factor=100),
    "idf1": Figure("IDF1", best="high", factor=100),
    "identity_switches": Figure("IDS", 0),
    "fragmentations": Figure("frag", 0),
    "scenes_clean": Figure("clean", 0, factor=100),
    "scenes_swapped": Figure("swap", 0, factor=100),
    "change": Figure("vs. oracle", factor=100),
    "ms_per_frame": Figure("ms/frame", 2),
}
CSV_FIELDS = ("method", "group", "name", *(key for key in _COLUMNS if key != "interval"), "person_frames")
"""Columns of the CSV: ``group`` is all, scene or person; shares are from 0 to 1; empty means no number."""


PeopleCase = tuple[PeopleTake, Mask]
"""Consecutive frames of a scene, and which of them (T,) count."""


@dataclass(frozen=True, kw_only=True, eq=False)
class People(Evaluation):
    """What `evaluate` found."""

    cases: tuple[PeopleCase, ...]

    def report(self) -> Report:
        """Return tables and figures; printed are that of methods and the first by person."""
        figures = ("pcp", "mean_mm", "recall") if self.protocol.parts else ("mean_mm", "recall")
        scenes = [
            {"key": scene.key, "frames": int(judged.sum()), "people": scene.names, "views": len(scene.rig)}
            for scene, judged in self.cases
        ]
        return Report(
            title=self.dataset.name,
            tables=(self.methods_table(), *(self.by("person", key, "person", "all") for key in figures)),
            shown=2,
            fields=CSV_FIELDS,
            rows=self.lines,
            values=self.values(protocol={"least_views": self.protocol.least_views}, scenes=scenes),
        )

    def methods_table(self) -> Table:
        """One row per method, and under it what the columns mean."""
        extra = "" if self.protocol.least_views else " Who finds people without a truth loses precision."
        return self.overall(
            "precision, recall, PCP and IDF1 in %, MPJPE in mm",
            "Who is who is not given, except to oracle, which takes the detections that the ground truth "
            "associates with each person.",
            f"Protocol: {self.protocol.text} Estimates are assigned to people frame by frame, up to 500 mm "
            f"of mean joint distance; MPJPE is of the assigned ones.{extra}",
            "IDS, frag: identity switches and fragmentations (CLEAR MOT), in all scenes; clean: scenes "
            "without a switch, %; swap: scenes in which one identity follows two people for half a second "
            "each, %. vs. oracle: change of MPJPE, %, where both methods have a person and neither confuses "
            "them. 95 % CI: of MPJPE, by bootstrap over scenes. Time: the method alone.",
            "" if self.published is None else self.published.note(),
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
            found.append((replace(scene.select(part), key=key), keep[part]))
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
) -> People:
    """Run methods, by default all, on the scenes of a data set and score them.

    Of the `options` `undistort` and `n_threads` apply; the default protocol is that of the data set's name.

    Raises `InvalidInputError` for an unknown method, `DatasetError` without detections of several people.
    """
    options = options or Options()
    rules = protocols.get(dataset.name) if protocol is None else protocol
    picked = list(dict.fromkeys(chosen or names))
    for name in picked:
        one_of("methods", name, names)
    parts, config = cases(dataset, rules), RefineConfig(n_threads=options.n_threads)
    total, done = len(picked) * sum(len(scene) for scene, _ in parts), 0
    tallies = {name: Tally() for name in picked}
    for name in picked:
        for scene, judged in parts:
            if report is not None:
                report(name, scene.key, done, total)
            seen = scene if options.undistort else replace(scene, rig=without_lens(scene.rig))
            _score(tallies[name], name, seen, judged, dataset.layout, config, rules)
            done += len(scene)
    views = sorted({len(scene.rig) for scene, _ in parts})
    count = f"{len(parts)} scene{'s' * (len(parts) != 1)}"
    shared = {"undistort": options.undistort}
    solver = {**shared, "config": config.to_dict()}
    return People(
        dataset=dataset,
        protocol=rules,
        settings={name: shared if name == "affinity" else solver for name in picked},
        subject=f"{dataset.name} ({dataset.detector or 'no detections'}), "
        f"{', '.join(map(str, views))} view{'s' * (views != [1])}, {count}",
        lines=tuple(_lines(tallies)),
        columns=_COLUMNS,
        published=published(dataset, rules),
        cases=parts,
    )


def _score(
    tally: Tally,
    name: str,
    scene: PeopleTake,
    judged: Mask,
    layout: Layout,
    config: RefineConfig,
    rules: Protocol,
) -> None:
    begun = time.perf_counter()
    tracks = METHODS[name](scene, layout, config)
    seconds = time.perf_counter() - begun
    place = np.where(judged, np.cumsum(judged) - 1, -1)  # among the frames that count
    tally.add(
        scene.key,
        [(who, place[frames][judged[frames]], pose[judged[frames]]) for who, frames, pose in tracks],
        scene.rig.mm_per_unit * scene.truth[:, judged],
        scene.optional(rules.least_views)[:, judged],
        seconds * float(judged.mean()),
        fps=scene.fps,
        names=scene.names,
        parts=rules.parts or None,
    )


def _lines(tallies: Mapping[str, Tally]) -> Iterator[Figures]:
    """Yield the figures of each method, over all and of each scene and person."""
    for method, tally in tallies.items():
        reference = None if method == "oracle" else tallies.get("oracle")
        groups = {("all", ""): tally.figures(reference)}
        groups |= {("scene", key): tally.figures(reference, key) for key in tally.scenes}
        groups |= {("person", name): figures for name, figures in tally.people().items()}
        for (group, name), figures in groups.items():
            yield {"method": method, "group": group, "name": name, **figures}

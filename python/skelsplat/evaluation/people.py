"""Evaluation of several people without oracle association: who is found, how well, under how many names.

>>> from skelsplat.evaluation import people
>>> people.names
('track', 'affinity', 'oracle')
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skelsplat._arrays import Mask
from skelsplat._people import track
from skelsplat._sequence import refine_sequence
from skelsplat._skelsplat import Layout, RefineConfig
from skelsplat.datasets import Dataset, PeopleTake
from skelsplat.evaluation import over_time, protocols
from skelsplat.evaluation.baselines import affinity
from skelsplat.evaluation.methods import Options, without_lens
from skelsplat.evaluation.people_scores import Tally, Tracks
from skelsplat.evaluation.protocols import Protocol
from skelsplat.evaluation.report import Published, published
from skelsplat.exceptions import DatasetError, one_of
from skelsplat.io import convert_unit

Report = Callable[[str, str, int, int], None]


@dataclass(frozen=True)
class PeopleMethod:
    """A method that takes detections of several people in any order."""

    name: str
    about: str
    run: Callable[[PeopleTake, Layout, RefineConfig], Tracks]  #: frames are places in the take, poses in mm


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


_ALL = (
    PeopleMethod("track", "skelsplat.track", _track),
    PeopleMethod("affinity", "affinity of rays, greedy groups, DLT, nearest neighbour", _affinity),
    PeopleMethod("oracle", "over time, with detections associated by the ground truth", _oracle),
)
_BY_NAME = {method.name: method for method in _ALL}

names: tuple[str, ...] = tuple(_BY_NAME)


def get(name: str) -> PeopleMethod:
    """Return a method; raises `InvalidInputError` if there is none of that name."""
    one_of("methods", name, names)
    return _BY_NAME[name]


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
        parts = [part for part in over_time.stretches(scene.frames) if keep[part].any()]
        for k, part in enumerate(parts):
            own = scene.select(part)
            key = scene.key if len(parts) == 1 else f"{scene.key}, part {k + 1}"
            found.append(PeopleCase(replace(own, key=key), keep[part]))
    if not found:
        raise DatasetError(dataset.name, "frames", f"frames for the protocol {protocol.name}", "none")
    return tuple(found)


def evaluate(
    dataset: Dataset,
    chosen: Sequence[str] = (),
    options: Options | None = None,
    *,
    protocol: Protocol | None = None,
    report: Report | None = None,
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

    Raises
    ------
    InvalidInputError
        An unknown method.
    DatasetError
        Without detections of several people.
    """
    options = options or Options()
    rules = protocols.get(dataset.name) if protocol is None else protocol
    picked = [get(name) for name in dict.fromkeys(chosen or names)]
    parts, config = cases(dataset, rules), RefineConfig(n_threads=options.n_threads)
    total, done = len(picked) * sum(len(case.scene) for case in parts), 0
    tallies = {method.name: Tally() for method in picked}
    for method in picked:
        for case in parts:
            if report is not None:
                report(method.name, case.scene.key, done, total)
            _score(tallies[method.name], method, case, dataset.layout, config, rules, options.undistort)
            done += len(case.scene)
    shared = {"undistort": options.undistort}
    solver = {**shared, "config": config.to_dict()}
    return PeopleEvaluation(
        dataset=dataset,
        protocol=rules,
        cases=parts,
        settings={method.name: shared if method.name == "affinity" else solver for method in picked},
        tallies=tallies,
        published=published(dataset, rules),
    )


def _score(
    tally: Tally,
    method: PeopleMethod,
    case: PeopleCase,
    layout: Layout,
    config: RefineConfig,
    rules: Protocol,
    undistort: bool,
) -> None:
    scene = case.scene if undistort else replace(case.scene, rig=without_lens(case.scene.rig))
    begun = time.perf_counter()
    tracks = method.run(scene, layout, config)
    seconds = time.perf_counter() - begun
    place = np.where(case.judged, np.cumsum(case.judged) - 1, -1)  # among the frames that count
    judged = [(name, place[frames], pose) for name, frames, pose in tracks]
    tally.add(
        scene.key,
        [(name, frames[frames >= 0], pose[frames >= 0]) for name, frames, pose in judged],
        scene.rig.mm_per_unit * scene.truth[:, case.judged],
        scene.optional(rules.least_views)[:, case.judged],
        seconds * float(case.judged.mean()),
        fps=scene.fps,
        names=scene.names,
        parts=rules.parts or None,
    )

"""The poses on which settings are compared, where they come from, and the two methods run on them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index, positive
from skelsplat.datasets import Dataset, Take
from skelsplat.datasets.synthetic import take_of
from skelsplat.evaluation import protocols
from skelsplat.evaluation.methods import DEFAULT_INIT_SIGMA_MM, refined, starting_poses, without_lens
from skelsplat.evaluation.protocols import Protocol
from skelsplat.exceptions import InvalidInputError
from skelsplat.synthetic import simulate_set

PAPER, ANNEALED = "paper", "annealed"

Start = Literal["dlt", "fusion"]
Kind = Literal["plain", "noisy", "occ-2", "occ-3", "dome"]

# Simulated sets, and their detectors.
_SETS: dict[Kind, tuple[str, str]] = {
    "plain": ("human36m-like", "good"),
    "noisy": ("human36m-like", "noisy"),
    "occ-2": ("human36m-like-occ-2", "good"),
    "occ-3": ("human36m-like-occ-3", "good"),
    "dome": ("dome", "good"),
}


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Poses of one data set with the detections of one detector."""

    name: str  # short, for rows of a table: ``"H36M, metrabs"``
    layout: sk.Layout
    groups: tuple[Take, ...]  # poses that the same cameras see: frames of takes, one after the other
    n_available: int  # poses that the data set has
    # What the paper changes in its settings on this data set.
    paper_fields: Mapping[str, Any] = field(default_factory=dict)

    @property
    def n_poses(self) -> int:
        """Number of poses."""
        return sum(map(len, self.groups))

    @property
    def n_views(self) -> int:
        """The least number of cameras of any rig."""
        return min(len(group.rig) for group in self.groups)

    @property
    def has_monocular(self) -> bool:
        """Whether all poses come with monocular estimates."""
        return all(group.monocular is not None for group in self.groups)

    def starts(self, kind: Start) -> list[Array]:
        """Return the initial poses of every group."""
        return [starting_poses(group, kind) for group in self.groups]

    def first_views(self, count: int) -> Sample:
        """Return the sample with the first `count` cameras of every rig, the only ones to estimate poses."""
        return replace(self, groups=tuple(group.with_views(range(count)) for group in self.groups))

    def head(self, poses: int) -> Sample:
        """Return about `poses` poses, evenly from all takes."""
        share = poses / max(self.n_poses, 1)
        counts = [min(max(1, round(share * len(group))), len(group)) for group in self.groups]
        some = (
            group.select(_evenly(len(group), count)) for group, count in zip(self.groups, counts, strict=True)
        )
        return replace(self, groups=tuple(some))


def sample(
    dataset: Dataset, protocol: Protocol, poses: int | None, *, name: str, undistort: bool = True
) -> Sample:
    """Take `poses` poses of a data set (None: all), evenly over the takes that its protocol counts.

    Without `undistort` cameras lose their lens, so that detections are used with K alone.
    """
    takes = [case.take for case in protocol.cases(dataset) if case.absolute]
    total = sum(len(take) for take in takes)
    if total == 0:
        raise InvalidInputError(f"{dataset.name}: expected poses whose absolute error counts, got none")
    chosen = np.arange(total) if poses is None or poses >= total else _evenly(total, poses)
    parts: list[list[Take]] = []  # of takes with the same cameras
    first = 0
    for take in takes:
        here = chosen[(chosen >= first) & (chosen < first + len(take))] - first
        first += len(take)
        if len(here) == 0:
            continue
        if take.detections is None:
            raise InvalidInputError(f"{take.key}: expected detections, got a data set read without")
        same = next((part for part in parts if part[0].rig == take.rig), None)
        if same is None:
            parts.append(same := [])
        same.append(take.select(here))
    groups = [_joined(part) for part in parts]
    if not undistort:
        groups = [replace(group, rig=without_lens(group.rig)) for group in groups]
    return Sample(name, dataset.layout, tuple(groups), total, protocol.paper_fields)


def _evenly(total: int, count: int) -> Index:
    return ((np.arange(count) + 0.5) * total / count).astype(np.int64)


def _joined(takes: Sequence[Take]) -> Take:
    """Return the frames of takes as one take."""
    names = ("frames", "truth", "detections", "monocular")
    values = {name: [getattr(take, name) for take in takes] for name in names}
    known: dict[str, Any] = {
        name: None if any(part is None for part in parts) else np.concatenate(parts)
        for name, parts in values.items()
    }
    return Take(takes[0].key, takes[0].subject, takes[0].action, takes[0].rig, **known)


@dataclass(frozen=True, slots=True)
class Errors:
    """What one setting gives."""

    mpjpe: float  # mean over joints and poses, mm
    steps: float = float("nan")  # mean number of optimisation steps; NaN if nothing was optimised


def errors_of(sample: Sample, poses: Sequence[Array], steps: float = float("nan")) -> Errors:
    """Return the errors of predicted `poses`, one array (P, N, 3) per group of the sample."""
    joints = [
        group.rig.mm_per_unit * np.linalg.norm(pose - group.truth, axis=-1)
        for group, pose in zip(sample.groups, poses, strict=True)
    ]
    return Errors(float(np.nanmean(np.concatenate(joints))), steps)


@dataclass(kw_only=True, eq=False)
class Source:
    """Samples for the experiments, as a user chooses them, and the two methods.

    Without `data` samples are simulated in memory from the seed; no camera saw what is in them.
    """

    poses: int | None = None  # how many poses of each data set; None: all
    seed: int = 0  # of simulated data and of noise on the start
    # Initial poses; "paper": as in the paper's experiment, if the data have what it needs.
    start: Literal["paper", "dlt", "fusion"] = "paper"
    # Standard deviation per axis of the fused start where it enters as a prior.
    init_sigma_mm: float = DEFAULT_INIT_SIGMA_MM
    undistort: bool = True  # whether to take lens distortion out; the paper does not
    data: Sequence[Dataset] = ()  # taken whatever an ablation asks for, one sample each
    # Called with what is being measured, poses done and poses in all.
    progress: Callable[[str, int, int], None] | None = None
    notes: list[str] = field(default_factory=list, init=False)
    _counts: dict[str, str] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        positive("init_sigma_mm", self.init_sigma_mm)

    @property
    def choices(self) -> dict[str, Any]:
        """What was chosen for any data."""
        names = ("poses", "seed", "start", "init_sigma_mm", "undistort")
        return {name: getattr(self, name) for name in names}

    @property
    def simulated(self) -> bool:
        """Whether no camera saw what is in the samples."""
        return all(dataset.name in protocols.SIMULATED for dataset in self.data)

    def line(self) -> str:
        """Return what goes under every table: what the data are, simulated or not, and how many poses."""
        sources = "; ".join(dict.fromkeys(dataset.source for dataset in self.data))
        if not self.data:
            sources = f"poses, cameras, 2D detections and monocular poses are synthetic (seed {self.seed})"
        warning = "SIMULATED data, not the paper's: " if self.simulated else ""
        return f"{warning}{sources}. {'; '.join(self._counts.values())}."

    def samples(self, *kinds: Kind) -> list[Sample]:
        """Return poses of each kind: like Human3.6M's, or in a dome of cameras.

        ``"noisy"`` has the detections of another detector, ``"occ-2"`` and ``"occ-3"`` so many of four views
        occluded. A data set on disk is what it is, whatever kind is asked for.
        """
        sets = self.data or [simulated(*_SETS[kind], self.seed) for kind in kinds]
        return [self._sample(one, all_views="dome" in kinds) for one in sets]

    def _sample(self, dataset: Dataset, *, all_views: bool) -> Sample:
        """Take the poses that were chosen, and remember how many."""
        protocol = protocols.get(dataset.name)
        name = ", ".join(filter(None, (dataset.name, dataset.detector)))
        if all_views and protocol.view_sets:
            protocol = protocol.with_options(n_views=max(protocol.view_sets))
        made = sample(dataset, protocol, self.poses, name=name, undistort=self.undistort)
        some = made.n_poses < made.n_available
        count = f"{made.n_poses} of {made.n_available}" if some else f"all {made.n_available}"
        self._counts[name] = f"{name}: {count} poses"
        return made

    def note(self, text: str) -> None:
        """Keep a sentence for under the tables."""
        if text not in self.notes:
            self.notes.append(text)

    def start_kind(self, sample: Sample) -> Start:
        """Return how poses are initialised: as chosen, or by fusion as in the paper's experiment."""
        fused = sample.has_monocular and self.start != "dlt"
        if self.start == "fusion" and not fused:
            raise InvalidInputError(f"start: expected monocular poses in {sample.name}, got none")
        if self.start == "paper" and not fused:
            self.note(f"{sample.name}: no monocular poses, so DLT is refined instead of their fusion")
        self.note(f"{sample.name}: start by {'fusion of monocular poses' if fused else 'unweighted DLT'}")
        return "fusion" if fused else "dlt"

    def refined(
        self,
        method: str,
        sample: Sample,
        starts: Sequence[Array],
        doing: str,
        init_sigma_mm: float | None = None,
        **fields: Any,
    ) -> list[sk.Refinement]:
        """Refine every group with `PAPER`, as on this data set, or `ANNEALED`, with some settings changed."""
        if method == PAPER:
            config = sk.RefineConfig.paper(**{**sample.paper_fields, **fields})
        else:
            config = sk.RefineConfig(**fields)
        results, before = [], 0
        for group, start in zip(sample.groups, starts, strict=True):

            def heard(now: int, _: int, before: int = before) -> None:
                if self.progress is not None:
                    self.progress(f"{sample.name}: {method}, {doing}", before + now, sample.n_poses)

            heard(0, len(group))
            results.append(refined(group, sample.layout, start, config, init_sigma_mm, heard))
            before += len(group)
        return results

    def errors(
        self, method: str, sample: Sample, starts: Sequence[Array], doing: str, **fields: Any
    ) -> Errors:
        """Return the errors of `refined`."""
        results = self.refined(method, sample, starts, doing, **fields)
        steps = float(np.mean(np.concatenate([result.n_iter for result in results])))
        return errors_of(sample, [result.pose for result in results], steps)


def simulated(name: str, detector: str, seed: int) -> Dataset:
    """Return a set of `skelsplat.synthetic.simulate_set` with the detections of one of its detectors."""
    made = simulate_set(name, seed=seed)
    takes = tuple(take_of(one, made.rigs[one.rig_name], detector) for one in made.recordings)
    source = f"simulated {name}, seed {seed}, {detector} detections"
    return Dataset(name, made.layout, takes, detector, source)

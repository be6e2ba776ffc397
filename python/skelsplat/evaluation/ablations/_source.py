"""The poses on which settings are compared, where they come from, and the two methods run on them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, positive
from skelsplat.datasets import Dataset, Take
from skelsplat.datasets.synthetic import take_of
from skelsplat.evaluation import protocols
from skelsplat.evaluation.methods import DEFAULT_INIT_SIGMA_MM, refined, starting_poses, without_lens
from skelsplat.exceptions import InvalidInputError
from skelsplat.synthetic import simulate_set

PAPER, ANNEALED = "paper", "annealed"
# Of a `Source`, for any data.
CHOICES = ("poses", "seed", "start", "init_sigma_mm", "undistort")

Start = Literal["dlt", "fusion"]
Kind = Literal["plain", "noisy", "occ-2", "occ-3", "dome"]

# Simulated sets, and their detectors; "occ": so many of four views are occluded.
_SETS: dict[Kind, tuple[str, str]] = {
    "plain": ("human36m-like", "good"),
    "noisy": ("human36m-like", "noisy"),
    "occ-2": ("human36m-like-occ-2", "good"),
    "occ-3": ("human36m-like-occ-3", "good"),
    "dome": ("dome", "good"),
}

Errors = dict[str, float]
"""What one setting gives: ``mpjpe``, mm, and the mean number of ``steps``; NaN if nothing was optimised."""


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Poses of one data set with the detections of one detector."""

    name: str  # data set and detector, for rows of a table
    layout: sk.Layout
    groups: tuple[Take, ...]  # poses that the same cameras see: frames of takes, one after the other
    # What the paper changes in its settings on this data set.
    paper_fields: Mapping[str, Any] = field(default_factory=dict)

    @property
    def n_poses(self) -> int:
        """Number of poses."""
        return sum(map(len, self.groups))

    @property
    def has_monocular(self) -> bool:
        """Whether all poses come with monocular estimates."""
        return all(group.monocular is not None for group in self.groups)

    def starts(self, kind: Start) -> list[Array]:
        """Return the initial poses of every group."""
        return [starting_poses(group, kind) for group in self.groups]

    def errors(self, poses: Sequence[Array], steps: float = float("nan")) -> Errors:
        """Return the errors of predicted `poses`, one array (P, N, 3) per group, and the steps they took."""
        joints = [
            group.rig.mm_per_unit * np.linalg.norm(pose - group.truth, axis=-1)
            for group, pose in zip(self.groups, poses, strict=True)
        ]
        return {"mpjpe": float(np.nanmean(np.concatenate(joints))), "steps": steps}


def _by_rig(takes: Sequence[Take]) -> list[Take]:
    """Return the frames of takes as one take per rig."""
    rigs: list[sk.CameraRig] = []
    for take in takes:
        if take.rig not in rigs:
            rigs.append(take.rig)
    joined = []
    for rig in rigs:
        same = [take for take in takes if take.rig == rig]
        known: dict[str, Any] = {}
        for name in ("frames", "truth", "detections", "monocular"):
            parts = [getattr(take, name) for take in same]
            known[name] = None if any(part is None for part in parts) else np.concatenate(parts)
        joined.append(Take(same[0].key, same[0].subject, same[0].action, rig, **known))
    return joined


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
    progress: Callable[[str, int, int], None] = lambda *_: None
    notes: list[str] = field(default_factory=list, init=False)  # go under the tables, each once
    _counts: dict[str, str] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        positive("init_sigma_mm", self.init_sigma_mm)

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
        """Return simulated poses of each kind, or of the data on disk whatever kind is asked for."""
        sets = self.data or [simulated(*_SETS[kind], self.seed) for kind in kinds]
        return [self._sample(one, all_views="dome" in kinds) for one in sets]

    def _sample(self, dataset: Dataset, *, all_views: bool) -> Sample:
        """Take as many poses as chosen, evenly over those that the protocol counts, and remember how many."""
        protocol = protocols.get(dataset.name)
        if all_views and protocol.view_sets:
            protocol = protocol.with_options(n_views=max(protocol.view_sets))
        takes = [case.take for case in protocol.cases(dataset) if case.absolute]
        total = sum(map(len, takes))
        if total == 0:
            raise InvalidInputError(f"{dataset.name}: expected poses whose absolute error counts, got none")
        if any(take.detections is None for take in takes):
            raise InvalidInputError(f"{dataset.name}: expected detections, got a data set read without")
        count = total if self.poses is None else min(self.poses, total)
        chosen = ((np.arange(count) + 0.5) * total / count).astype(np.int64)
        groups, first = [], 0
        for whole in _by_rig(takes):
            here = chosen[(chosen >= first) & (chosen < first + len(whole))] - first
            first += len(whole)
            if len(here):
                rig = whole.rig if self.undistort else without_lens(whole.rig)
                groups.append(replace(whole.select(here), rig=rig))
        name = ", ".join(filter(None, (dataset.name, dataset.detector)))
        self._counts[name] = f"{name}: {f'all {total}' if count == total else f'{count} of {total}'} poses"
        return Sample(name, dataset.layout, tuple(groups), protocol.paper_fields)

    def start_kind(self, sample: Sample) -> Start:
        """Return how poses are initialised: as chosen, or by fusion as in the paper's experiment."""
        fused = sample.has_monocular and self.start != "dlt"
        if self.start == "fusion" and not fused:
            raise InvalidInputError(f"start: expected monocular poses in {sample.name}, got none")
        if self.start == "paper" and not fused:
            self.notes.append(f"{sample.name}: no monocular poses, so DLT is refined instead of their fusion")
        start = "fusion of monocular poses" if fused else "unweighted DLT"
        self.notes.append(f"{sample.name}: start by {start}")
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
        return sample.errors([result.pose for result in results], steps)


def simulated(name: str, detector: str, seed: int) -> Dataset:
    """Return a set of `skelsplat.synthetic.simulate_set` with the detections of one of its detectors."""
    made = simulate_set(name, seed=seed)
    takes = tuple(take_of(one, made.rigs[one.rig_name], detector) for one in made.recordings)
    source = f"simulated {name}, seed {seed}, {detector} detections"
    return Dataset(name, made.layout, takes, detector, source)

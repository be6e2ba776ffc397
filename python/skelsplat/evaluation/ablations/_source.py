"""Where the poses of an ablation come from, and the two methods that are run on them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

import skelsplat as sk
from skelsplat import datasets
from skelsplat._arrays import Array, positive
from skelsplat.datasets import Dataset, Take
from skelsplat.datasets._registry import detections_option, options_of
from skelsplat.evaluation import protocols
from skelsplat.evaluation.ablations._sample import Errors, Sample, Start, errors_of, sample
from skelsplat.evaluation.methods import DEFAULT_INIT_SIGMA_MM, refined
from skelsplat.evaluation.published import occlusion_of
from skelsplat.exceptions import InvalidInputError
from skelsplat.synthetic import simulate_set

PAPER, ANNEALED = "paper", "annealed"
_START_WORDS = {"dlt": "by DLT without weights", "fusion": "by fusion of monocular poses"}

Kind = Literal["plain", "noisy", "occ-2", "occ-3", "dome"]

# Simulated sets: name, name in the paper's rows, detector.
_SETS: dict[Kind, tuple[str, str, str]] = {
    "plain": ("human36m-like", "human36m", "good"),
    "noisy": ("human36m-like", "human36m", "noisy"),
    "occ-2": ("human36m-like-occ-2", "human36m-occ-2", "good"),
    "occ-3": ("human36m-like-occ-3", "human36m-occ-3", "good"),
    "dome": ("dome", "panoptic", "good"),
}

Progress = Callable[[str, int, int], None]
"""Called with what is being measured, poses done and poses in all."""


@dataclass(frozen=True, slots=True)
class Choices:
    """What a user chooses for any ablation."""

    poses: int | None  # how many poses of each data set; None: all
    seed: int = 0  # of simulated data and of noise on the start
    # {"paper", "dlt", "fusion"}: Initial poses; "paper": as in the paper's experiment, if the data have what
    # it needs.
    start: Literal["paper", "dlt", "fusion"] = "paper"
    # Standard deviation per axis of the fused start where it enters as a prior.
    init_sigma_mm: float = DEFAULT_INIT_SIGMA_MM
    undistort: bool = True  # whether to take lens distortion out; the paper does not

    def __post_init__(self) -> None:
        positive("init_sigma_mm", self.init_sigma_mm)


@dataclass(frozen=True, slots=True)
class OnDisk:
    """A data set of the registry, taken whatever an ablation asks for."""

    # name, root, options: As in `skelsplat.datasets.read`.
    name: str
    root: Path
    # One sample for each; a folder's path: detections outside the root. Empty: the reader's own choice.
    detectors: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)


class Source:
    """Samples for the experiments, and the two methods; `progress` hears what is being measured.

    Without a data set `on_disk` samples are simulated in memory from the seed; no camera saw what is in them.
    """

    def __init__(
        self, choices: Choices, on_disk: OnDisk | None = None, progress: Progress | None = None
    ) -> None:
        self.choices = choices
        self.simulated = on_disk is None or on_disk.name == "synthetic"
        self.notes: list[str] = []
        self._on_disk = on_disk
        self._progress = progress
        self._counts: dict[str, str] = {}
        self._sources: dict[str, None] = {}  # in the order in which they were read

    def line(self) -> str:
        """Return what goes under every table: what the data are, simulated or not, and how many poses."""
        if self._on_disk is None:
            sources = (
                f"poses, cameras, 2D detections and monocular poses are synthetic (seed {self.choices.seed})"
            )
        else:
            sources = "; ".join(self._sources)
        warning = "SIMULATED data, not the paper's: " if self.simulated else ""
        return f"{warning}{sources}. {'; '.join(self._counts.values())}."

    def samples(self, *kinds: Kind) -> list[Sample]:
        """Return poses of each kind: like Human3.6M's, or in a dome of cameras.

        ``"noisy"`` has the detections of another detector, ``"occ-2"`` and ``"occ-3"`` so many of four views
        occluded. A data set on disk is what it is, whatever kind is asked for.
        """
        if self._on_disk is None:
            return [self._simulated(*_SETS[kind]) for kind in kinds]
        detectors = self._on_disk.detectors or (None,)
        return [self._read(self._on_disk, detector, "dome" in kinds) for detector in detectors]

    def _simulated(self, name: str, key: str, detector: str) -> Sample:
        dataset = simulated(name, detector, self.choices.seed)
        return self._sample(dataset, f"{name}, {detector}", key)

    def _read(self, data: OnDisk, detector: str | None, all_views: bool) -> Sample:
        options, known = dict(data.options), options_of(data.name)
        if detector is not None:
            options |= detections_option(data.name, detector)
        if all_views and data.name in protocols.names and "views" in known:
            options.setdefault("views", max(protocols.get(data.name).view_sets, default=None))
        dataset = datasets.read(data.name, data.root, **options)
        self._sources[dataset.source] = None
        label = f"{dataset.name}, {dataset.detector}" if dataset.detector else dataset.name
        return self._sample(dataset, label, all_views=all_views)

    def _sample(self, dataset: Dataset, name: str, key: str = "", *, all_views: bool = True) -> Sample:
        """Take the poses that were chosen, and remember how many."""
        chosen, protocol = self.choices, protocols.get(dataset.name)
        if all_views and protocol.view_sets:
            protocol = protocol.with_options(n_views=max(protocol.view_sets))
        variant = occlusion_of(dataset) if protocol.name == "human36m-occ" else None
        key = key or (f"{protocol.name}-{variant}" if variant else protocol.name)  # as in the paper's rows
        made = sample(dataset, protocol, chosen.poses, name=name, key=key, undistort=chosen.undistort)
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
        if self.choices.start == "dlt":
            return "dlt"
        if sample.has_monocular:
            return "fusion"
        if self.choices.start == "fusion":
            raise InvalidInputError(f"start: expected monocular poses in {sample.name}, got none")
        self.note(f"{sample.name}: no monocular poses, so DLT is refined instead of their fusion")
        return "dlt"

    def starts(self, sample: Sample) -> list[Array]:
        """Return the initial poses of every group."""
        kind = self.start_kind(sample)
        self.note(f"{sample.name}: start {_START_WORDS[kind]}")
        return sample.starts(kind)

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
                if self._progress is not None:
                    text = f"{sample.name}: {method}, {doing}"
                    self._progress(text, before + now, sample.n_poses)

            heard(0, len(group))
            results.append(refined(group.poses, sample.layout, start, config, init_sigma_mm, heard))
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
    same = ("key", "subject", "action", "frames", "truth", "monocular", "boxes", "visible")
    takes = tuple(
        Take(
            rig=made.rigs[recording.rig_name],
            detections=recording.detections[detector],
            **{part: getattr(recording, part) for part in same},
        )
        for recording in made.recordings
    )
    return Dataset(
        name, made.layout, takes, detector, f"simulated {name}, seed {seed}, {detector} detections"
    )

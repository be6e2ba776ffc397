"""Where the poses of an ablation come from, and the two presets that are run on them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import skelsplat as sk
from skelsplat.datasets import Dataset
from skelsplat.evaluation._method import DEFAULT_INIT_SIGMA_MM
from skelsplat.evaluation.ablations._measure import Errors, errors, refined
from skelsplat.evaluation.ablations._model import Outcome, Progress
from skelsplat.evaluation.ablations._sample import FloatArray, Sample, Start, sample
from skelsplat.evaluation.protocols import Protocol
from skelsplat.exceptions import InvalidInputError

PAPER, DEFAULT = "skelsplat-paper", "skelsplat"


@dataclass(frozen=True, slots=True)
class Choices:
    """What a user chooses for any ablation.

    Attributes
    ----------
    poses : int or None
        How many poses of each data set; None: all.
    seed : int
        Of simulated data and of noise on the start.
    start : {"paper", "dlt", "fusion"}
        Initial poses; "paper": as in the paper's experiment, if the data have what it needs.
    init_sigma_mm : float
        Standard deviation per axis of the fused start where it enters as a prior.
    undistort : bool
        Whether to take lens distortion out; the paper does not.
    """

    poses: int | None
    seed: int = 0
    start: Literal["paper", "dlt", "fusion"] = "paper"
    init_sigma_mm: float = DEFAULT_INIT_SIGMA_MM
    undistort: bool = True


class Source(ABC):
    """Samples for the experiments.

    Parameters
    ----------
    choices : Choices
    progress : callable, optional
        Hears what is being measured.
    """

    simulated: bool

    def __init__(self, choices: Choices, progress: Progress | None = None) -> None:
        self.choices = choices
        self._progress = progress
        self.notes: list[str] = []
        self._counts: dict[str, tuple[int, int]] = {}

    @abstractmethod
    def line(self) -> str:
        """Return what goes under every table: what the data are, simulated or not, and how many poses."""

    def counts(self) -> str:
        """Say how many poses of how many were taken, of each data set."""
        return "; ".join(
            f"{name}: {f'all {total}' if taken == total else f'{taken} of {total}'} poses"
            for name, (taken, total) in self._counts.items()
        )

    def _sample(self, dataset: Dataset, protocol: Protocol, *, name: str, key: str) -> Sample:
        """Take the poses that were chosen, and remember how many."""
        made = sample(
            dataset, protocol, self.choices.poses, name=name, key=key, undistort=self.choices.undistort
        )
        self._counts[name] = (made.n_poses, made.n_available)
        return made

    @abstractmethod
    def plain(self) -> list[Sample]:
        """Poses like Human3.6M's, one sample per detector of the main comparison."""

    @abstractmethod
    def detectors(self) -> list[Sample]:
        """Poses like Human3.6M's, one sample per detector there is."""

    @abstractmethod
    def occluded(self, *kinds: str) -> list[Sample]:
        """Poses like Human3.6M-Occ's, one sample per kind: ``"2"`` or ``"3"`` of four views occluded."""

    @abstractmethod
    def many_views(self) -> list[Sample]:
        """Poses in a dome of cameras."""

    def start_kind(self, sample: Sample, paper: Start) -> Start:
        """Return how poses are initialised where the paper's experiment has `paper`."""
        wanted: Start = paper if self.choices.start == "paper" else self.choices.start
        if wanted == "fusion" and not sample.has_monocular:
            if self.choices.start == "fusion":
                raise InvalidInputError(f"start: expected monocular poses in {sample.name}, got none")
            self.note(f"{sample.name}: no monocular poses, so DLT is refined instead of their fusion")
            return "dlt"
        return wanted

    def starts(self, sample: Sample, paper: Start) -> list[FloatArray]:
        """Return the initial poses where the paper's experiment has `paper`."""
        kind = self.start_kind(sample, paper)
        self.note(f"{sample.name}: start {_START_WORDS[kind]}")
        return sample.starts(kind)

    def note(self, text: str) -> None:
        """Keep a sentence for under the tables."""
        if text not in self.notes:
            self.notes.append(text)

    def noted(self, outcome: Outcome) -> Outcome:
        """Return the outcome with the sentences that were kept."""
        return replace(outcome, notes=(*outcome.notes, *(f"{note}." for note in self.notes)))

    def paper(
        self, sample: Sample, starts: Sequence[FloatArray], doing: str, **fields: Any
    ) -> list[sk.Refinement]:
        """Run the paper's preset, as on this data set, with some fields changed."""
        config = sk.RefineConfig.paper(**{**sample.paper_fields, **fields})
        return self._run(sample, starts, config, f"{PAPER}, {doing}")

    def default(
        self,
        sample: Sample,
        starts: Sequence[FloatArray] | None,
        doing: str,
        init_sigma_mm: float | None = None,
        **fields: Any,
    ) -> list[sk.Refinement]:
        """Run the default solver with some fields changed."""
        config = sk.RefineConfig(**fields)
        return self._run(sample, starts, config, f"{DEFAULT}, {doing}", init_sigma_mm)

    def paper_errors(self, sample: Sample, starts: Sequence[FloatArray], doing: str, **fields: Any) -> Errors:
        """Return the errors of `paper`."""
        return errors(sample, self.paper(sample, starts, doing, **fields))

    def default_errors(
        self, sample: Sample, starts: Sequence[FloatArray] | None, doing: str, **fields: Any
    ) -> Errors:
        """Return the errors of `default`."""
        return errors(sample, self.default(sample, starts, doing, **fields))

    def _run(
        self,
        sample: Sample,
        starts: Sequence[FloatArray] | None,
        config: sk.RefineConfig,
        doing: str,
        init_sigma_mm: float | None = None,
    ) -> list[sk.Refinement]:
        text = f"{sample.name}: {doing}"

        def heard(done: int, total: int) -> None:
            if self._progress is not None:
                self._progress(text, done, total)

        heard(0, sample.n_poses)
        return refined(sample, starts, config, init_sigma_mm=init_sigma_mm, progress=heard)


_START_WORDS = {
    "dlt": "by DLT without weights",
    "fusion": "by fusion of monocular poses",
}

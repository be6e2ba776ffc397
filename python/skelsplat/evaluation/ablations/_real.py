"""Samples from a data set on disk."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from skelsplat import datasets
from skelsplat.datasets import Dataset
from skelsplat.datasets._registry import options_of
from skelsplat.evaluation import protocols
from skelsplat.evaluation.ablations._model import Progress
from skelsplat.evaluation.ablations._sample import Sample
from skelsplat.evaluation.ablations._source import Choices, Source
from skelsplat.evaluation.protocols import Protocol


class OnDisk(Source):
    """A data set of the registry, whatever the ablation asks for.

    Parameters
    ----------
    choices : Choices
    name, root : str and Path
        As in `skelsplat.datasets.read`.
    detectors : sequence of str
        One sample for each; a folder's path is taken for detections outside the root. Empty: the reader's
        own choice.
    options : mapping
        Further options of the reader.
    progress : callable, optional
    """

    def __init__(
        self,
        choices: Choices,
        name: str,
        root: Path,
        detectors: Sequence[str] = (),
        options: Mapping[str, Any] | None = None,
        progress: Progress | None = None,
    ) -> None:
        super().__init__(choices, progress)
        self.simulated = name == "synthetic"
        self._name, self._root = name, root
        self._detectors, self._options = tuple(detectors), dict(options or {})
        self._sources: list[str] = []

    def plain(self) -> list[Sample]:
        return [self._read(detector, all_views=False) for detector in self._detectors or (None,)]

    def detectors(self) -> list[Sample]:
        return self.plain()

    def occluded(self, *kinds: str) -> list[Sample]:
        del kinds  # the data set is what it is
        return self.plain()

    def many_views(self) -> list[Sample]:
        return [self._read(detector, all_views=True) for detector in self._detectors or (None,)]

    def line(self) -> str:
        warning = "SIMULATED data, not the paper's: " if self.simulated else ""
        return f"{warning}{'; '.join(self._sources)}. {self.counts()}."

    def _read(self, detector: str | None, *, all_views: bool) -> Sample:
        options, known = dict(self._options), options_of(self._name)
        if detector is not None:
            apart = Path(detector).exists() and "detections" in known
            options["detections" if apart else "detector"] = detector
        if all_views and self._name in protocols.names and "views" in known:
            options.setdefault("views", max(protocols.get(self._name).view_sets, default=None))
        dataset = datasets.read(self._name, self._root, **options)
        protocol = protocols.get(dataset.name)
        if all_views and protocol.view_sets:
            protocol = protocol.with_options(n_views=max(protocol.view_sets))
        if dataset.source not in self._sources:
            self._sources.append(dataset.source)
        return self._sample(dataset, protocol, name=_label(dataset), key=_key(dataset, protocol))


def _label(dataset: Dataset) -> str:
    return f"{dataset.name}, {dataset.detector}" if dataset.detector else dataset.name


def _key(dataset: Dataset, protocol: Protocol) -> str:
    """Name of the data as in the paper's rows: the protocol's, with the occlusion behind it."""
    variant = re.search(r"-occ-(2|3-hard|3)", f"{dataset.name} {dataset.source}", re.IGNORECASE)
    return f"{protocol.name}-{variant[1]}" if variant and protocol.name == "human36m-occ" else protocol.name

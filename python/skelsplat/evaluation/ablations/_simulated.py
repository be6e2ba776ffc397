"""Samples from the simulated data sets: the package's motions in rigs like those of the real ones."""

from __future__ import annotations

from skelsplat.datasets import Dataset, Take
from skelsplat.evaluation import protocols
from skelsplat.evaluation.ablations._sample import Sample
from skelsplat.evaluation.ablations._source import Source
from skelsplat.synthetic import simulate_set

_DETECTORS = ("good", "noisy")


class Simulated(Source):
    """Simulated data sets, made in memory from the seed; nothing in them was seen by a camera."""

    simulated = True

    def plain(self) -> list[Sample]:
        return [self._made("human36m-like", "human36m", "good")]

    def detectors(self) -> list[Sample]:
        return [self._made("human36m-like", "human36m", name) for name in _DETECTORS]

    def occluded(self, *kinds: str) -> list[Sample]:
        return [self._made(f"human36m-like-occ-{k}", f"human36m-occ-{k}", "good") for k in kinds]

    def many_views(self) -> list[Sample]:
        return [self._made("dome", "panoptic", "good")]

    def line(self) -> str:
        return (
            "SIMULATED data, not the paper's: poses, cameras, 2D detections and monocular poses are "
            f"synthetic (seed {self.choices.seed}). {self.counts()}."
        )

    def _made(self, name: str, key: str, detector: str) -> Sample:
        dataset = simulated(name, detector, self.choices.seed)
        protocol = protocols.get(name)
        if protocol.view_sets:
            protocol = protocol.with_options(n_views=max(protocol.view_sets))
        return self._sample(dataset, protocol, name=f"{name}, {detector}", key=key)


def simulated(name: str, detector: str, seed: int) -> Dataset:
    """Return a set of `skelsplat.synthetic.simulate_set` with the detections of one of its detectors."""
    made = simulate_set(name, seed=seed)
    takes = tuple(
        Take(
            key=r.key,
            subject=r.subject,
            action=r.action,
            rig=made.rigs[r.rig_name],
            frames=r.frames,
            truth=r.truth,
            detections=r.detections[detector],
            monocular=r.monocular,
            boxes=r.boxes,
            visible=r.visible,
        )
        for r in made.recordings
    )
    source = f"simulated {name}, seed {seed}, {detector} detections"
    return Dataset(name, made.layout, takes, detector, source)

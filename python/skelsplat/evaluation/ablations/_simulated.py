"""Samples from the simulated data sets: the package's motions in rigs like those of the real ones."""

from __future__ import annotations

from skelsplat import synthetic
from skelsplat.datasets import Dataset, Take
from skelsplat.evaluation.ablations._sample import Sample, sample
from skelsplat.evaluation.ablations._source import Source

_DETECTORS = ("good", "noisy")


class Simulated(Source):
    """Simulated data sets, made in memory from the seed; nothing in them was seen by a camera."""

    simulated = True

    def plain(self) -> list[Sample]:
        return [self._sample("human36m-like", "human36m", "good")]

    def detectors(self) -> list[Sample]:
        return [self._sample("human36m-like", "human36m", name) for name in _DETECTORS]

    def occluded(self, *, hard: bool = False) -> list[Sample]:
        kinds = ("2", "3", "3-hard") if hard else ("2", "3")
        return [self._sample(f"human36m-like-occ-{k}", f"human36m-occ-{k}", "good") for k in kinds]

    def many_views(self) -> list[Sample]:
        return [self._sample("dome", "panoptic", "good")]

    def _sample(self, name: str, key: str, detector: str) -> Sample:
        dataset = simulated(name, detector, self.choices.seed)
        return sample(
            dataset,
            self.choices.poses,
            name=f"simulated {name}, {detector}",
            key=key,
            undistort=self.choices.undistort,
        )


def simulated(name: str, detector: str, seed: int) -> Dataset:
    """Return a set of `skelsplat.synthetic.simulate_set` with the detections of one of its detectors."""
    made = synthetic.simulate_set(name, seed=seed)
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
    source = f"Simulated: {name}, seed {seed}; poses, cameras and {detector} detections are synthetic"
    return Dataset(name, made.layout, takes, detector, source)

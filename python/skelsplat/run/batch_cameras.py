"""One rig for all recordings of a batch that have one calibration, so that their joints can be compared."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import skelsplat as sk
from skelsplat.exceptions import InvalidInputError, SkelSplatError
from skelsplat.findings import Finding, collected_warnings
from skelsplat.io.calibration import write_calibration
from skelsplat.run.adjusted import numbers_of
from skelsplat.run.by_everybody import Scene
from skelsplat.run.folder import in_the_way
from skelsplat.run.job import Job
from skelsplat.run.read import OF_CALIBRATION, open_files, read_everybody
from skelsplat.run.session import adjust_session

CAMERAS = "batch-cameras.json"


@dataclass(frozen=True)
class AdjustedTogether:
    """Recordings whose cameras were adjusted together, by name."""

    recordings: tuple[str, ...]
    calibration: str  # the file that was adjusted, and
    output: str  # the one with which all are refined
    cameras: Sequence[Mapping[str, Any]]  # what became of each, as of `skelsplat.run.adjusted.numbers_of`
    offsets: Mapping[str, Mapping[str, float]]  # by recording and camera
    findings: tuple[Finding, ...]
    key: str = field(repr=False)  # a text that differs if the recordings or their options do

    def of(self, name: str, job: Job) -> Job:
        """Return the job of one of the recordings, with these cameras."""
        bare: dict[str, Any] = dict.fromkeys(OF_CALIBRATION)
        offsets = self.offsets.get(name, job.offsets)
        return replace(job, calibration=self.output, offsets=offsets, adjust_cameras=False, **bare)

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return {**vars(self), "findings": [finding.to_dict() for finding in self.findings]}

    @classmethod
    def of_dict(cls, entry: Mapping[str, Any]) -> AdjustedTogether:
        """Return it from `to_dict`."""
        findings = tuple(Finding.from_dict(one) for one in entry["findings"])
        return cls(**{**entry, "recordings": tuple(entry["recordings"]), "findings": findings})


def adjust_together(
    jobs: Mapping[str, Job], folder: Path, key_of: Callable[[Job], str], earlier: Sequence[AdjustedTogether]
) -> Iterator[AdjustedTogether]:
    """Adjust the cameras of all jobs that ask for it and have one calibration with others, and write them.

    A session of an ``earlier`` batch is kept if neither its files nor its options have changed. Recordings
    that cannot be read, or show another fault, have no say; without two others, each is adjusted alone.
    """
    alike: dict[tuple[str, ...], list[str]] = {}
    for name, job in jobs.items():
        if job.adjust_cameras and not job.move:
            options = (getattr(job, one) for one in (*OF_CALIBRATION, "without", "layout", "mapping"))
            kind = str(Path(job.calibration).resolve()), *map(str, options)
            alike.setdefault(kind, []).append(name)
    several = [names for names in alike.values() if len(names) > 1]
    for k, names in enumerate(several):
        key = hashlib.sha256("\n".join(key_of(jobs[name]) for name in names).encode()).hexdigest()
        kept = next((one for one in earlier if one.key == key and Path(one.output).is_file()), None)
        place = folder / (f"{k + 1}-{CAMERAS}" if len(several) > 1 else CAMERAS)
        if place.resolve() == Path(jobs[names[0]].calibration).resolve():
            raise in_the_way(place)
        found = kept or _adjusted({name: jobs[name] for name in names}, place, key)
        if found is not None:
            yield found


def _adjusted(jobs: Mapping[str, Job], place: Path, key: str) -> AdjustedTogether | None:
    """Adjust the cameras of a session's recordings, and write them; None if fewer than two have a say."""
    every: sk.CameraRig | None = None
    scenes: dict[str, Scene] = {}
    with collected_warnings():  # which every run repeats
        for name, job in jobs.items():
            try:
                rig, scenes[name] = _scene(job)
            except (SkelSplatError, OSError):  # of which its run tells
                continue
            every = every or rig
        if every is None or len(scenes) < 2:
            return None
        try:
            found = adjust_session(scenes, lambda name, moved: _scene(replace(jobs[name], offsets=moved))[1])
        except InvalidInputError:  # they have other joints
            return None
    if found.adjustment is None:
        return None
    write_calibration(place, replace(found.of(every), clocks={}), note=f"skelsplat batch: {', '.join(jobs)}")
    return AdjustedTogether(
        tuple(jobs),
        str(next(iter(jobs.values())).calibration),
        str(place),
        [numbers_of(one, every.mm_per_unit) for one in found.found.report],
        found.offsets,
        found.findings,
        key,
    )


def _scene(job: Job) -> tuple[sk.CameraRig, Scene]:
    """Return the cameras of a job's calibration, and everybody whom those that are not left out see."""
    opened = open_files(job)
    people, whole = read_everybody(opened, job)
    return opened.every, Scene(whole.rig, people, whole.frames, whole.layout, whole.read_as)

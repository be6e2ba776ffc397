"""Recordings of one session: they have the same cameras, so what they say of these adds up."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat._who import GAP
from skelsplat.exceptions import InvalidInputError
from skelsplat.findings import Finding
from skelsplat.rig_check import ReadAs
from skelsplat.run.adjusted import findings_of, is_late, late, numbers_of, offsets_of
from skelsplat.run.by_everybody import Scene, adjusted
from skelsplat.run.solve import step_of

Offsets = Mapping[str, float]
"""By camera, what is to be added to its frame numbers."""


@dataclass(frozen=True)
class Session:
    """What recordings, by name, say of the cameras that they share."""

    adjustment: sk.RigAdjustment | None  # by all of them; None if all have faults
    offsets: Mapping[str, Offsets] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    # recordings that were left out, because another fault has to be corrected first
    faults: Mapping[str, Finding] = field(default_factory=dict)

    @property
    def found(self) -> sk.RigAdjustment:
        """What became of the cameras, of recordings without faults."""
        if self.adjustment is None:
            raise TypeError("a recording without faults is needed")
        return self.adjustment

    @property
    def shared(self) -> Offsets | None:
        """The offsets that are those of all recordings; None if they differ."""
        first, *others = self.offsets.values()
        return first if all(one == first for one in others) else None

    def of(self, every: sk.CameraRig) -> sk.CameraRig:
        """Return cameras, some of which were left out, as they were adjusted, with clocks that are shared."""
        known = dict(zip(self.found.cameras.names, self.found.cameras, strict=True))
        cameras = [known.get(name, one) for name, one in zip(every.names, every, strict=True)]
        clocks = {name: -offset for name, offset in (self.shared or {}).items()}
        return replace(every, cameras=cameras, clocks=clocks)


def adjust_session(
    scenes: Mapping[str, Scene],
    look: Callable[[str, Offsets], Scene],
    *,
    free: Sequence[str] | None = None,
    focal: bool = False,
    clock: bool = False,
) -> Session:
    """Adjust the cameras of recordings, by name; ``look`` reads one again with other offsets.

    Every recording has its own clocks: they are measured in it alone, and set right before all are taken
    together. Other arguments are those of `skelsplat.adjust_cameras`.
    """
    each = {name: adjusted(scene, free=free, focal=focal, clock=clock) for name, scene in scenes.items()}
    faults = {name: found for name, found in each.items() if isinstance(found, Finding)}
    alone = {name: found for name, found in each.items() if isinstance(found, sk.RigAdjustment)}
    if not alone:
        return Session(None, faults=faults)
    if len(scenes) == 1:
        ((name, found),) = alone.items()
        scene = scenes[name]
        told = findings_of(found, scene.rig.mm_per_unit, scene.read_as, corrected=True)
        return Session(found, {name: offsets_of(found, scene.read_as)}, tuple(told))
    in_step, findings = {}, []
    for name, found in alone.items():
        scene = scenes[name]
        off = [one for one in found.report if is_late(one)]
        in_step[name] = look(name, offsets_of(found, scene.read_as)) if off else scene
        findings += [late(numbers_of(one, scene.rig.mm_per_unit), recording=name) for one in off]
    joined = Joined(in_step)
    together = adjusted(joined.scene, free=free, focal=focal, clock=clock)
    if isinstance(together, Finding):
        return Session(None, faults={**faults, **dict.fromkeys(alone, together)})
    mm = joined.scene.rig.mm_per_unit
    findings += findings_of(together, mm, ReadAs(), corrected=True, place=joined.place)
    offsets = {name: offsets_of(together, scene.read_as) for name, scene in in_step.items()}
    return Session(together, offsets, tuple(findings), faults)


def different(recordings: Path | Sequence[Path]) -> list[Path]:
    """Return one recording or several as a list, in which each is once."""
    paths = [recordings] if isinstance(recordings, Path) else list(recordings)
    for path in paths:
        if [one.resolve() for one in paths].count(path.resolve()) > 1:
            raise InvalidInputError(f"detections: expected every recording once, got {path} twice")
    return paths


@dataclass(frozen=True)
class Joined:
    """Recordings by name, one after another."""

    scenes: Mapping[str, Scene]

    def __post_init__(self) -> None:
        (first, one), *others = self.scenes.items()
        for name, other in others:
            for what, a, b in (
                ("cameras", one.rig.names, other.rig.names),
                ("joints", one.layout.joints, other.layout.joints),
            ):
                if a != b:
                    expected = f"the same {what} in all of them ({', '.join(a)} in {first})"
                    raise InvalidInputError(f"detections: expected {expected}, got {', '.join(b)} in {name}")

    @property
    def starts(self) -> list[int]:
        """The number of the first frame of each, in the common count."""
        ends = np.cumsum(
            [int(one.frames[-1] - one.frames[0]) + GAP * step_of(one.frames) for one in self.scenes.values()]
        )
        return [0, *ends[:-1].tolist()]

    @property
    def scene(self) -> Scene:
        """All of them, with empty frames between."""
        scenes = list(self.scenes.values())
        most = max(one.people.shape[2] for one in scenes)
        numbers = [one.frames - one.frames[0] + start for one, start in zip(scenes, self.starts, strict=True)]
        people = np.concatenate([padded(one.people, most) for one in scenes])
        read_as = ReadAs(paces=scenes[0].read_as.paces)
        return replace(scenes[0], people=people, frames=np.concatenate(numbers), read_as=read_as)

    def place(self, number: int) -> str:
        """Return the recording and its frame that have a number in the common count, in words."""
        k = int(np.searchsorted(self.starts, number, side="right")) - 1
        name, scene = list(self.scenes.items())[k]
        return f"frame {number - self.starts[k] + int(scene.frames[0])} of {name}"


def padded(people: Array, most: int) -> Array:
    """Return people (T, M, P, N, 3) with places for ``most`` of them."""
    free = [(0, 0)] * people.ndim
    free[2] = (0, most - people.shape[2])
    return np.pad(people, free, constant_values=np.nan)

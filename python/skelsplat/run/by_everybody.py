"""Cameras adjusted by everybody in a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index
from skelsplat._clocks import in_step
from skelsplat._who import GAP, one_after_another
from skelsplat.cameras import altered, matrix_from_vector
from skelsplat.findings import Finding
from skelsplat.rig_check import ReadAs, RigReport, check_rig
from skelsplat.rig_check._scene import everybody, followed, in_mm, several
from skelsplat.run.solve import evened, step_of

_ROUNDS = 3  # how often people are told apart anew with other cameras
_SEES = 0.5  # of the people that it should see, relative to other cameras, a camera set right sees so many


@dataclass(frozen=True)
class Scene:
    """A rig, and the people (T, M, P, N, 3) that it sees in frames (T,)."""

    rig: sk.CameraRig
    people: Array
    frames: Index
    layout: sk.Layout
    read_as: ReadAs

    def check(self) -> RigReport:
        """Find what is wrong with the cameras."""
        return check_rig(self.rig, self.people, frames=self.frames, layout=self.layout, read_as=self.read_as)

    def adjust(self, **given: Any) -> sk.RigAdjustment:
        """Adjust cameras that disagree for no other reason than their places and clocks.

        A camera that is far off sees strangers in people's places: people are told apart anew where it may
        be, and one that does not see them then is doubtful, or ``"unseen"`` if it was not changed. One moved
        while it recorded is ``"knocked"``, and stays. Clocks are in a camera's own frames in the files;
        ``given`` are arguments of `skelsplat.adjust_cameras`.
        """
        people, frames = evened(self.people, self.frames)
        found = _by_everybody(self.rig, people, self.layout, given)
        report = self.read_as.in_files(found.report, step_of(self.frames))
        report = [one if one.since is None else replace(one, since=int(frames[one.since])) for one in report]
        return replace(found, report=tuple(report))


def adjusted(
    scene: Scene, *, free: Sequence[str] | None = None, focal: bool = False, clock: bool = False
) -> sk.RigAdjustment | Finding:
    """Adjust cameras; a finding if they disagree for another reason, which has to be corrected first."""
    for fault in scene.check().before_places:
        # where the user knows who is wrong, and where a focal length may be
        if (free and fault.kind == "recording_other") or (focal and "factor" in fault.numbers):
            continue
        numbers = {"fault": fault.kind, "why": fault.text}
        sentence = f"No camera was adjusted, because another fault has to be corrected first. {fault.text}"
        given = (fault.subject, numbers, fault.remedy)
        return Finding("cameras_not_adjusted", "warning", *given, sentence=sentence)
    return scene.adjust(free=free, focal=focal, clock=clock)


def _by_everybody(
    rig: sk.CameraRig, people: Array, layout: sk.Layout, given: dict[str, Any]
) -> sk.RigAdjustment:
    everyone = followed(in_mm(rig), people, layout)
    found = _adjusted(rig, everyone, given)
    if not several(rig, people):
        return found
    for _ in range(_ROUNDS):
        supposed = _supposed(rig, found)
        if supposed is None:
            break
        clocks = [round(one.clock) for one in found.report]  # frames ahead, shown or suspected
        right, _ = everybody(in_mm(supposed), in_step(people, dict(enumerate(clocks))), layout)
        back = {i: -clock for i, clock in enumerate(clocks)}
        before, everyone = everyone, tuple(in_step(one, back) for one in right)
        pairs = zip(everyone, before, strict=False)
        if len(everyone) == len(before) and all(np.array_equal(*pair, equal_nan=True) for pair in pairs):
            break
        found = _adjusted(rig, everyone, given)
    return _confirmed(rig, found, _part_seen(people, everyone))


def _adjusted(rig: sk.CameraRig, everyone: Sequence[Array], given: Mapping[str, Any]) -> sk.RigAdjustment:
    """Adjust cameras by people (T, M, N, 2|3) one after another."""
    one = np.arange(len(everyone[0]))
    times = np.concatenate([np.pad(one, (GAP, 0)) for _ in everyone])[GAP:]
    return sk.adjust_cameras(one_after_another(everyone), rig, times=times, **given)


def _supposed(rig: sk.CameraRig, found: sk.RigAdjustment) -> sk.CameraRig | None:
    """Return the cameras with all changes that are shown or, of one alone, suspected; None if none is."""
    doubtful = found.of("doubtful") if len(found.of("doubtful")) == 1 else []
    if not (doubtful or found.of("adjusted", "late")):
        return None
    cameras = list(found.cameras)
    for one in doubtful:
        i = rig.names.index(one.name)
        turned = matrix_from_vector(np.radians(one.turn)) @ rig[i].R
        cameras[i] = altered(rig[i], R=turned, t=-turned @ (rig[i].centre + one.shift))
    return replace(rig, cameras=cameras, clocks={})


def _part_seen(people: Array, everyone: Sequence[Array]) -> Array:
    """Return which part of the people whom two others see each camera sees as well, of those in it, (M,)."""
    inside = np.isfinite(people[..., 0]).any(axis=3).sum(axis=2)
    sees = np.isfinite(np.stack(everyone)[..., 0]).any(axis=3)
    others = sees.sum(axis=2, keepdims=True) - sees >= 2
    expected = np.minimum(inside, others.sum(axis=0)).sum(axis=0)
    part: Array = (sees & others).sum(axis=(0, 1)) / np.maximum(expected, 1)
    return part


def _confirmed(rig: sk.CameraRig, found: sk.RigAdjustment, seen: Array) -> sk.RigAdjustment:
    """Return the adjustment with cameras doubtful, or unseen, that do not see the people of the others."""
    report, cameras = list(found.report), list(found.cameras)
    for i, one in enumerate(found.report):
        if seen[i] >= _SEES * np.median(np.delete(seen, i)):
            continue
        if one.status in ("adjusted", "late"):
            report[i] = replace(one, status="doubtful", after=one.before)
            cameras[i] = rig[i]
        elif one.status == "sound":
            report[i] = replace(one, status="unseen")
    return replace(found, cameras=replace(rig, cameras=cameras, clocks={}), report=tuple(report))

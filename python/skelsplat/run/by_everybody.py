"""Cameras adjusted by everybody in a recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat.cameras import altered, matrix_from_vector
from skelsplat.rig_check._people import everybody, followed, one_after_another, several
from skelsplat.rig_check._scene import in_mm

# How often people are told apart anew with other cameras.
_ROUNDS = 3
# A camera set right sees this part of the people that it should see, or more, relative to the other cameras.
_SEES = 0.5

Solve = Callable[[Array], sk.RigAdjustment]


def adjust_by_everybody(
    rig: sk.CameraRig, people: Array, layout: sk.Layout, solve: Solve
) -> sk.RigAdjustment:
    """Adjust cameras by everybody on whom the views agree.

    A camera that is far off sees strangers in people's places. Once it is known where it may be, people are
    told apart anew, and the cameras are adjusted by them. A camera that does not see them then is doubtful
    if it was changed, and otherwise not judged: ``"unseen"``.

    Parameters
    ----------
    rig : CameraRig
    people : (T, M, P, N, 3)
        In frames at even times.
    layout : Layout
    solve : callable
        Adjusts the cameras by the detections (T', M, N, 3) of a recording of one person.
    """
    everyone = followed(in_mm(rig), people, layout)
    found = solve(one_after_another(everyone))
    if not several(rig, people):
        return found
    for _ in range(_ROUNDS):
        supposed = _supposed(rig, found)
        if supposed is None:
            break
        before, everyone = everyone, _told_apart(supposed, _clocks(found), people, layout)
        if _same(everyone, before):
            break
        found = solve(one_after_another(everyone))
    return _confirmed(rig, found, _part_seen(people, everyone))


def _supposed(rig: sk.CameraRig, found: sk.RigAdjustment) -> sk.CameraRig | None:
    """Return the cameras with all changes that are shown or, of one camera, suspected; None if there is none.

    Of two suspected cameras one is sound.
    """
    doubtful = found.of("doubtful") if len(found.of("doubtful")) == 1 else []
    if not (doubtful or found.of("adjusted", "late")):
        return None
    cameras = list(found.cameras)
    for one in doubtful:
        i = rig.names.index(one.name)
        turned = matrix_from_vector(np.radians(one.turn)) @ rig[i].R
        cameras[i] = altered(rig[i], R=turned, t=-turned @ (rig[i].centre + one.shift))
    return sk.CameraRig(cameras, rig.unit)


def _clocks(found: sk.RigAdjustment) -> list[int]:
    """Return by how many whole frames the count of every camera is ahead, shown or suspected."""
    return [round(one.clock) for one in found.report]


def _told_apart(
    rig: sk.CameraRig, clocks: Sequence[int], people: Array, layout: sk.Layout
) -> tuple[Array, ...]:
    """Return the detections of `everybody` as the cameras counted them, told apart with clocks set right."""
    right = everybody(in_mm(rig), _moved(people, clocks), layout)
    return tuple(_moved(one, [-clock for clock in clocks]) for one in right)


def _moved(seen: Array, clocks: Sequence[int]) -> Array:
    """Return what every camera (T, M, …) sees so many frames later; NaN beyond the ends."""
    out, count = np.full(seen.shape, np.nan), len(seen)
    for i, clock in enumerate(clocks):
        first, last = max(0, -clock), min(count, count - clock)
        out[first:last, i] = seen[first + clock : last + clock, i]
    return out


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
    return replace(found, cameras=sk.CameraRig(cameras, rig.unit), report=tuple(report))


def _same(some: Sequence[Array], others: Sequence[Array]) -> bool:
    """Whether the detections are those of the same people."""
    return len(some) == len(others) and all(
        np.array_equal(a, b, equal_nan=True) for a, b in zip(some, others, strict=True)
    )

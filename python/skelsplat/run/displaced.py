"""Findings on detections that are shifted from the pose, always or in some frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat._crowd import MIXED, gates_px
from skelsplat._displaced import views_apart
from skelsplat.findings import Finding, Remedy, Subject

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from collections.abc import Set as AbstractSet

    import skelsplat as sk
    from skelsplat._displaced import Shifts
    from skelsplat.run.summary import Statistics

# Fewer frames may be chance.
_LEAST_FRAMES = 3
# A camera is named for a view that lies apart with this part of the frames of the camera that has most.
_ALSO_APART = 0.5
# A camera displaced by this part of the largest shift may be the wrong one.
_RIVAL = 0.5


def displaced_cameras(rig: sk.CameraRig, shifts: Shifts) -> list[int]:
    """Return the cameras with detections shifted from the pose, the largest shift first."""
    diagonal = np.array([np.hypot(*camera.size) for camera in rig])
    found = np.flatnonzero(shifts.one_sided(diagonal))
    return sorted((int(i) for i in found), key=lambda i: -shifts.size[i] / diagonal[i])


def find_displaced(
    names: Sequence[str], shifts: Shifts, displaced: Sequence[int], unfit: AbstractSet[str] = frozenset()
) -> Iterator[Finding]:
    """Yield a finding on the camera that is displaced most, with the others.

    Parameters
    ----------
    names
        All cameras.
    displaced
        What `displaced_cameras` returned.
    unfit
        Cameras with another finding whose remedy is to leave them out.
    """
    if not displaced:
        return
    first = displaced[0]
    numbers = {
        "cameras": len(names),
        **shift_of(names, shifts, first, displaced[1:]),
        "median_error_px": float(shifts.error[first]),
    }
    leave = len(names) > 2 and names[first] not in unfit
    remedy = (Remedy("without", names[first]),) if leave else ()
    yield Finding("camera_displaced", "warning", Subject(cameras=(names[first],)), numbers, remedy)


def shift_of(names: Sequence[str], shifts: Shifts, camera: int, others: Sequence[int] = ()) -> dict[str, Any]:
    """Return how far, and to which side, a camera's detections are off the pose, and those of ``others``.

    A wrong camera pulls the pose to its side, so that others are displaced by it. One that is displaced half
    as much may as well be the cause.
    """
    return {
        "shift_px": [float(part) for part in shifts.shift[camera]],
        "size_px": float(shifts.size[camera]),
        "also_displaced": [
            {
                "camera": names[i],
                "size_px": float(shifts.size[i]),
                "may_be_the_cause": bool(shifts.size[i] >= _RIVAL * shifts.size[camera]),
            }
            for i in others
        ],
    }


def find_apart(rig: sk.CameraRig, statistics: Statistics, known: AbstractSet[int]) -> Iterator[Finding]:
    """Yield a finding if some views as a whole are far from the pose; cameras ``known`` are left out."""
    apart = views_apart(statistics.residual, gates_px(rig))
    apart[:, list(known)] = False
    frames = apart.any(axis=1)
    if frames.sum() < _LEAST_FRAMES or frames.mean() < MIXED:
        return
    share = apart.mean(axis=0)
    named = np.flatnonzero((share > 0) & (share >= _ALSO_APART * share.max()))
    numbers = {
        "any_share_of_frames": float(frames.mean()),
        "share_of_frames": [float(share[i]) for i in named],
    }
    yield Finding("views_apart", "warning", Subject(cameras=tuple(rig.names[i] for i in named)), numbers)

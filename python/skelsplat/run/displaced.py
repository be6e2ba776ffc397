"""Doubts from where detections lie beside the pose, in words: always of a camera, or in some frames."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING

import numpy as np

from skelsplat._crowd import MIXED, gates_px
from skelsplat._displaced import views_apart

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from collections.abc import Set as AbstractSet

    import skelsplat as sk
    from skelsplat._displaced import Shifts
    from skelsplat.run.summary import Statistics

# Fewer frames are no habit.
_LEAST_FRAMES = 3
# A camera is named for a view that lies apart with this part of the frames of the camera that has most.
_ALSO_APART = 0.5
# A camera displaced by this part of the largest shift may be the wrong one.
_RIVAL = 0.5
# A direction is named from this part of the shift on.
_DIRECTION = 0.1


def displaced_cameras(rig: sk.CameraRig, shifts: Shifts) -> list[int]:
    """Return the cameras whose detections lie to one side of the pose, the largest shift first."""
    diagonal = np.array([np.hypot(*camera.size) for camera in rig])
    found = np.flatnonzero(shifts.one_sided(diagonal))
    return sorted((int(i) for i in found), key=lambda i: -shifts.size[i] / diagonal[i])


def displaced_doubts(
    names: Sequence[str], shifts: Shifts, displaced: Sequence[int], unfit: AbstractSet[str] = frozenset()
) -> Iterator[str]:
    """Name the camera that is displaced most, and the others in the same sentence.

    Parameters
    ----------
    names
        All cameras.
    displaced
        What `displaced_cameras` returned.
    unfit
        Cameras for which it has been said how to leave them out.
    """
    if not displaced:
        return
    first, others = displaced[0], displaced[1:]
    if len(names) == 2:
        yield (
            f"The calibration or timing of one of the two cameras looks wrong: {names[first]}'s detections "
            f"lie {_with_error(shifts, first)}. It is impossible to tell which is wrong; skelsplat "
            "check-cameras looks for the cause."
        )
        return
    other = ", or that of another of the three" if len(names) == 3 else ""  # which do not always tell
    leave = f"; --without {shlex.quote(names[first])} leaves it out" if names[first] not in unfit else ""
    whose = f"{names[first]}'s" if other else "its"
    also = also_displaced(names, shifts, others, first)
    yield (
        f"{names[first]}'s calibration or timing looks wrong{other}: {whose} detections lie "
        f"{_with_error(shifts, first)}{also}. skelsplat check-cameras looks for the cause{leave}."
    )


def to_one_side(shifts: Shifts, camera: int) -> str:
    """Return how far and where a camera's detections lie: "18 px to one side of the pose (…)"."""
    x, y = shifts.shift[camera]
    size = shifts.size[camera]
    words = ((x, "right" if x > 0 else "left"), (y, "down" if y > 0 else "up"))
    parts = [f"{abs(part):.0f} px {word}" for part, word in words if abs(part) >= _DIRECTION * size]
    return f"{size:.0f} px to one side of the pose ({', '.join(parts)})"


def also_displaced(names: Sequence[str], shifts: Shifts, others: Sequence[int], than: int) -> str:
    """Return "; cam_01's lie 13 px to one side as well"; empty without others.

    A wrong camera pulls the pose to its side, so that others are displaced by it. One that is displaced half
    as much as the camera ``than`` may as well be the cause.
    """
    if not others:
        return ""
    them = [f"{names[i]}'s {'lie ' * (k == 0)}{shifts.size[i]:.0f} px" for k, i in enumerate(others)]
    rivals = [names[i] for i in others if shifts.size[i] >= _RIVAL * shifts.size[than]]
    may = f", so it may be {' or '.join(rivals)} instead" if rivals else ""
    return f"; {', '.join(them)} to one side as well{may}"


def _with_error(shifts: Shifts, camera: int) -> str:
    return f"{to_one_side(shifts, camera)}, with a median error of {shifts.error[camera]:.1f} px"


def apart_doubts(rig: sk.CameraRig, statistics: Statistics, known: AbstractSet[int]) -> Iterator[str]:
    """Say in how many frames some view as a whole lies elsewhere, but of cameras ``known`` for that."""
    apart = views_apart(statistics.residual, gates_px(rig))
    apart[:, list(known)] = False
    frames = apart.any(axis=1)
    if frames.sum() < _LEAST_FRAMES or frames.mean() < MIXED:
        return
    share = apart.mean(axis=0)
    named = np.flatnonzero((share > 0) & (share >= _ALSO_APART * share.max()))
    where = ", ".join(f"{rig.names[i]} in {100 * share[i]:.0f}%" for i in named)
    yield (
        f"In {100 * frames.mean():.0f}% of the frames, the detections of a camera lie far from the pose as a "
        f"whole ({where}). The cameras show different people or different moments there, or a calibration is "
        "wrong: look at these frames; skelsplat check-cameras looks for a cause in the cameras."
    )

"""A cause in words, with what explains nearly as much and with how few frames say it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from skelsplat.rig_check._findings import Finding, once_right
from skelsplat.rig_check._resection import angle_between, turn_between
from skelsplat.rig_check._scene import named

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skelsplat.rig_check._cause import Cause
    from skelsplat.rig_check._scene import Scene

# a turn about the optical axis is no shift of the picture
_ROLL = 0.25
# Frames that fit a camera this much worse than the best do so nearly as well.
_FITS = 1.05
# What fewer frames say may be chance.
_FEW = 12


def finding_of(scene: Scene, cause: Cause, earlier: Sequence[Finding], rivals: Sequence[Cause]) -> Finding:
    """Return the finding of a cause in a scene in which `earlier` ones are set right."""
    name = named(scene.cameras)[cause.view]
    errors: dict[str, Any] = {
        "before_px": float(scene.left_out[cause.view]),
        "after_px": float(cause.scene.left_out[cause.view]),
    }
    once = once_right(earlier, name)  # the errors are of the scene in which the earlier are put right
    change = (
        f"{errors['before_px']:.1f} px off what the others say{once}, with that put right "
        f"{errors['after_px']:.1f} px"
    )
    text, numbers = _WORDS[cause.kind](scene, cause, name, change)
    numbers |= errors
    if rivals:
        numbers["rivals"] = [_rival(scene, rival) for rival in rivals]
        text += _of_rivals(scene, cause, rivals)
    if len(scene.judged) < _FEW:
        frames = "1 frame says" if len(scene.judged) == 1 else f"{len(scene.judged)} frames say"
        text += f" Only {frames} so: give more."
    return Finding(cause.kind, (name,), text, numbers)


def _offset(scene: Scene, cause: Cause, name: str, change: str) -> tuple[str, dict[str, Any]]:
    shift, least, most = _shifts(scene, cause)
    ends = sorted((abs(least), abs(most)))
    also = f" ({ends[0]} to {ends[1]} fit nearly as well)" if least < most else ""
    text = (
        f"{name}: its frame numbers are {abs(shift)} too {'high' if shift > 0 else 'low'}{also}, its frame "
        f"f{shift:+d} belongs to frame f of the others ({change})."
    )
    return text, {"frames": shift, "frames_nearly_as_good": [least, most]}


def _shifts(scene: Scene, cause: Cause) -> tuple[int, int, int]:
    """Return by how many frames a camera is out of step, and the range about it that fits nearly as well."""
    mended, view = cause.scene, cause.view
    points, best, before = mended.points_without(view), mended.shifts[view], scene.shifts[view]
    limit = _FITS * mended.error(view, points)

    def end(step: int) -> int:
        shift = best
        while shift + step != before and mended.error(view, points, shift + step) <= limit:
            shift += step
        return shift - before

    return best - before, end(-1), end(1)


def _resized(_scene: Scene, cause: Cause, name: str, change: str) -> tuple[str, dict[str, Any]]:
    text = (
        f"{name}: the detections are of images of another size; multiplied by {cause.factor:.3g} they "
        f"fit ({change})."
    )
    return text, {"factor": cause.factor}


def _images(_scene: Scene, cause: Cause, name: str, change: str) -> tuple[str, dict[str, Any]]:
    return f"{name}: its images are {cause.words} ({change}).", {}


def _pose(scene: Scene, cause: Cause, name: str, change: str) -> tuple[str, dict[str, Any]]:
    degrees, mm = _moved_by(scene, cause)
    text = (
        f"{name} does not stand as its calibration says: {_how(degrees, mm)} it agrees with the other "
        f"cameras ({change}). It was moved since, or the calibration is another camera's or another image's."
    )
    old, new = scene.cameras[cause.view], cause.scene.cameras[cause.view]
    axis = turn_between(old, new)
    if cause.kind == "turned" and abs(axis[2]) < _ROLL * np.linalg.norm(axis):
        shift = float(np.hypot(axis[1], axis[0]) * np.asarray(old.K)[0, 0])
        text += f" A picture shifted by {shift:.0f} px (a crop, a principal point) would look the same."
    return text, {"degrees": degrees, "mm": mm}


def _moved_by(scene: Scene, cause: Cause) -> tuple[float, float]:
    """Return the degrees by which a camera is turned, and the mm by which it is moved."""
    old, new = scene.cameras[cause.view], cause.scene.cameras[cause.view]
    distance = float(np.linalg.norm(np.asarray(old.centre) - np.asarray(new.centre)))
    return angle_between(old, new), distance if cause.kind == "moved" else 0.0


def _how(degrees: float, mm: float) -> str:
    return f"turned by {degrees:.1f}°" + (f" and moved by {mm:.0f} mm" if mm else "")


_WORDS = {"offset": _offset, "resized": _resized, "images": _images, "turned": _pose, "moved": _pose}


def _rival(scene: Scene, rival: Cause) -> dict[str, Any]:
    kind = {"camera": named(scene.cameras)[rival.view], "kind": rival.kind}
    return {**kind, "mean_px": rival.scene.disagreement}


def _of_rivals(scene: Scene, cause: Cause, rivals: Sequence[Cause]) -> str:
    """Return a sentence on what else makes the cameras agree nearly as well."""
    others = " or ".join(_briefly(scene, rival) for rival in rivals)
    means = " or ".join(f"{rival.scene.disagreement:.1f}" for rival in rivals)
    return (
        f" Nearly as well the cameras agree with {others} (on average {means} px instead of "
        f"{cause.scene.disagreement:.1f})."
    )


def _briefly(scene: Scene, cause: Cause) -> str:
    name = named(scene.cameras)[cause.view]
    if cause.kind == "offset":
        shift = cause.scene.shifts[cause.view] - scene.shifts[cause.view]
        return f"{name}'s frame numbers {abs(shift)} too {'high' if shift > 0 else 'low'}"
    if cause.kind == "resized":
        return f"{name}'s detections of images of another size"
    if cause.kind == "images":
        return f"{name}'s images {cause.words}"
    return f"{name} {_how(*_moved_by(scene, cause))}"

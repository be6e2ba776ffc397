"""Whether all poses of a calibration are in another program's convention, tried out on a recording.

=============  ===================================================================================
inverse        camera → world given for world → camera: R' = Rᵀ, t' = −Rᵀ t
axes           y up and z backward (OpenGL, Blender) for y down and z forward: F = diag(1, −1, −1),
               R' = F R, t' = F t
both           camera → world with these axes: R' = F Rᵀ, t' = −F Rᵀ t
=============  ===================================================================================
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import skelsplat as sk
from skelsplat.rig_check._findings import Finding
from skelsplat.rig_check._people import is_gross, judge, some_frames
from skelsplat.rig_check._scene import Array, in_mm

if TYPE_CHECKING:
    from collections.abc import Callable

# what is left of the disagreement when the convention is right
_BETTER = 0.35
_AXES = np.diag([1.0, -1.0, -1.0])


def _inverse(R: Array, t: Array) -> tuple[Array, Array]:
    return R.T, -R.T @ t


def _axes(R: Array, t: Array) -> tuple[Array, Array]:
    return _AXES @ R, _AXES @ t


_CONVENTIONS: dict[str, tuple[str, Callable[[Array, Array], tuple[Array, Array]]]] = {
    "inverse": ("camera → world instead of world → camera", _inverse),
    "axes": ("with y up and z backward (OpenGL, Blender) instead of y down and z forward", _axes),
    "both": (
        "camera → world with y up and z backward (OpenGL, Blender)",
        lambda R, t: _axes(*_inverse(R, t)),
    ),
}


def find_convention(
    rig: sk.CameraRig, people: Array, layout: sk.Layout | None
) -> tuple[Finding | None, sk.CameraRig]:
    """Say in which convention the poses of all cameras are, if not in this package's; and set it right.

    Parameters
    ----------
    rig
        The M cameras.
    people : (T, M, P, N, 2)
        Everybody's detections.
    layout
        As for `check_rig`.

    Returns
    -------
    finding, rig
        None and the rig as given, or the finding and the rig with which the cameras agree.
    """
    some = people[some_frames(len(people))]
    before = judge(in_mm(rig), some, layout)
    if not is_gross(before):
        return None, rig
    rigs = {kind: _changed(rig, change) for kind, (_, change) in _CONVENTIONS.items()}
    tried = {kind: judge(in_mm(other), some, layout) for kind, other in rigs.items()}
    kind = min(tried, key=lambda name: tried[name].disagreement)
    after = tried[kind].disagreement
    if is_gross(tried[kind]) or not after <= _BETTER * before.disagreement:
        return None, rig
    text = (
        f"The poses of all cameras seem to be {_CONVENTIONS[kind][0]}: read so, the cameras agree to "
        f"{after:.1f} px, as given to {before.disagreement:.0f} px. Convert the calibration before using it."
    )
    numbers = {"before_px": before.disagreement, "after_px": after}
    return Finding("convention", (), text, numbers), rigs[kind]


def _changed(rig: sk.CameraRig, change: Callable[[Array, Array], tuple[Array, Array]]) -> sk.CameraRig:
    made = []
    for camera in rig:
        R, t = change(np.asarray(camera.R), np.asarray(camera.t))
        made.append(
            sk.Camera(
                camera.K,
                R,
                t,
                distortion=camera.distortion,
                fisheye=camera.fisheye,
                size=camera.size,
                name=camera.name,
            )
        )
    return sk.CameraRig(made, unit=rig.unit)

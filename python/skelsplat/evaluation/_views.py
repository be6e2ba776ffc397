"""Takes seen by some of their cameras only, and cameras without their lens."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from skelsplat._skelsplat import Camera
from skelsplat.cameras import CameraRig
from skelsplat.datasets import Take
from skelsplat.exceptions import DatasetError


def with_views(take: Take, numbers: Sequence[int]) -> Take:
    """Return the take as cameras with these numbers see it, in this order.

    A camera's number is the one at the end of its name ("00_13" is 13), or its place in a rig without names.
    Monocular poses are cut with the views if there is one per camera.

    Raises
    ------
    DatasetError
        If a number is missing or two cameras have it.
    """
    own = [_number(name) for name in take.rig.names]
    for number in numbers:
        if own.count(number) != 1:
            named = ", ".join(take.rig.names)
            raise DatasetError(take.key, "cameras", f"one camera with number {number}", named)
    index = [own.index(number) for number in numbers]
    mono = take.monocular
    if mono is not None and mono.shape[1] == len(take.rig):
        mono = mono[:, index]
    return replace(
        take,
        rig=CameraRig([take.rig[i] for i in index], take.rig.unit),
        detections=None if take.detections is None else take.detections[:, index],
        monocular=mono,
        boxes=None if take.boxes is None else take.boxes[:, index],
        visible=None if take.visible is None else take.visible[:, index],
    )


def _number(name: str) -> int | None:
    found = re.search(r"(\d+)$", name)
    return int(found.group(1)) if found else None


def has_every_view(take: Take) -> NDArray[np.bool_]:
    """Whether every view detects some joint, (T,); True where the take has no detections."""
    if take.detections is None:
        return np.ones(len(take), dtype=np.bool_)
    seen = np.isfinite(take.detections[..., :2]).all(axis=-1) & (take.detections[..., 2] > 0)
    return np.asarray(seen.any(axis=-1).all(axis=-1))


def without_lens(rig: CameraRig) -> CameraRig:
    """Return the cameras with K alone: what `RefineConfig(undistort=False)` and published code take."""
    return CameraRig([Camera(c.K, c.R, c.t, size=c.size, name=c.name) for c in rig], rig.unit)

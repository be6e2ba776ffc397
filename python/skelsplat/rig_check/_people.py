"""The person by whom the cameras are judged, and how well they agree on them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skelsplat.association import choose_person, extents
from skelsplat.rig_check._scene import Array, Index, Scene, scene_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    import skelsplat as sk

_FRAMES = 30
# Cameras that miss each other's joints by more than this share of the diagonal (20 px at 1700 px) are worth
# a search.
_GROSS = 0.012
# A camera in which the chosen person is found in fewer frames is judged by whoever is there.
_LOST = 0.2


def some_frames(count: int) -> Index:
    """Places of a few frames, spread over the recording."""
    return np.unique(np.linspace(0, count - 1, min(_FRAMES, count)).round().astype(np.int64))


def is_gross(scene: Scene) -> bool:
    """Whether the cameras disagree by more than poor detections do."""
    return bool(scene.disagreement > gross_px(scene))


def gross_px(scene: Scene) -> float:
    """Return the mean disagreement in px from which a search is worth it."""
    return _GROSS * float(np.mean([np.hypot(*camera.size) for camera in scene.cameras]))


def judge(cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None) -> Scene:
    """Return the scene of the person that is followed."""
    return scene_of(cameras, follow(cameras, people, layout), np.arange(len(people)))


def follow(cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None) -> Array:
    """Return one person's detections (T, M, N, 2), also in a view that no other view agrees with.

    A camera in which the person is almost never found, although people are there, may be wrong; the largest
    person of each of its images then stands in.
    """
    if people.shape[2] == 1 or len(cameras) < 2:
        return people[:, :, 0, :, :2]
    chosen, index = choose_person(people, cameras, layout=layout)
    places = extents(people).argmax(axis=2)
    there = np.isfinite(people[..., 0]).any(axis=(2, 3))
    found = (index >= 0).sum(axis=0) / np.maximum(there.sum(axis=0), 1)
    fallback = np.take_along_axis(people, places[:, :, None, None, None], axis=2)[:, :, 0]
    lost = found < _LOST
    followed: Array = np.where(lost[None, :, None, None], fallback, chosen)[..., :2]
    return followed

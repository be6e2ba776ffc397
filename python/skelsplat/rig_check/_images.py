"""Detections of other images than the calibration's: resized, turned, mirrored, x and y exchanged."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skelsplat.rig_check._findings import Finding
from skelsplat.rig_check._people import is_gross, judge, some_frames
from skelsplat.rig_check._scene import Array, Scene

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import skelsplat as sk

    Change = Callable[[Array, tuple[int, int]], Array]

# the right change must leave less than this part of the disagreement
_BETTER = 0.35
_FACTORS = (1 / 4, 1 / 3, 3 / 8, 1 / 2, 2 / 3, 3 / 4, 4 / 3, 3 / 2, 2.0, 8 / 3, 3.0, 4.0)


def _upside_down(points: Array, size: tuple[int, int]) -> Array:
    turned: Array = np.array([size[0] - 1.0, size[1] - 1.0]) - points
    return turned


def _mirrored(points: Array, size: tuple[int, int]) -> Array:
    return np.stack([size[0] - 1.0 - points[..., 0], points[..., 1]], axis=-1)


def _turned_right(points: Array, size: tuple[int, int]) -> Array:
    """Undo a quarter turn clockwise, (x, y) → (h − 1 − y, x)."""
    return np.stack([points[..., 1], size[1] - 1.0 - points[..., 0]], axis=-1)


def _turned_left(points: Array, size: tuple[int, int]) -> Array:
    return np.stack([size[0] - 1.0 - points[..., 1], points[..., 0]], axis=-1)


def _exchanged(points: Array, size: tuple[int, int]) -> Array:  # noqa: ARG001  the signature of a change
    swapped: Array = points[..., ::-1]
    return swapped


def _fractions(points: Array, size: tuple[int, int]) -> Array:
    pixels: Array = points * np.array(size) - 0.5
    return pixels


# what the images are → how the detections become those of the calibration's images
CHANGES: dict[str, Change] = {
    "upside down": _upside_down,
    "mirrored": _mirrored,
    "turned clockwise by a quarter": _turned_right,
    "turned anticlockwise by a quarter": _turned_left,
}
_FOR_ALL: dict[str, Change] = {
    **CHANGES,
    "given with y before x": _exchanged,
    "given as parts of the image's width and height": _fractions,
}


def find_images(
    cameras: Sequence[sk.Camera], people: Array, layout: sk.Layout | None
) -> tuple[Finding | None, Array, float]:
    """Say whether the detections of all cameras are of other images.

    Returns the finding (None: they are not), the people set right, and the factor on lengths in that.
    """
    some = people[some_frames(len(people))]
    before = judge(cameras, some, layout)
    if not is_gross(before):
        return None, people, 1.0

    def disagreement(tried: tuple[str, Change, float]) -> float:
        """Return it in pixels of the detections as they are: small images make small errors."""
        return judge(cameras, _applied(some, cameras, tried[1]), layout).disagreement / tried[2]

    best = min(_tries(), key=disagreement)
    after = disagreement(best)
    if not after < _BETTER * before.disagreement:
        return None, people, 1.0
    text = (
        f"The detections of all cameras are {best[0]}: with that undone the cameras are {after:.1f} px off "
        f"what the others say, as it is {_px(before.disagreement)}."
    )
    numbers = {"before_px": before.disagreement, "after_px": after}
    return Finding("images", (), text, numbers), _applied(people, cameras, best[1]), best[2]


def _tries() -> Iterator[tuple[str, Change, float]]:
    """Yield what the images may be, the change that undoes it, and the factor on lengths in it."""
    for words, change in _FOR_ALL.items():
        yield words, change, 1.0
    for factor in _FACTORS:
        yield f"of images {1 / factor:.3g} times as large", resizer(factor), factor


def resizer(factor: float) -> Change:
    """Return the change that undoes resizing by 1 / factor."""
    # integers are pixel centres
    return lambda points, size: (points + 0.5) * factor - 0.5  # noqa: ARG005


def _px(error: float) -> str:
    return f"{error:.0f} px" if np.isfinite(error) else "nowhere near it"


def _applied(people: Array, cameras: Sequence[sk.Camera], change: Change) -> Array:
    changed = people.copy()
    for i, camera in enumerate(cameras):
        changed[:, i, ..., :2] = change(people[:, i, ..., :2], camera.size)
    return changed


def changed_view(scene: Scene, view: int, change: Change) -> Scene:
    """Return the scene with one camera's detections changed."""
    return scene.with_detections(view, change(scene.detections[:, view], scene.cameras[view].size))

"""What is drawn of a body: limbs, sides, error ellipses, and the two directions it is looked at from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.patches import Ellipse

from skelsplat._arrays import Array
from skelsplat.viz import _style

SIGMAS = 2.0  # of an error ellipse

# Mean resultant length below which left-to-right directions do not agree on one heading:
# the mean of directions spread evenly over 270 degrees has length 0.3.
_STEADY_HEADING = 0.3


@dataclass(frozen=True)
class Skeleton:
    """The connections of ``N`` joints."""

    limbs: tuple[tuple[int, int], ...] = ()  # pairs of joint indices; empty for points alone
    left_right: tuple[tuple[int, int], ...] = ()  # (left joint, right joint): sides and heading
    own: str | None = None  # the colour of one of several people, instead of the sides'

    def colour(self, joint: int) -> str:
        """Return the colour of a joint's side: left, right or middle; or the one of all joints."""
        if self.own is not None:
            return self.own
        if any(joint == left for left, _ in self.left_right):
            return _style.LEFT
        if any(joint == right for _, right in self.left_right):
            return _style.RIGHT
        return _style.MIDDLE

    def limb_colour(self, limb: tuple[int, int]) -> str:
        """Return the colour of a limb: that of its side if either end has one and the ends do not differ."""
        sides = {self.colour(joint) for joint in limb} - {_style.MIDDLE}
        return sides.pop() if len(sides) == 1 else _style.MIDDLE


def not_ok_in_words(status: npt.NDArray[np.str_]) -> str:
    """Return which statuses other than ``"ok"`` occur, for a legend, such as ``"weak"``."""
    return ", ".join(name for name in ("inferred", "weak", "filled", "unobserved") if (status == name).any())


def body_axes(
    poses: Array, left_right: tuple[tuple[int, int], ...], up: Array, *, frame: int = 0
) -> tuple[Array, Array, bool]:
    """Return unit vectors (3,) to the body's left and front, orthogonal to ``up``, and if they are known.

    Left is the mean of the horizontal left-minus-right unit vectors of all pairs in a frame of ``poses``
    (T, N, 3). Where these cancel or are unknown, those of all frames are used; without pairs, the direction
    in which the joints spread most.
    """
    left = _mean_heading(poses[frame : frame + 1], left_right, up)
    if np.linalg.norm(left) < _STEADY_HEADING:
        left = _mean_heading(poses, left_right, up)
    known = bool(np.linalg.norm(left) >= _STEADY_HEADING)
    if not known:
        left = _widest_direction(poses[frame], up)
    left = left / np.linalg.norm(left)
    return left, np.cross(left, up), known


def _horizontal(vectors: Array, up: Array) -> Array:
    return vectors - (vectors @ up)[..., None] * up


def _mean_heading(poses: Array, left_right: tuple[tuple[int, int], ...], up: Array) -> Array:
    """Return the mean of the unit left-minus-right vectors, (3,); its length measures how well they agree."""
    if not left_right:
        return np.zeros(3)
    pairs = np.asarray(left_right)
    across = _horizontal(poses[:, pairs[:, 0]] - poses[:, pairs[:, 1]], up).reshape(-1, 3)
    length = np.linalg.norm(across, axis=1)
    known = length > 0  # False for NaN
    if not known.any():
        return np.zeros(3)
    mean: Array = (across[known] / length[known, None]).mean(axis=0)
    return mean


def _widest_direction(pose: Array, up: Array) -> Array:
    """Return the horizontal direction of largest spread of a pose (N, 3), or any if it has no spread."""
    known = pose[np.isfinite(pose).all(axis=1)]
    flat = _horizontal(known - known.mean(axis=0), up) if len(known) else np.zeros((1, 3))
    direction: Array = np.linalg.svd(flat, full_matrices=True)[2][0]
    direction = _horizontal(direction, up)
    if np.linalg.norm(direction) < 1e-9:
        direction = _horizontal(np.eye(3)[np.argmin(np.abs(up))], up)
    return direction


def draw_limbs(axes: Axes, points: Array, skeleton: Skeleton, **line: object) -> None:
    """Draw the limbs of ``points`` (N, 2) whose two ends are known; without ``color``, in their sides'."""
    colour = line.pop("color", None)
    for a, b in skeleton.limbs:
        ends = points[[a, b]]
        if np.isfinite(ends).all():
            axes.plot(ends[:, 0], ends[:, 1], color=colour or skeleton.limb_colour((a, b)), **line)  # type: ignore[arg-type]


def draw_ellipses(axes: Axes, centres: Array, covariances: Array, colours: Sequence[str]) -> None:
    """Draw the ellipse of `SIGMAS` standard deviations of every point (N, 2); none where anything is NaN."""
    known = np.isfinite(centres).all(axis=1) & np.isfinite(covariances).all(axis=(1, 2))
    patches, shown = [], []
    for j in np.flatnonzero(known):
        values, vectors = np.linalg.eigh(covariances[j])
        height, width = 2 * SIGMAS * np.sqrt(np.maximum(values, 0.0))
        angle = float(np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1])))
        patches.append(Ellipse((centres[j, 0], centres[j, 1]), width, height, angle=angle))
        shown.append(colours[int(j)])
    collection = PatchCollection(patches, facecolors=shown, edgecolors=shown, alpha=0.28, zorder=2.5)
    axes.add_collection(collection, autolim=False)

"""What is drawn of a body: limbs and sides, error ellipses, and its place in the world and in images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection

from skelsplat._arrays import Array
from skelsplat.viz import _style

SIGMAS = 2.0  # of an error ellipse
Window = tuple[tuple[int, int], tuple[int, int]]
_PAD = 0.08  # of the person's longer side, around the crop
_LEAST_PX = 40.0
# Places beyond these percentiles may be stray.
_MOST = (1.0, 99.0)


@dataclass(frozen=True)
class Skeleton:
    """The connections of ``N`` joints."""

    limbs: tuple[tuple[int, int], ...] = ()  # pairs of joint indices; empty for points alone
    left_right: tuple[tuple[int, int], ...] = ()  # (left joint, right joint): sides and heading
    own: str | None = None  # the colour of one of several people, instead of the sides'

    def side(self, joint: int) -> str:
        """Return ``"left"``, ``"right"`` or ``"middle"``."""
        left, right = zip(*self.left_right, strict=True) if self.left_right else ((), ())
        return "left" if joint in left else "right" if joint in right else "middle"

    def colour(self, joint: int) -> str:
        """Return the colour of a joint's side: left, right or middle; or the one of all joints."""
        return self.own or _style.SIDES[self.side(joint)]

    def limb_colour(self, limb: tuple[int, int]) -> str:
        """Return the colour of a limb: that of its side if either end has one and the ends do not differ."""
        sides = {self.colour(joint) for joint in limb} - {_style.MIDDLE}
        return sides.pop() if len(sides) == 1 else _style.MIDDLE


def not_ok_in_words(status: npt.NDArray[np.str_]) -> str:
    """Return which statuses other than ``"ok"`` occur, for a legend, such as ``"weak"``."""
    return ", ".join(name for name in ("inferred", "weak", "filled", "unobserved") if (status == name).any())


def draw_limbs(axes: Axes, points: Array, skeleton: Skeleton, **line: Any) -> None:
    """Draw the limbs of ``points`` (N, 2) whose two ends are known; without ``color``, in their sides'."""
    colour = line.pop("color", None)
    for a, b in skeleton.limbs:
        if np.isfinite(points[[a, b]]).all():
            axes.plot(*points[[a, b]].T, color=colour or skeleton.limb_colour((a, b)), **line)


def draw_points(axes: Axes, points: Array, **style: Any) -> None:
    """Draw a mark at every point (N, 2)."""
    axes.scatter(points[:, 0], points[:, 1], **style)


def draw_ellipses(axes: Axes, centres: Array, covariances: Array, colours: Sequence[str]) -> None:
    """Draw the ellipse of `SIGMAS` standard deviations of every point (N, 2); none where anything is NaN."""
    known = np.isfinite(centres).all(axis=1) & np.isfinite(covariances).all(axis=(1, 2))
    values, vectors = np.linalg.eigh(covariances[known])
    heights, widths = 2 * SIGMAS * np.sqrt(np.maximum(values.T, 0.0))
    angles = np.degrees(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1]))
    place: dict[str, Any] = {"units": "xy", "offsets": centres[known], "offset_transform": axes.transData}
    ink = np.array(colours)[known].tolist()
    axes.add_collection(
        EllipseCollection(widths, heights, angles, facecolors=ink, alpha=0.28, zorder=2.5, **place),
        autolim=False,
    )


def upright(up: Array) -> tuple[Array, list[str]]:
    """Return the rotation (3, 3) that turns ``up``, an axis of the world, into z, and the axes' names.

    The rows are axes of the world or their opposites, so that coordinates stay those of the world up to sign.
    """
    third = np.rint(np.asarray(up, dtype=np.float64))
    first = np.zeros(3)
    first[(int(np.argmax(np.abs(third))) + 1) % 3] = 1.0
    turn = np.stack([first, np.cross(third, first), third])
    names = [("−" if row.sum() < 0 else "") + "xyz"[int(np.argmax(np.abs(row)))] for row in turn]
    return turn, names


def reach(places: Array, margin: float) -> tuple[Array, Array]:
    """Return the corners (D,) of the box of places (…, D); 1 m about 0 without any.

    Stray places do not widen it by more than the margin, nor by more than its own half size.
    """
    known = places[np.isfinite(places).all(axis=-1)]
    if not len(known):
        return np.full(places.shape[-1], -500.0), np.full(places.shape[-1], 500.0)
    low, high = np.percentile(known, _MOST, axis=0)
    margin = min(margin, float((high - low).max()) / 2)
    return np.maximum(known.min(axis=0), low - margin), np.minimum(known.max(axis=0), high + margin)


def person_window(points: Array, size: tuple[int, int]) -> Window:
    """Return the first and last column and row with the ``points`` (K, 2) in an image and a margin.

    Without any of them in the image, it is the whole.
    """
    limit = np.array(size)
    inside = (points >= -0.5).all(axis=1) & (points < limit - 0.5).all(axis=1)
    if not inside.any():
        return (0, size[0] - 1), (0, size[1] - 1)
    low, high = points[inside].min(axis=0), points[inside].max(axis=0)
    side = np.maximum(high - low, _LEAST_PX)
    half, centre = side / 2 + _PAD * side.max(), (low + high) / 2
    first = np.maximum(np.floor(centre - half), 0).astype(int).tolist()
    last = np.minimum(np.ceil(centre + half), limit - 1).astype(int).tolist()
    return (first[0], last[0]), (first[1], last[1])


def aspect(window: Window) -> float:
    """Return height over width of a window."""
    (left, right), (top, bottom) = window
    return (bottom - top + 1) / (right - left + 1)

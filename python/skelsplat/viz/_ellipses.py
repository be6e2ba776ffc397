"""Error ellipses: what a plane shows of the joints' covariances."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.patches import Ellipse

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt
    from matplotlib.axes import Axes

    Array = npt.NDArray[np.float64]

SIGMAS = 2.0


def draw_ellipses(axes: Axes, centres: Array, covariances: Array, colours: Sequence[str]) -> None:
    """Draw the ellipse of `SIGMAS` standard deviations about every point; none where anything is NaN.

    That of a projected ellipsoid: the outline of the points within `SIGMAS` of the joint, seen along the
    direction of projection.

    Parameters
    ----------
    axes
        Where to draw.
    centres : (N, 2)
        In the axes' own coordinates.
    covariances : (N, 2, 2)
        In these, squared.
    colours
        One per point.
    """
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

"""OpenCV's triangulation, of two views."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike

from skelsplat._arrays import Array
from skelsplat.evaluation.baselines._observations import Cameras, homogeneous_to_world, observe


def opencv_dlt(detections: ArrayLike, cameras: Cameras) -> Array:
    """Triangulate by ``cv2.triangulatePoints`` from the first two views that see the joint.

    OpenCV triangulates from two views only, so this is the whole answer of a stereo rig; with more views the
    others are not used. Joints are passed together for each pair of views.
    A joint that fewer than two views see is NaN.
    """
    joints = observe(detections, cameras)
    points = np.full((len(joints.seen), 3), np.nan)
    first_two = np.argsort(~joints.seen, axis=1, kind="stable")[:, :2]
    determined = joints.determined
    for a, b in np.unique(first_two[determined], axis=0):
        own = determined & (first_two == (a, b)).all(axis=1)
        found = cv2.triangulatePoints(
            joints.projections[a], joints.projections[b], joints.pixels[own, a].T, joints.pixels[own, b].T
        )
        points[own] = homogeneous_to_world(found.T)
    return joints.points(points)

"""What other programs' scripts read: Anipose's csv and FreeMoCap's npy."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat._atomic import atomic_write, atomic_write_text
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.io.poses._csv import csv_text
from skelsplat.io.poses._pose_data import PoseData, Poses, over_views, parts_of

_OF_JOINT = ("x", "y", "z", "error", "ncams", "score")
# the turn and origin that Anipose may have given its poses; these are in the world of the cameras
_WORLD = {
    **{f"M_{row}{column}": float(row == column) for row in range(3) for column in range(3)},
    **{f"center_{axis}": 0.0 for axis in range(3)},
}


def write_anipose(path: str | os.PathLike[str], data: Poses) -> None:
    """Write a row per frame as Anipose's ``triangulate`` does, in the unit of `data`, which is not stated.

    Of each joint ``NAME_x``, ``_y``, ``_z``, ``_error`` (mean reprojection error in px), ``_ncams`` (views
    that were used) and ``_score`` (their mean weight), then ``M_00`` to ``center_2`` of the world, and
    ``fnum``, the frame number. What is missing is an empty field.
    """
    head, _, parts = parts_of(data)
    columns = [f"{joint}_{part}" for joint in head.joint_names for part in _OF_JOINT]
    header = csv_text([[*columns, *_WORLD, "fnum"]])
    atomic_write_text(path, header, (csv_text(_rows(part)) for part in parts))


def _rows(data: PoseData) -> Iterator[list[Any]]:
    shape = data.pose.shape[:2]
    seen, errors = over_views(data.reprojection_error) if data.reprojection_error.size else (None, None)
    scores = over_views(data.view_weights)[1] if data.view_weights.size else None
    values = [np.full(shape, np.nan) if one is None else one for one in (errors, seen, scores)]
    table = np.concatenate([data.pose, np.stack(values, axis=-1)], axis=-1).reshape(len(data.frames), -1)
    for frame, row in zip(data.frames.tolist(), table.tolist(), strict=True):
        yield [*("" if math.isnan(value) else value for value in row), *_WORLD.values(), frame]


def write_freemocap(path: str | os.PathLike[str], data: Poses) -> None:
    """Write an array (frames, joints, 3) in mm with NaN for missing, as FreeMoCap's ``…_spatialXYZ.npy``.

    Joints are in the order of the layout: those of ``mediapipe33`` are FreeMoCap's first 33.
    """
    head, frames, parts = parts_of(data)
    factor = MM_PER_UNIT[head.unit]
    shape = (len(frames), len(head.joint_names), 3)
    header = {"descr": "<f8", "fortran_order": False, "shape": shape}
    with atomic_write(path) as stream:
        np.lib.format.write_array_header_1_0(stream, header)
        for part in parts:
            points: Array = part.pose * factor
            stream.write(points.astype("<f8").tobytes())

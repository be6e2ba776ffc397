"""The tidy csv file: one row per frame and joint."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING

import numpy as np

from skelsplat.io._atomic import atomic_write_text

if TYPE_CHECKING:
    import os

    import numpy.typing as npt

    from skelsplat.io.poses._pose_data import Array, PoseData

COLUMNS = ("frame", "joint", "x", "y", "z", "unit", "status", "n_views", "reprojection_error_px")


def write_csv(path: str | os.PathLike[str], data: PoseData) -> None:
    """Write one row per frame and joint, with the columns of `COLUMNS`.

    ``x, y, z`` are in ``unit`` with all their digits, ``n_views`` counts the views that detected the joint,
    and ``reprojection_error_px`` is the mean over them. A value that does not exist is an empty field.

    Raises
    ------
    DatasetError
        If the path cannot be written.
    """
    n_views, errors = _over_views(data)
    buffer = io.StringIO(newline="")
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(COLUMNS)
    for t, frame in enumerate(data.frames.tolist()):
        for j, joint in enumerate(data.joint_names):
            status = str(data.joint_status[t, j]) if data.joint_status.size else ""
            views, error = (n_views[t, j], _field(errors[t, j])) if n_views.size else ("", "")
            place = [_field(value) for value in data.pose[t, j]]
            writer.writerow([frame, joint, *place, data.unit, status, views, error])
    atomic_write_text(path, buffer.getvalue())


def _over_views(data: PoseData) -> tuple[npt.NDArray[np.int64], Array]:
    """Count the views per joint (T, N) and average the reprojection error (T, N), NaN without a view."""
    seen = np.isfinite(data.reprojection_error)
    count = seen.sum(axis=1, dtype=np.int64)
    total = np.where(seen, data.reprojection_error, 0.0).sum(axis=1)
    mean: Array = np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)
    return count, mean


def _field(value: float) -> str:
    return repr(float(value)) if np.isfinite(value) else ""

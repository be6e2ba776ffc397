"""The tidy csv file: one row per frame and joint."""

from __future__ import annotations

import csv
import io
from typing import TYPE_CHECKING

import numpy as np

import skelsplat as sk
from skelsplat.io._atomic import atomic_write_text

if TYPE_CHECKING:
    import os

    import numpy.typing as npt

    from skelsplat.io.poses._pose_data import Array, PoseData

COLUMNS = (
    *("frame", "joint", "x", "y", "z", "sx", "sy", "sz", "unit"),
    *("status", "n_views", "n_rejected", "reprojection_error_px"),
)


def write_csv(path: str | os.PathLike[str], data: PoseData) -> None:
    """Write one row per frame and joint, with the columns of `COLUMNS`.

    ``x, y, z`` and their standard deviations ``sx, sy, sz`` (from `PoseData.uncertainty`) are in ``unit``
    with all their digits, ``n_views`` counts the views that detected the joint, ``n_rejected`` those of them
    whose weight is below `skelsplat.REJECTED_WEIGHT`, and ``reprojection_error_px`` is the mean over all of
    them. A value that does not exist is an empty field.

    Raises
    ------
    DatasetError
        If the path cannot be written.
    """
    n_views, errors = _over_views(data)
    n_rejected = (data.view_weights < sk.REJECTED_WEIGHT).sum(axis=1)
    deviations = np.sqrt(np.diagonal(data.uncertainty, axis1=-2, axis2=-1))
    buffer = io.StringIO(newline="")
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(COLUMNS)
    for t, frame in enumerate(data.frames.tolist()):
        for j, joint in enumerate(data.joint_names):
            place = [_field(value) for value in data.pose[t, j]]
            spread = [_field(value) for value in deviations[t, j]] if deviations.size else ["", "", ""]
            status = str(data.joint_status[t, j]) if data.joint_status.size else ""
            views, error = (n_views[t, j], _field(errors[t, j])) if n_views.size else ("", "")
            rejected = n_rejected[t, j] if n_rejected.size else ""
            writer.writerow([frame, joint, *place, *spread, data.unit, status, views, rejected, error])
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

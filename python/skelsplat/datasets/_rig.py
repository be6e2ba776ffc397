"""Building cameras from the values in a file, with errors that name the file and the field."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import FARTHEST, Array
from skelsplat._skelsplat import Camera
from skelsplat.cameras import CameraRig
from skelsplat.datasets._files import as_numbers, require, within
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io import read_calibration


def build_camera(
    path: Path,
    field: str,
    *,
    K: Array,
    R: Array,
    t: Array,
    distortion: Sequence[float] | Array | None,
    size: Sequence[int],
    name: str,
) -> Camera:
    """Return a camera, or raise `DatasetError` with `field` if its values make none.

    A distortion of zeros alone is none.
    """
    lens = None if distortion is None or not np.any(distortion) else distortion
    try:
        return Camera(K, R, t, distortion=lens, size=size, name=name)
    except InvalidInputError as error:
        raise DatasetError(path, field, "a camera", error) from error


def camera_at_centre(path: Path, field: str, entry: Any, *, size: Sequence[int], name: str) -> Camera:
    """Return the camera of a table R, T, fx, fy, cx, cy[, k, p] where x_cam = R (X − T): T is the centre.

    Numbers may be wrapped in arrays of any shape with as many values; ``k`` are three and ``p`` two.
    """

    def values(key: str, count: int) -> Array:
        given = as_numbers(path, within(field, key), require(path, field, entry, key)).ravel()
        if given.shape != (count,) or not (np.abs(given) <= FARTHEST).all():
            expected = f"{count} numbers within ±{FARTHEST:g}"
            raise DatasetError(path, within(field, key), expected, given.tolist())
        return given

    fx, fy, cx, cy = (values(key, 1)[0] for key in ("fx", "fy", "cx", "cy"))
    R, distortion = values("R", 9).reshape(3, 3), None
    if "k" in entry or "p" in entry:
        k, p = values("k", 3), values("p", 2)
        distortion = np.array([k[0], k[1], p[0], p[1], k[2]])
    return build_camera(
        path,
        field,
        K=np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]),
        R=R,
        t=-R @ values("T", 3),
        distortion=distortion,
        size=size,
        name=name,
    )


def build_rig(path: Path, cameras: Sequence[Camera], unit: Any) -> CameraRig:
    """Return the cameras as a rig, or raise `DatasetError`."""
    try:
        return CameraRig(cameras, unit)
    except InvalidInputError as error:
        raise DatasetError(path, "cameras", "a rig", error) from error


def read_quietly(path: Path, format: str, **options: Any) -> CameraRig:
    """Read a calibration without a doubt about its unit: verification by reprojection has the numbers."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return read_calibration(path, format=format, **options)

"""SLEAP analysis files: one h5 per camera.

``tracks`` (tracks, 2, nodes, frames) in pixels, NaN for missing, ``point_scores`` (tracks, nodes, frames) and
``node_names``; frames count from 0. Newer files state the order of the axes in an attribute ``dims``. A score
is the peak of a confidence map: above 1 it counts as 1; a point without one was placed by hand and counts
as 1. Nodes are matched to joints by name. Needs h5py.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._optional import require
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import Array, array_names, as_numbers, hdf5_mentions
from skelsplat.io.detections._format import View, array_view, joints_of

_AXES = ("track", "xy", "node", "frame")
_TRACKS, _SCORES, _NAMES = "tracks", "point_scores", "node_names"


def read_file(path: Path) -> View:
    """Return the view of one camera."""
    h5py = require("h5py", f"{path}: SLEAP's h5")
    try:
        with h5py.File(path, "r") as file:
            tracks, scores = (_dataset(path, file, key) for key in (_TRACKS, _SCORES))
            order = _axes(path, tracks)
            names = np.asarray(_dataset(path, file, _NAMES)[()])
            pixels = as_numbers(path, _TRACKS, tracks[()])
            sure = as_numbers(path, _SCORES, scores[()])
    except DatasetError:
        raise
    except Exception as error:  # h5py raises nearly anything for a damaged file
        reason = str(error).strip().splitlines() or [type(error).__name__]
        raise DatasetError(path, "file", "a complete HDF5 file", reason[-1]) from error
    xy = _arranged(path, pixels, order, len(names))
    confidence = _scores(path, sure, order, xy.shape[:3])
    known = array_names(path, _NAMES, names, xy.shape[2])
    return array_view(path, _TRACKS, joints_of(path, _TRACKS, xy, confidence, clip=True), names=known)


def _dataset(path: Path, file: Any, key: str) -> Any:
    if key not in file or not hasattr(file[key], "shape"):
        raise DatasetError(path, key, "a dataset under this key", f"keys {', '.join(file) or 'none'}")
    return file[key]


def _axes(path: Path, tracks: Any) -> tuple[str, ...]:
    """Return the names of the axes of `tracks`."""
    stated = tracks.attrs.get("dims")
    if stated is None:
        return _AXES
    try:
        axes = tuple(str(axis) for axis in json.loads(stated))
    except (TypeError, ValueError):
        axes = ()
    if sorted(axes) != sorted(_AXES):
        raise DatasetError(path, f"{_TRACKS}.dims", f"an order of {', '.join(_AXES)}", repr(stated))
    return axes


def _arranged(path: Path, pixels: Array, order: tuple[str, ...], nodes: int) -> Array:
    """Return pixels (T, P, K, 2)."""
    sizes = dict(zip(order, pixels.shape, strict=False))
    if pixels.ndim != len(order) or sizes["xy"] != 2 or sizes["node"] != nodes:
        fixed = {"xy": "2", "node": str(nodes)}
        expected = f"shape ({', '.join(fixed.get(axis, f'{axis}s') for axis in order)})"
        raise DatasetError(path, _TRACKS, expected, pixels.shape)
    return np.transpose(pixels, [order.index(axis) for axis in ("frame", "track", "node", "xy")])


def _scores(path: Path, scores: Array, order: tuple[str, ...], shape: tuple[int, ...]) -> Array:
    """Return scores (T, P, K), 1 where there is none."""
    axes = [axis for axis in order if axis != "xy"]
    expected = tuple(dict(zip(("frame", "track", "node"), shape, strict=True))[axis] for axis in axes)
    if scores.shape != expected:
        raise DatasetError(path, _SCORES, f"shape {expected} like the tracks", scores.shape)
    arranged = np.transpose(scores, [axes.index(axis) for axis in ("frame", "track", "node")])
    return np.where(np.isnan(arranged), 1.0, arranged)


def matches(path: Path) -> bool:
    """Whether a file is HDF5 with SLEAP's names in it."""
    return hdf5_mentions(path, b"node_names", b"track")


def cut(stem: str) -> str:
    """Cut SLEAP's own words off the name of a file."""
    return re.sub(r"\.(analysis|predictions|slp)\b", "", stem)

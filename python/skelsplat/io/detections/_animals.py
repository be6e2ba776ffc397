"""Detections of animals: DeepLabCut (h5, csv) and SLEAP (h5), one file per camera."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat._optional import require
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import array_names, as_numbers, hdf5_mentions
from skelsplat.io._files import csv_header, csv_lines, frame_number, parsing
from skelsplat.io.detections._csv import frame_in, number_in
from skelsplat.io.detections._format import View, array_view, joints_of

Columns = dict[str, dict[str, dict[str, int]]]  # by individual, part and coordinate

_KEY = "df_with_missing"
_LEVELS = (("scorer", "bodyparts", "coords"), ("scorer", "individuals", "bodyparts", "coords"))
# DeepLabCut's own name for parts that belong to no individual
_UNIQUE = "single"
_COORDS = ("x", "y", "likelihood")


def read_dlc(path: Path) -> View:
    """Return the view of one camera from DeepLabCut's h5, single- or multi-animal.

    A table with columns (scorer, [individuals,] bodyparts, coords), coords x, y in pixels and likelihood; the
    index is the frame number. Parts are matched to joints by name. The table is under the key
    ``df_with_missing`` and needs pandas and PyTables, which can run what a malicious file holds: open files
    of people you trust (the csv has the same numbers and no such risk).
    """
    frame = _load(path)
    if not hasattr(frame, "columns") or not hasattr(frame.columns, "levels"):
        raise DatasetError(path, "header", "a table with several levels of columns", type(frame).__name__)
    if frame.index.nlevels != 1 or frame.index.dtype.kind not in "iu":
        raise DatasetError(path, "index", "frame numbers (results of a video)", str(frame.index[:1].tolist()))
    columns = [tuple(str(part) for part in column) for column in frame.columns]
    if not all(dtype.kind in "fiu" for dtype in frame.dtypes):
        raise DatasetError(path, "values", "numbers", "columns of another kind")
    _check_levels(path, tuple(str(name) for name in frame.columns.names))
    frames = [frame_number(path, "index", int(number)) for number in frame.index]
    return _Table(path, columns, frames, np.asarray(frame.to_numpy(dtype=np.float64))).view()


def _load(path: Path) -> Any:
    """Return the table; its file is closed again."""
    pandas = require("pandas", f"{path}: DeepLabCut's h5")
    require("tables", f"{path}: DeepLabCut's h5")
    with parsing(path, "a complete HDF5 file of pandas"), pandas.HDFStore(path, mode="r") as store:
        keys = [key.strip("/") for key in store.keys()]  # noqa: SIM118 - a store, not a dict
        table = store[_KEY] if _KEY in keys else None
    if table is None:
        raise DatasetError(path, _KEY, "a table under this key", f"keys {', '.join(keys) or 'none'}")
    return table


def read_dlc_csv(path: Path) -> View:
    """Return the view of one camera from DeepLabCut's csv, the table of `read_dlc`.

    The columns are three or four header lines, and an empty field is a missing value.
    """
    lines = [line for line in csv_lines(path) if line]
    names = [line[0] for line in lines[:4]]
    depth = 4 if len(names) > 1 and names[1] == "individuals" else 3
    _check_levels(path, tuple(names[:depth]))
    columns = list(zip(*(line[1:] for line in lines[:depth]), strict=True))
    body = list(enumerate(lines[depth:], start=depth + 1))
    frames = [frame_in(path, f"line {number}", line[0]) for number, line in body]
    values = [[number_in(path, f"line {number}", text) for text in line[1:]] for number, line in body]
    array = np.array(values, dtype=np.float64).reshape(len(body), len(columns))
    return _Table(path, columns, frames, array).view()


def _check_levels(path: Path, levels: tuple[str, ...]) -> None:
    if levels not in _LEVELS:
        expected = " or ".join("/".join(known) for known in _LEVELS)
        raise DatasetError(path, "header", expected, "/".join(levels) or "an empty file")


@dataclass(frozen=True)
class _Table:
    """A table as it is read: C `columns` of a name per level, T `frames`, `values` (T, C)."""

    path: Path
    columns: Sequence[tuple[str, ...]]
    frames: list[int]
    values: Array

    def view(self) -> View:
        """Return the view of the camera, one place per individual."""
        columns = self._places()
        animals = [who for who in columns if who != _UNIQUE] or list(columns)
        parts = self._parts({who: columns[who] for who in animals})
        people = np.stack([self._joints(columns[who], parts) for who in animals], axis=1)
        if not self.frames or any(b <= a for a, b in pairwise(self.frames)):
            actual = "others" if self.frames else "none"
            raise DatasetError(self.path, "index", "frame numbers that ascend", actual)
        return array_view(self.path, "likelihood", people, frames=self.frames, names=parts)

    def _places(self) -> Columns:
        """Return the column of each individual, part and coordinate."""
        places: Columns = {}
        scorers = {column[0] for column in self.columns}
        if len(scorers) != 1:
            raise DatasetError(self.path, "scorer", "one scorer", ", ".join(sorted(scorers)) or "none")
        for place, column in enumerate(self.columns):
            who, part, coord = column[1] if len(column) == 4 else "", column[-2], column[-1]
            if coord not in _COORDS:
                raise DatasetError(self.path, "coords", f"{', '.join(_COORDS)} (pixels)", repr(coord))
            there = places.setdefault(who, {}).setdefault(part, {})
            if coord in there:
                raise DatasetError(self.path, f"{part}.{coord}", "one column", "two")
            there[coord] = place
        return places

    def _parts(self, animals: Columns) -> tuple[str, ...]:
        """Return the names of the parts that every individual has, in the order of the first."""
        first, parts = next(iter(animals.items()))
        for who, own in animals.items():
            if set(own) != set(parts):
                odd = ", ".join(sorted(set(own) ^ set(parts)))
                expected = f"the same parts for every individual ({first}, {who})"
                raise DatasetError(self.path, "bodyparts", expected, f"{odd} for one of them")
            for part, there in own.items():
                lacking = [coord for coord in ("x", "y") if coord not in there]
                if lacking:
                    raise DatasetError(self.path, f"{part}.{lacking[0]}", "a column", "none")
        return tuple(parts)

    def _joints(self, columns: dict[str, dict[str, int]], parts: tuple[str, ...]) -> Array:
        """Return the joints (T, K, 3) of one individual."""
        xy = np.stack([self.values[:, [columns[p]["x"], columns[p]["y"]]] for p in parts], axis=1)
        sure = [columns[part].get("likelihood") for part in parts]
        likelihood = [np.ones(len(xy)) if place is None else self.values[:, place] for place in sure]
        return joints_of(self.path, "likelihood", xy, np.stack(likelihood, axis=1), clip=False)


def is_dlc(path: Path) -> bool:
    """Whether a file is HDF5 with DeepLabCut's key in it."""
    return hdf5_mentions(path, _KEY.encode())


def is_dlc_csv(path: Path) -> bool:
    """Whether the first line of a file is DeepLabCut's."""
    first = csv_header(path)
    return len(first) > 1 and first[0] == "scorer"


_AXES = ("track", "xy", "node", "frame")
_TRACKS, _SCORES, _NAMES = "tracks", "point_scores", "node_names"


def read_sleap(path: Path) -> View:
    """Return the view of one camera from SLEAP's analysis file.

    ``tracks`` (tracks, 2, nodes, frames) in pixels, NaN for missing, ``point_scores`` (tracks, nodes, frames)
    and ``node_names``; frames count from 0. Newer files state the order of the axes in an attribute ``dims``.
    A score is the peak of a confidence map: above 1 it counts as 1; a point without one was placed by hand
    and counts as 1. Nodes are matched to joints by name. Needs h5py.
    """
    h5py = require("h5py", f"{path}: SLEAP's h5")
    with parsing(path, "a complete HDF5 file"), h5py.File(path, "r") as file:
        tracks, scores = (_dataset(path, file, key) for key in (_TRACKS, _SCORES))
        order = _axes(path, tracks)
        names = np.asarray(_dataset(path, file, _NAMES)[()])
        pixels = as_numbers(path, _TRACKS, tracks[()])
        sure = as_numbers(path, _SCORES, scores[()])
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


def is_sleap(path: Path) -> bool:
    """Whether a file is HDF5 with SLEAP's names in it."""
    return hdf5_mentions(path, b"node_names", b"track")

"""Detections of DeepLabCut (h5, csv) and SLEAP (h5), one file per camera."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain, islice, product
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import array_names, as_numbers, mentions
from skelsplat.io._files import csv_header, csv_lines, frame_number
from skelsplat.io._guarded import read_guarded, read_hdf5
from skelsplat.io.detections._csv import SLEAP_ADDED, frame_in, number_in
from skelsplat.io.detections._format import DetectionFormat, View, array_view, each, joints_of

_LEVELS = (("scorer", "bodyparts", "coords"), ("scorer", "individuals", "bodyparts", "coords"))
_UNIQUE = "single"  # DeepLabCut's own name for parts that belong to no individual
_COORDS = ("x", "y", "likelihood")
_NOBODY = -1.0  # x, y and likelihood of an individual that was not found (DeepLabCut 3)


def read_dlc(path: Path) -> View:
    """Read the only table in a file, with columns (scorer, [individuals,] bodyparts, coords).

    Its index are the frames, its key ``df_with_missing``, or ``tracks`` for stitched tracks.
    """
    found = read_guarded("table", path, "a complete HDF5 file of pandas")
    _check_levels(path, found["levels"])
    frames = [frame_number(path, "index", number) for number in found["index"]]
    return _table_view(path, found["columns"], frames, found["values"])


def read_dlc_csv(path: Path) -> View:
    """Read the table of `read_dlc`, whose columns are three or four header lines."""
    lines = (line for line in csv_lines(path) if line)
    header = list(islice(lines, 4))
    names = [line[0] for line in header]
    depth = 4 if len(names) > 1 and names[1] == "individuals" else 3
    _check_levels(path, tuple(names[:depth]))
    columns = list(zip(*(line[1:] for line in header[:depth]), strict=True))
    frames, values = [], []
    for number, line in enumerate(chain(header[depth:], lines), start=depth + 1):
        frames.append(frame_in(path, f"line {number}", line[0]))
        values.append(np.array([number_in(path, f"line {number}", text) for text in line[1:]]))
    return _table_view(path, columns, frames, np.array(values).reshape(len(frames), len(columns)))


def _check_levels(path: Path, levels: tuple[str, ...]) -> None:
    if levels not in _LEVELS:
        expected = " or ".join("/".join(known) for known in _LEVELS)
        raise DatasetError(path, "header", expected, "/".join(levels) or "an empty file")


def _table_view(path: Path, columns: Sequence[tuple[str, ...]], frames: list[int], values: Array) -> View:
    """Return the view of a table, one place per individual: columns of a name per level, values (T, C)."""
    scorers = {column[0] for column in columns}
    if len(scorers) != 1:
        raise DatasetError(path, "scorer", "one scorer", ", ".join(sorted(scorers)) or "none")
    places = {("".join(who), part, coord): at for at, (_, *who, part, coord) in enumerate(columns)}
    individuals = dict.fromkeys(who for who, _, _ in places)
    animals = [who for who in individuals if who != _UNIQUE] or list(individuals)
    parts = tuple(dict.fromkeys(part for who, part, _ in places if who in animals))
    if len(places) < len(columns) or not {coord for _, _, coord in places} <= {*_COORDS}:
        expected = f"{', '.join(_COORDS)} (pixels), once per part"
        raise DatasetError(path, "coords", expected, ", ".join(sorted({column[-1] for column in columns})))
    for key in product(animals, parts, _COORDS[:2]):
        if key not in places:
            raise DatasetError(path, f"{key[1]}.{key[2]}", "a column for every individual", "none")
    numbers = np.array(frames, dtype=np.int64)
    if not frames or (np.diff(numbers) <= 0).any():
        actual = "others" if frames else "none"
        raise DatasetError(path, "index", "frame numbers that ascend", actual)
    padded = np.column_stack([values, np.ones(len(values))])  # without a likelihood a joint is sure
    chosen = [places.get(key, -1) for key in product(animals, parts, _COORDS)]
    people = padded[:, chosen].reshape(len(numbers), len(animals), len(parts), 3)
    likelihood = np.where(people[..., 2] == _NOBODY, 0.0, people[..., 2])
    joints = joints_of(path, "likelihood", people[..., :2], likelihood, clip=False)
    return replace(array_view(path, joints, numbers), joints=parts)


_AXES = ("track", "xy", "node", "frame")
# as SLEAP holds them; it turns them round for MATLAB unless told not to (``transpose=False``)
_UNTURNED = ("frame", "node", "xy", "track")
_TRACKS, _SCORES, _NAMES, _EDGES = "tracks", "point_scores", "node_names", "edge_inds"


def read_sleap(path: Path) -> View:
    """Read ``tracks`` (tracks, 2, nodes, frames), ``point_scores`` (tracks, nodes, frames), ``node_names``.

    Newer files state the order of the axes in an attribute ``dims``, older ones may be (frames, nodes, 2,
    tracks) without saying so, which the sizes tell. A point without a score was placed by hand and is sure.
    """
    names = [_TRACKS, _SCORES, _NAMES, _EDGES, "track_names"]
    file = read_hdf5(path, names)
    arrays = file["arrays"]
    for name in (_TRACKS, _NAMES):
        if name not in arrays:
            there = ", ".join(file["keys"]) or "none"
            raise DatasetError(path, name, "a dataset under this key", f"keys {there}")
    nodes = np.asarray(arrays[_NAMES])
    order = _axes(path, arrays, len(nodes), file["attributes"][_TRACKS].get("dims"))
    pixels = as_numbers(path, _TRACKS, arrays[_TRACKS])
    xy = np.transpose(pixels, [order.index(axis) for axis in ("frame", "track", "node", "xy")])
    scores = None
    if _SCORES in arrays:
        scores = as_numbers(path, _SCORES, arrays[_SCORES])
        axes = [axis for axis in order if axis != "xy"]
        expected = tuple(pixels.shape[order.index(axis)] for axis in axes)
        if scores.shape != expected:
            raise DatasetError(path, _SCORES, f"shape {expected} like the tracks", scores.shape)
        scores = np.where(np.isnan(scores), 1.0, scores)
        scores = np.transpose(scores, [axes.index(axis) for axis in ("frame", "track", "node")])
    joints = joints_of(path, _TRACKS, xy, scores, clip=True)
    known = array_names(path, _NAMES, nodes, xy.shape[2])
    edges = edges_of(path, arrays.get(_EDGES, ()), len(known))
    return replace(array_view(path, joints), joints=known, edges=edges)


def _axes(path: Path, arrays: dict[str, Any], nodes: int, stated: Any) -> tuple[str, ...]:
    """Return the names of the axes of the tracks: as stated, else the usual ones, unless only others fit."""
    orders: list[tuple[str, ...]] = [_AXES, _UNTURNED]
    with suppress(TypeError, ValueError):
        orders = [tuple(map(str, json.loads(stated)))]
    shape, tracks = np.shape(arrays[_TRACKS]), len(arrays.get("track_names", ()))
    sizes = {"xy": 2, "node": nodes, **({"track": tracks} if tracks else {})}
    for order in orders:
        fits = len(shape) == len(order) and sizes.items() <= set(zip(order, shape, strict=True))
        if fits and sorted(order) == sorted(_AXES):
            return order
    expected = " or ".join(f"({', '.join(str(sizes.get(axis, axis)) for axis in order)})" for order in orders)
    raise DatasetError(path, _TRACKS, f"shape {expected}", shape)


def edges_of(path: Path, value: Any, nodes: int) -> tuple[tuple[int, int], ...]:
    """Return the pairs of nodes that a file connects."""
    if not np.size(value):
        return ()
    places = as_numbers(path, _EDGES, value)
    if places.ndim != 2 or places.shape[1] != 2 or not np.isin(places, range(nodes)).all():
        raise DatasetError(path, _EDGES, f"pairs of places from 0 to {nodes - 1}", places.tolist())
    return tuple((int(a), int(b)) for a, b in places)


def _is_dlc_csv(path: Path) -> bool:
    return csv_header(path)[:1] == ["scorer"]


# what DeepLabCut adds to the camera's name in that of a file, with the name of the network
_ADDED = r"(?s)DLC_.*"
# pandas marks its tables in HDF5 with the first; the second is one of the levels of columns
_IS_DLC = mentions(b"pandas_type", b"bodyparts")
_IS_SLEAP = mentions(b"node_names", b"track")
FORMATS = (
    DetectionFormat("deeplabcut", (".h5",), _IS_DLC, each(read_dlc), added=_ADDED),
    DetectionFormat("deeplabcut_csv", (".csv",), _is_dlc_csv, each(read_dlc_csv), added=_ADDED),
    DetectionFormat("sleap", (".h5", ".hdf5"), _IS_SLEAP, each(read_sleap), added=SLEAP_ADDED),
)

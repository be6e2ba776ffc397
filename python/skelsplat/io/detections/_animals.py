"""Detections of DeepLabCut and SLEAP (h5, csv), one file per camera."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import Array
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import array_names, as_numbers, hdf5_mentions
from skelsplat.io._files import csv_header, csv_lines, frame_number
from skelsplat.io._guarded import read_guarded
from skelsplat.io.detections._csv import frame_in, number_in
from skelsplat.io.detections._format import DetectionFormat, Person, View, array_view, joints_of, list_view

Columns = dict[str, dict[str, dict[str, int]]]  # by individual, part and coordinate

# pandas marks its tables in HDF5 with the first; the second is one of the levels of columns
_MARKS = (b"pandas_type", b"bodyparts")
_LEVELS = (("scorer", "bodyparts", "coords"), ("scorer", "individuals", "bodyparts", "coords"))
# DeepLabCut's own name for parts that belong to no individual
_UNIQUE = "single"
_COORDS = ("x", "y", "likelihood")
# x, y and likelihood in the place of an individual that was not found (DeepLabCut 3)
_NOBODY = -1.0


def read_dlc(path: Path) -> View:
    """Return the view of one camera from DeepLabCut's h5, single- or multi-animal.

    A table with columns (scorer, [individuals,] bodyparts, coords), coords x, y in pixels and likelihood; the
    index is the frame number. Parts are matched to joints by name. The table is the only one in the file,
    under any key: ``df_with_missing``, or ``tracks`` for stitched tracks. It needs pandas and PyTables.
    """
    expected = "a complete HDF5 file of pandas"
    found = read_guarded("table", path, expected)
    _check_levels(path, found["levels"])
    frames = [frame_number(path, "index", number) for number in found["index"]]
    return _Table(path, found["columns"], frames, found["values"]).view()


def read_dlc_csv(path: Path) -> View:
    """Return the view of one camera from DeepLabCut's csv, the table of `read_dlc`.

    The columns are three or four header lines, and an empty field is a missing value.
    """
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
    return _Table(path, columns, frames, np.array(values).reshape(len(frames), len(columns))).view()


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
        given = [np.ones(len(xy)) if place is None else self.values[:, place] for place in sure]
        likelihood = np.stack(given, axis=1)
        likelihood[likelihood == _NOBODY] = 0.0
        return joints_of(self.path, "likelihood", xy, likelihood, clip=False)


def is_dlc(path: Path) -> bool:
    """Whether a file is HDF5 of pandas with DeepLabCut's levels of columns."""
    return hdf5_mentions(path, *_MARKS)


def is_dlc_csv(path: Path) -> bool:
    """Whether the first line of a file is DeepLabCut's."""
    first = csv_header(path)
    return len(first) > 1 and first[0] == "scorer"


_AXES = ("track", "xy", "node", "frame")
# as SLEAP holds them; it turns them round for MATLAB unless told not to (``transpose=False``)
_UNTURNED = ("frame", "node", "xy", "track")
_TRACKS, _SCORES, _NAMES = "tracks", "point_scores", "node_names"


def read_sleap(path: Path) -> View:
    """Return the view of one camera from SLEAP's analysis file.

    ``tracks`` (tracks, 2, nodes, frames) in pixels, NaN for missing, ``point_scores`` (tracks, nodes, frames)
    and ``node_names``; frames count from 0. Newer files state the order of the axes in an attribute ``dims``,
    older ones may be (frames, nodes, 2, tracks) without saying so, which the sizes tell. A score is the peak
    of a confidence map: above 1 it counts as 1; a point without one was placed by hand and counts as 1, as do
    all in files without scores. Nodes are matched to joints by name. Needs h5py.
    """
    file = sleap_file(path)
    names = np.asarray(_dataset(path, file, _NAMES))
    order = _axes(path, file, len(names))
    pixels = as_numbers(path, _TRACKS, file["arrays"][_TRACKS])
    sure = as_numbers(path, _SCORES, file["arrays"][_SCORES]) if _SCORES in file["arrays"] else None
    xy = np.transpose(pixels, [order.index(axis) for axis in ("frame", "track", "node", "xy")])
    confidence = None if sure is None else _scores(path, sure, order, xy.shape[:3])
    known = array_names(path, _NAMES, names, xy.shape[2])
    return array_view(path, _TRACKS, joints_of(path, _TRACKS, xy, confidence, clip=True), names=known)


def sleap_file(path: Path) -> dict[str, Any]:
    """Return ``arrays``, ``attributes`` and ``keys`` of an analysis file."""
    names = [_TRACKS, _SCORES, _NAMES, "track_names", "edge_inds"]
    expected = "a complete HDF5 file"
    found: dict[str, Any] = read_guarded("hdf5", path, expected, names=names)
    return found


def _dataset(path: Path, file: dict[str, Any], key: str) -> Any:
    if key not in file["arrays"]:
        there = ", ".join(file["keys"]) or "none"
        raise DatasetError(path, key, "a dataset under this key", f"keys {there}")
    return file["arrays"][key]


def _axes(path: Path, file: dict[str, Any], nodes: int) -> tuple[str, ...]:
    """Return the names of the axes of `tracks`: as stated, else the usual ones, unless only others fit."""
    shape = np.shape(_dataset(path, file, _TRACKS))
    stated = file["attributes"][_TRACKS].get("dims")
    turned = file["attributes"][""].get("transpose")
    usual = [_UNTURNED] if turned is not None and not turned else [_AXES, _UNTURNED]
    orders = usual if stated is None else [_stated(path, stated)]
    named = len(file["arrays"].get("track_names", ()))
    sizes = {"xy": 2, "node": nodes, **({"track": named} if named else {})}
    for order in orders:
        if len(shape) == len(order) and sizes.items() <= set(zip(order, shape, strict=True)):
            return order
    expected = f"shape ({', '.join(str(sizes.get(axis, f'{axis}s')) for axis in orders[0])})"
    raise DatasetError(path, _TRACKS, expected, shape)


def _stated(path: Path, stated: Any) -> tuple[str, ...]:
    try:
        axes = tuple(str(axis) for axis in json.loads(stated))
    except (TypeError, ValueError):
        axes = ()
    if sorted(axes) != sorted(_AXES):
        raise DatasetError(path, f"{_TRACKS}.dims", f"an order of {', '.join(_AXES)}", repr(stated))
    return axes


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


_FRAME, _TRACK = "frame_idx", "track"


def read_sleap_csv(path: Path) -> View:
    """Return the view of one camera from SLEAP's analysis csv.

    A line per animal and frame: ``track`` (a name, empty without tracking), ``frame_idx``, and for each node
    ``NODE.x``, ``NODE.y`` and perhaps ``NODE.score``, in any order. An empty position is missing; scores are
    those of `read_sleap`. A frame without animals has no line.
    """
    lines = csv_lines(path)
    header = next(lines, [])
    nodes = _nodes(path, header)
    places = {name: place for place, name in enumerate(header)}
    people: dict[int, list[Person]] = {}
    seen: set[tuple[int, str]] = set()
    for number, line in enumerate(lines, start=2):
        if not line:
            continue
        frame = frame_in(path, f"line {number}, {_FRAME}", line[places[_FRAME]].strip())
        track = line[places[_TRACK]] if _TRACK in places else ""
        if track and (frame, track) in seen:
            actual = f"{track} again in frame {frame}"
            raise DatasetError(path, f"line {number}, {_TRACK}", "a track once per frame", actual)
        seen.add((frame, track))
        rows = np.array([_node(path, number, line, places, node) for node in nodes])
        joints = joints_of(path, f"line {number}", rows[:, :2], rows[:, 2], clip=True)
        people.setdefault(frame, []).append(Person(path, f"line {number}", joints))
    if not people:
        raise DatasetError(path, "lines", "one line per animal and frame after the header", "none")
    return replace(list_view(path, people), joints=nodes, sparse=True)


def _nodes(path: Path, header: Sequence[str]) -> tuple[str, ...]:
    nodes = tuple(name.removesuffix(".x") for name in header if name.endswith(".x"))
    known = set(header)
    lacking = not nodes or not known.issuperset([_FRAME, *(f"{node}.y" for node in nodes)])
    if lacking or len(known) < len(header):
        needed = f"the columns {_FRAME}, and NODE.x and NODE.y for every node"
        expected = needed if lacking else "every column once"
        raise DatasetError(path, "line 1", expected, ", ".join(header)[:200] or "an empty line")
    return nodes


def _node(path: Path, number: int, line: list[str], places: dict[str, int], node: str) -> tuple[float, ...]:
    """Return x, y and score of a node; 1 where there is no score."""
    x, y, score = (
        number_in(path, f"line {number}, {node}.{part}", line[places[f"{node}.{part}"]])
        if f"{node}.{part}" in places
        else np.nan
        for part in ("x", "y", "score")
    )
    return x, y, 1.0 if np.isnan(score) else score


def is_sleap_csv(path: Path) -> bool:
    """Whether the first line of a file has SLEAP's columns."""
    header = csv_header(path)
    return _FRAME in header and any(name.endswith(".x") for name in header)


# what the tools add to the camera's name in that of a file; DeepLabCut also the name of the network
_DLC = r"(?s)DLC_.*"
_SLEAP = r"\.(analysis|predictions|slp)\b"
FORMATS = (
    DetectionFormat("deeplabcut", "DeepLabCut's h5", (".h5",), is_dlc, read_dlc, added=_DLC),
    DetectionFormat("deeplabcut_csv", "DeepLabCut's csv", (".csv",), is_dlc_csv, read_dlc_csv, added=_DLC),
    DetectionFormat("sleap", "SLEAP's h5", (".h5", ".hdf5"), is_sleap, read_sleap, added=_SLEAP),
    DetectionFormat("sleap_csv", "SLEAP's csv", (".csv",), is_sleap_csv, read_sleap_csv, added=_SLEAP),
)

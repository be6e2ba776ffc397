"""Detections of DeepLabCut (h5, csv), one file per camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, islice, pairwise
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import hdf5_mentions
from skelsplat.io._files import csv_header, csv_lines, frame_number
from skelsplat.io._guarded import read_guarded
from skelsplat.io.detections._csv import frame_in, number_in
from skelsplat.io.detections._format import View, array_view, joints_of

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

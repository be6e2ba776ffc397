"""The tidy csv file: one row per frame and joint."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import skelsplat as sk
from skelsplat._arrays import Index, medians
from skelsplat._atomic import atomic_write
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import FRAME_RATES
from skelsplat.io._files import csv_lines, frame_number
from skelsplat.io.poses._parts import Poses, parts_of
from skelsplat.io.poses._pose_data import PoseData, checked, over_views

_AXES = ("x", "y", "z")
_BARS, _SCATTER = (tuple(f"{name}_{axis}" for axis in _AXES) for name in ("error_bar", "scatter"))
COLUMNS = (
    *("frame", "time", "joint", *_AXES, *_BARS, *_SCATTER, "unit"),
    *("status", "n_views", "n_rejected", "reprojection_error_px"),
)
_WIDEST = 1e100  # standard deviation, of which the square is a number
_ROUNDED = 5e-15  # relative error of a number of 15 digits
_REQUIRED = ("frame", "joint", *_AXES, "unit")


def write_csv(path: str | os.PathLike[str], data: Poses) -> None:
    """Write one row per frame and joint, with the columns of `COLUMNS`.

    ``time`` is in seconds from the first frame, as in TRC files, and empty without a frame rate.
    ``x, y, z`` and their standard deviations, ``error_bar_x, …`` against an anatomical joint (from
    `PoseData.error_bar`) and ``scatter_x, …`` (from `PoseData.uncertainty`), are in ``unit`` with all their
    digits, ``n_views`` counts the views whose detection of the joint was used (none if it has
    no position), ``n_rejected`` those of them whose weight is below `skelsplat.REJECTED_WEIGHT`, and
    ``reprojection_error_px`` is the mean over all of them. A value that does not exist is an empty field.
    """
    _, frames, parts = parts_of(data)
    start = int(frames[0]) if frames.size else 0
    with atomic_write(path) as stream:
        stream.write(csv_text([COLUMNS]).encode())
        for part in parts:
            stream.write(csv_text(rows_of(part, start)).encode())


def csv_text(rows: Iterable[Sequence[Any]]) -> str:
    """Return the text of rows of a table."""
    lines = _Lines()
    csv.writer(lines, lineterminator="\r\n").writerows(rows)  # so that a text with either is quoted
    return "".join(f"{line[:-2]}\n" for line in lines)


class _Lines(list[str]):
    """Takes the lines that the csv module writes."""

    write = list.append


def times_of(frames: Index, start: int, rate: float | None) -> list[Any]:
    """Return the time of each frame in s from the frame ``start``, with all its digits; empty if unknown."""
    return [""] * len(frames) if rate is None else ((frames - start) / rate).tolist()


def rows_of(data: PoseData, start: int) -> Iterator[list[Any]]:
    """Yield the fields of `COLUMNS`, frame by frame and joint by joint; time is that from ``start``."""
    n_views, errors = over_views(data.reprojection_error)
    n_rejected = (data.view_weights < sk.REJECTED_WEIGHT).sum(axis=1)
    both = (data.error_bar, data.uncertainty)
    deviations = np.sqrt(np.concatenate([np.diagonal(each, axis1=-2, axis2=-1) for each in both], axis=-1))
    shape = data.pose.shape[:2]
    columns = (
        *_columns(data.pose, shape, 3),
        *_columns(deviations, shape, 6),
        _columns(np.full(shape, data.unit), shape)[0],
        *(_columns(values, shape)[0] for values in (data.joint_status, n_views, n_rejected, errors)),
    )
    stamps = zip(data.frames.tolist(), times_of(data.frames, start, data.frame_rate), strict=True)
    places = ((*stamp, joint) for stamp in stamps for joint in data.joint_names)
    for place, *fields in zip(places, *columns, strict=True):
        yield [*place, *fields]


def _columns(values: npt.NDArray[Any], shape: tuple[int, ...], count: int = 1) -> list[list[Any]]:
    """Return so many columns of values (T, N, …), a field for each of the rows; empty where there is none.

    Floats are written with all their digits by the csv module.
    """
    if not values.size:
        return [[""] * math.prod(shape)] * count
    rows = values.reshape(math.prod(shape), count)
    if rows.dtype.kind == "f":
        rows = np.where(np.isfinite(rows), rows.astype(object), "")
    return rows.T.tolist()


@checked
def read_csv(path: str | os.PathLike[str]) -> PoseData:
    """Read a file of `write_csv`, or one with its columns frame, joint, x, y, z and unit.

    If there is a column ``time`` with the seconds of two frames or more at a constant rate, with 15 digits at
    least, that is the ``frame_rate``.
    The file has no correlations between axes: ``uncertainty`` is diagonal, and ``joint_bias`` is what the
    error bars have beyond it. It does not say which view had
    which error either, so that ``n_views``, ``n_rejected`` and ``reprojection_error_px`` are not read.
    """
    source = Path(path)
    lines = csv_lines(source)
    columns = next(lines, [])
    missing = [name for name in _REQUIRED if name not in columns]
    if "person" in columns:
        raise DatasetError(source, "line 1", "the poses of one person (person_0/pose.csv)", "several people")
    if missing:
        raise DatasetError(source, "line 1", f"a column {missing[0]}", ", ".join(columns) or "nothing")
    twice = [name for name in COLUMNS if columns.count(name) > 1]
    if twice:
        raise DatasetError(source, "line 1", f"one column {twice[0]}", columns.count(twice[0]))
    rows = [(number, line) for number, line in enumerate(lines, start=2) if line]
    if not rows:
        raise DatasetError(source, "rows", "at least one", "none")
    cells = {name: [line[k].strip() for _, line in rows] for k, name in enumerate(columns)}
    return _Table(source, [number for number, _ in rows], cells).poses()


@dataclass(frozen=True)
class _Table:
    """The fields of a file by column, and the number of each line."""

    path: Path
    lines: list[int]
    cells: dict[str, list[str]]

    def error(self, row: int, expected: str, actual: str, column: str = "") -> DatasetError:
        place = f"line {self.lines[row]}" + (f", {column}" if column else "")
        return DatasetError(self.path, place, expected, actual)

    def numbers(self, column: str, kind: Callable[[str], Any] = float) -> list[Any]:
        """Return the numbers of a column, NaN for an empty field; all of them if it is not there."""
        values = []
        for row, text in enumerate(self.cells.get(column, [""] * len(self.lines))):
            try:
                values.append(kind(text or "nan"))
            except ValueError as error:
                raise self.error(row, "a number", repr(text), column) from error
        return values

    def joints(self, frames: Index) -> tuple[str, ...]:
        """Return the joints, which are in the same order in every frame; check that frames ascend."""
        names, units = np.array(self.cells["joint"]), self.cells["unit"]
        count = int((frames != frames[0]).argmax()) or len(frames)
        joints = names[:count].tolist()
        for row in range(count):
            if joints.index(joints[row]) < row:
                raise self.error(row, "every joint once in a frame", f"{joints[row]} again")
        first = np.arange(len(frames)) // count * count
        beside = (names != np.array(joints)[np.arange(len(frames)) - first]) | (frames != frames[first])
        back = np.flatnonzero(np.diff(frames[::count], prepend=frames[0] - 1) < 1) * count
        for row in [*np.flatnonzero(beside)[:1], *back[:1]]:
            expected = f"frame {frames[first[row]]}, joint {joints[row % count]}, in ascending frames"
            raise self.error(row, expected, f"frame {frames[row]}, joint {names[row]}")
        for row, unit in enumerate(units):
            if unit != units[0] or unit not in MM_PER_UNIT:
                raise self.error(row, "the unit mm, cm or m, one for all", repr(unit))
        if len(frames) % count:
            raise self.error(len(frames) - 1, f"{count} joints in every frame", f"{len(frames) % count}")
        return tuple(joints)

    def poses(self) -> PoseData:
        whole = zip(self.lines, self.numbers("frame", int), strict=True)
        every = np.array([frame_number(self.path, f"line {line}, frame", one) for line, one in whole])
        joints = self.joints(every)
        shape = (len(every) // len(joints), len(joints))
        pose, bars, scatter = (
            np.array([self.numbers(column) for column in columns]).T.reshape(*shape, 3)
            for columns in (_AXES, _BARS, _SCATTER)
        )
        wide = (np.abs((bars, scatter)) > _WIDEST).any(axis=(0, 3)).ravel()
        if wide.any():
            expected = f"standard deviations of at most {_WIDEST:g}"
            raise self.error(int(wide.argmax()), expected, "a larger one")
        arrays: dict[str, Any] = {}
        if np.isfinite(scatter).any():
            known = np.isfinite(scatter).all(axis=-1)[..., None, None]
            arrays["uncertainty"] = np.where(known, np.eye(3) * scatter[..., None, :] ** 2, np.nan)
        if np.isfinite(bars).any():
            beyond = medians(np.moveaxis(bars**2 - scatter**2, 1, 0).reshape(len(joints), -1))
            arrays["joint_bias"] = np.broadcast_to(np.sqrt(np.fmax(beyond, 0.0)), shape)
        if any(self.cells.get("status", ())):
            arrays["joint_status"] = np.array(self.cells["status"]).reshape(shape)
        frames = every[:: len(joints)]
        rate = _rate(frames, self.cells.get("time", [""] * len(every))[:: len(joints)])
        unit = self.cells["unit"][0]
        pose = np.ascontiguousarray(pose)
        return PoseData(pose, joints, frames, unit, frame_rate=rate, **arrays)


def _rate(frames: Index, texts: Sequence[str]) -> float | None:
    """Return the rate, in the fewest digits, at which frames have these times; None if there is none.

    Times as they are written give the rate that they were written with. Those of a table that was cut may be
    off in the last digit, and R and spreadsheets write 15 digits.
    """
    try:
        times = np.array(texts, dtype=np.float64)
    except ValueError:  # the column of another program
        return None
    with np.errstate(all="ignore"):
        steps, seconds = frames - frames[0], times - times[0]
        rates = [float(f"{steps[-1] / seconds[-1]:.{digits}g}") for digits in range(1, 18)]
        errors = [np.abs(steps / rate - seconds).max() for rate in rates]
        largest = np.abs(times).max()
    slacks = (0.0, 4.0 * np.spacing(largest), 2.0 * _ROUNDED * largest)
    both = [(most, pair) for most in slacks for pair in zip(rates, errors, strict=True)]
    low, high = FRAME_RATES
    return next((rate for most, (rate, error) in both if error <= most and low <= rate <= high), None)

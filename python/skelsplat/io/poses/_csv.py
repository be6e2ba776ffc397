"""The tidy csv file: one row per frame and joint."""

from __future__ import annotations

import csv
import io
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
from skelsplat._atomic import atomic_write_text
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import FRAME_RATES
from skelsplat.io._files import csv_lines, frame_number
from skelsplat.io.poses._pose_data import PoseData, Poses, checked, over_views, parts_of

_AXES = ("x", "y", "z")
_BARS, _SCATTER = (tuple(f"{name}_{axis}" for axis in _AXES) for name in ("error_bar", "scatter"))
COLUMNS = (
    *("frame", "time", "joint", *_AXES, *_BARS, *_SCATTER, "unit"),
    *("status", "n_views", "n_rejected", "reprojection_error_px"),
)
_REQUIRED = ("frame", "joint", *_AXES, "unit")
_ROUNDED = 1e-14  # of times with 15 digits, as R and spreadsheets write them


def write_csv(path: str | os.PathLike[str], data: Poses) -> None:
    """Write one row per frame and joint, with the columns of `COLUMNS`.

    ``time`` is in seconds from the first frame, and empty without a frame rate. ``x, y, z``, ``error_bar_x,
    …`` and ``scatter_x, …`` (standard deviations) are in ``unit``. ``n_views`` counts the views whose
    detection was used, ``n_rejected`` those whose weight is below `skelsplat.REJECTED_WEIGHT`, and
    ``reprojection_error_px`` is the mean over all of them. What does not exist is an empty field.
    """
    _, frames, parts = parts_of(data)
    start = int(frames[0]) if frames.size else 0
    atomic_write_text(path, csv_text([COLUMNS]), (csv_text(rows_of(part, start)) for part in parts))


def csv_text(rows: Iterable[Sequence[Any]]) -> str:
    """Return the text of rows of a table."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def times_of(frames: Index, start: int, rate: float | None) -> list[Any]:
    """Return the time of each frame in s from the frame ``start``; empty if unknown."""
    return [""] * len(frames) if rate is None else ((frames - start) / rate).tolist()


def rows_of(data: PoseData, start: int) -> Iterator[list[Any]]:
    """Yield the fields of `COLUMNS`, frame by frame and joint by joint; time is that from ``start``."""
    n_views, errors = over_views(data.reprojection_error)
    n_rejected = (data.view_weights < sk.REJECTED_WEIGHT).sum(axis=1)
    both = (data.error_bar, data.uncertainty)
    deviations = np.sqrt(np.concatenate([np.diagonal(each, axis1=-2, axis2=-1) for each in both], axis=-1))
    shape = data.pose.shape[:2]
    of_joints = (np.full(shape, data.unit), data.joint_status, n_views, n_rejected, errors)
    columns = [*_columns(data.pose, shape, 3), *_columns(deviations, shape, 6)]
    columns += [column for values in of_joints for column in _columns(values, shape)]
    stamps = zip(data.frames.tolist(), times_of(data.frames, start, data.frame_rate), strict=True)
    places = ((*stamp, joint) for stamp in stamps for joint in data.joint_names)
    for place, *fields in zip(places, *columns, strict=True):
        yield [*place, *fields]


def _columns(values: npt.NDArray[Any], shape: tuple[int, ...], count: int = 1) -> list[list[Any]]:
    """Return ``count`` columns of values (T, N, …), a field for each row; empty where there is none."""
    if not values.size:
        return [[""] * math.prod(shape)] * count
    rows = values.reshape(math.prod(shape), count)
    if rows.dtype.kind == "f":
        rows = np.where(np.isfinite(rows), rows.astype(object), "")
    return rows.T.tolist()


@checked
def read_csv(path: str | os.PathLike[str]) -> PoseData:
    """Read a file of `write_csv`, or one with its columns frame, joint, x, y, z and unit.

    The ``frame_rate`` is that of a column ``time`` with seconds at a constant rate. The file has no
    correlations between axes, so ``uncertainty`` is diagonal and ``joint_bias`` is what the error bars have
    beyond it; ``n_views``, ``n_rejected`` and ``reprojection_error_px`` are not read.
    """
    source = Path(path)
    lines = csv_lines(source)
    columns = next(lines, [])
    if "person" in columns:
        raise DatasetError(source, "line 1", "the poses of one person (person_0/pose.csv)", "several people")
    for name in COLUMNS:
        if columns.count(name) > 1 or (name in _REQUIRED and name not in columns):
            raise DatasetError(source, "line 1", f"a column {name}, once", ", ".join(columns) or "nothing")
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

    def error(self, row: int, column: str, expected: str, actual: str) -> DatasetError:
        return DatasetError(self.path, f"line {self.lines[row]}, {column}", expected, actual)

    def numbers(self, column: str, kind: Callable[[str], Any] = float) -> list[Any]:
        """Return the numbers of a column, NaN for an empty field; all of them if it is not there."""
        values = []
        for row, text in enumerate(self.cells.get(column, [""] * len(self.lines))):
            try:
                values.append(kind(text or "nan"))
            except ValueError as error:
                raise self.error(row, column, "a number", repr(text)) from error
        return values

    def joints(self, frames: Index) -> tuple[str, ...]:
        """Return the joints; check that each is once in every frame, in one order, and that frames ascend."""
        names, row = np.array(self.cells["joint"]), np.arange(len(frames))
        count = int((frames != frames[0]).argmax()) or len(frames)
        first = row // count * count
        wrong = (names != names[row - first]) | (frames != frames[first])
        wrong[:count] |= ~np.isin(row[:count], np.unique(names[:count], return_index=True)[1])
        wrong[::count] |= np.diff(frames[::count], prepend=frames[0] - 1) < 1
        wrong[-1] |= len(frames) % count > 0
        for k in np.flatnonzero(wrong)[:1]:
            expected = "every joint once in every frame, in the same order, frames ascending"
            raise self.error(k, "joint", expected, f"frame {frames[k]}, joint {names[k]}")
        units = self.cells["unit"]
        for k, unit in enumerate(units):
            if unit != units[0] or unit not in MM_PER_UNIT:
                raise self.error(k, "unit", "mm, cm or m, one for all", repr(unit))
        return tuple(names[:count].tolist())

    def poses(self) -> PoseData:
        given = zip(self.lines, self.numbers("frame", int), strict=True)
        every = np.array([frame_number(self.path, f"line {line}, frame", one) for line, one in given])
        joints = self.joints(every)
        shape = (len(every) // len(joints), len(joints))
        pose, bars, scatter = (
            np.ascontiguousarray(np.array([self.numbers(column) for column in columns]).T).reshape(*shape, 3)
            for columns in (_AXES, _BARS, _SCATTER)
        )
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
        return PoseData(pose, joints, frames, self.cells["unit"][0], frame_rate=rate, **arrays)


def _rate(frames: Index, texts: Sequence[str]) -> float | None:
    """Return the rate, in the fewest digits, at which frames have these times; None if there is none.

    Times with all their digits give the rate that they were written with, others one that fits.
    """
    try:
        times = np.array(texts, dtype=np.float64)
    except ValueError:  # the column of another program
        return None
    with np.errstate(all="ignore"):
        steps, seconds = frames - frames[0], times - times[0]
        rates = [float(f"{steps[-1] / seconds[-1]:.{digits}g}") for digits in range(1, 18)]
        errors = [np.abs(steps / rate - seconds).max() for rate in rates]
        slacks = (0.0, _ROUNDED * np.abs(times).max())
    fitting = [rate for most in slacks for rate, error in zip(rates, errors, strict=True) if error <= most]
    low, high = FRAME_RATES
    return next((rate for rate in fitting if low <= rate <= high), None)

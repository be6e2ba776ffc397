"""The tidy csv file: one row per frame and joint."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

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

    Raises
    ------
    DatasetError
        If the path cannot be written.
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

    Raises
    ------
    DatasetError
        If the file cannot be read, lacks a column, names different units or joints or a joint twice, has
        frames that do not ascend, or a field that is no number; names the line.
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
    rows = [_parsed(source, k, columns, line) for k, line in enumerate(lines, start=2) if line]
    return _assemble(source, rows)


class _Row(NamedTuple):
    line: int
    frame: int
    time: str
    joint: str
    position: tuple[float, ...]
    bar: tuple[float, ...]
    scatter: tuple[float, ...]
    unit: str
    status: str


def _parsed(path: Path, line: int, columns: Sequence[str], values: Sequence[str]) -> _Row:
    fields = {name: value.strip() for name, value in zip(columns, values, strict=True)}
    try:
        frame = int(fields["frame"])
        position, bar, scatter = (
            tuple(float(fields.get(axis) or "nan") for axis in axes) for axes in (_AXES, _BARS, _SCATTER)
        )
    except ValueError as error:
        wrong = str(error).partition(": ")[2]  # of both, what is no number comes last
        column = next((f", {name}" for name, value in fields.items() if repr(value) == wrong), "")
        raise DatasetError(path, f"line {line}{column}", "a number", wrong or error) from error
    frame_number(path, f"line {line}, frame", frame)
    place = (line, frame, fields.get("time", ""), fields["joint"])
    return _Row(*place, position, bar, scatter, fields["unit"], fields.get("status", ""))


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


def _joints(path: Path, rows: Sequence[_Row]) -> tuple[str, ...]:
    """Return the joints, which are in the same order in every frame; check that frames ascend."""
    of_first = [row for row in rows if row.frame == rows[0].frame]
    joints = tuple(row.joint for row in of_first)
    first_line = {row.joint: row.line for row in reversed(of_first)}
    again = next((row for row in of_first if row.line != first_line[row.joint]), None)
    if again is not None:
        got = f"frame {again.frame}, joint {again.joint} again"
        raise DatasetError(path, f"line {again.line}", "every joint once in a frame", got)
    for k, row in enumerate(rows):
        first = rows[k - k % len(joints)]
        if row.unit != rows[0].unit or row.unit not in MM_PER_UNIT:
            raise DatasetError(path, f"line {row.line}", "the unit mm, cm or m, one for all", repr(row.unit))
        if row.joint != joints[k % len(joints)] or row.frame != first.frame:
            expected = f"frame {first.frame}, joint {joints[k % len(joints)]}"
            raise DatasetError(path, f"line {row.line}", expected, f"frame {row.frame}, joint {row.joint}")
        if row is first and k and row.frame <= rows[k - 1].frame:
            expected, got = (f"frame {rows[k - 1].frame + 1} or later", f"frame {row.frame}")
            raise DatasetError(path, f"line {row.line}", expected, got)
    return joints


def _assemble(path: Path, rows: Sequence[_Row]) -> PoseData:
    """Put the rows, frame by frame with the same joints in the same order, into arrays."""
    if not rows:
        raise DatasetError(path, "rows", "at least one", "none")
    joints = _joints(path, rows)
    steps, rest = divmod(len(rows), len(joints))
    if rest:
        raise DatasetError(path, f"line {rows[-1].line}", f"{len(joints)} joints in every frame", rest)
    both = ([row.bar for row in rows], [row.scatter for row in rows])
    bars, scatter = (np.array(values).reshape(steps, len(joints), 3) for values in both)
    wide = (np.abs((bars, scatter)) > _WIDEST).any(axis=(0, 3)).ravel()
    if wide.any():
        line = rows[int(wide.argmax())].line
        expected = f"standard deviations of at most {_WIDEST:g}"
        raise DatasetError(path, f"line {line}", expected, "a larger one")
    frames = np.array([row.frame for row in rows[:: len(joints)]], dtype=np.int64)
    arrays: dict[str, Any] = {}
    if np.isfinite(scatter).any():
        known = np.isfinite(scatter).all(axis=-1)[..., None, None]
        arrays["uncertainty"] = np.where(known, np.eye(3) * scatter[..., None, :] ** 2, np.nan)
    if np.isfinite(bars).any():
        beyond = medians(np.moveaxis(bars**2 - scatter**2, 1, 0).reshape(len(joints), -1))
        arrays["joint_bias"] = np.broadcast_to(np.sqrt(np.fmax(beyond, 0.0)), bars.shape[:2])
    if any(row.status for row in rows):
        arrays["joint_status"] = np.array([row.status for row in rows]).reshape(steps, len(joints))
    return PoseData(
        pose=np.array([row.position for row in rows]).reshape(steps, len(joints), 3),
        joint_names=joints,
        frames=frames,
        unit=rows[0].unit,
        frame_rate=_rate(frames, [row.time for row in rows[:: len(joints)]]),
        **arrays,
    )

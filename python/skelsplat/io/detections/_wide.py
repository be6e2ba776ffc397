"""Csv files with a line per frame, and columns ``NAME_x``, ``NAME_y`` and a confidence for every joint."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from skelsplat._words import listed
from skelsplat.exceptions import DatasetError
from skelsplat.findings import Finding, Subject, warn
from skelsplat.io._files import csv_header, csv_lines, doubled
from skelsplat.io.detections._csv import frame_in, number_in
from skelsplat.io.detections._format import (
    NEARLY_ALL,
    NORMALISED,
    DetectionFormat,
    View,
    array_view,
    each,
    joints_of,
)

_SURE = ("likelihood", "confidence", "score", "visibility", "conf", "p")
_FRAMES = ("frame", "frame_number", "frame_idx", "frame_index", "frame_id")
_TIMES = ("time", "times", "time_s", "timestamp", "timestamps", "timestamp_ms")
_CALISCOPE, _ANIPOSE = "img_loc", "_ncams"  # of lines of a point each, of poses


def read_wide(path: Path) -> View:
    """Read lines with ``NAME_x``, ``NAME_y``, and perhaps one of `_SURE` behind the same name.

    A column ``frame`` numbers the lines, which count from 0 without it; any other, as ``NAME_z``, is passed
    over, times with a note. Numbers that nearly all lie between 0 and 1.5 are parts of the image's size.
    Names that count, as ``L0`` to ``L32``, are places.
    """
    rows = csv_lines(path)
    header = [name.strip() for name in next(rows, [])]
    joints = _joints(header)
    if not joints or len(set(header)) < len(header):
        expected = "the columns NAME_x and NAME_y for every joint, once"
        actual = doubled(header) or ", ".join(header)[:200] or "an empty line"
        raise DatasetError(path, "line 1", expected, actual)
    count = next((name for name in header if name.lower() in _FRAMES), None)
    if count is None:
        _note_times(path, header)
    there = {*header}
    _refuse_other_names(path, joints, there)
    _note_unsure(path, joints, there)
    columns = [f"{joint}_{part}" for joint in joints for part in ("x", "y", _sure(joint, there))]
    frames: list[int] = []
    values: list[list[float]] = []
    for number, row in enumerate(rows, start=2):
        if row:
            cell = dict(zip(header, row, strict=True))
            where = f"line {number}, {count}"
            frame = len(frames) if count is None else frame_in(path, where, cell[count].strip())
            if frames and frame <= frames[-1]:
                raise DatasetError(path, where, f"a number above {frames[-1]}", frame)
            read = (number_in(path, f"line {number}, {name}", cell.get(name, "1")) for name in columns)
            values.append(list(read))
            frames.append(frame)
    numbers = np.array(frames, dtype=np.int64)
    if not frames:
        raise DatasetError(path, count or "lines", "a line per frame, numbers ascending", "none")
    every = np.array(values).reshape(len(frames), 1, len(joints), 3)
    people = joints_of(path, "line", every[..., :2], every[..., 2], clip=True)
    # (0, 0) may be a missing one
    placed = people[np.isfinite(people[..., 0]) & people[..., :2].any(axis=-1), :2]
    small = np.count_nonzero((placed >= 0.0) & (placed <= NORMALISED)) >= max(NEARLY_ALL * placed.size, 1)
    view = array_view(path, people, numbers)
    return replace(view, joints=None if _counted(joints) else joints, fractions=bool(small))


def _joints(header: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the joints; none if these are columns of something else, as of points in 3D."""
    names, there = [name.removesuffix("_x") for name in header if name.endswith("_x")], {*header}
    joints = tuple(name for name in names if name and f"{name}_y" in there)
    flat = not any(f"{name}_z" in there for name in joints)
    sure = any(f"{name}_{part}" in there for name in joints for part in _SURE)
    others = _CALISCOPE in joints or any(name.endswith(_ANIPOSE) for name in header)
    return joints if (flat or sure) and not others else ()


def _sure(joint: str, header: Collection[str]) -> str:
    """Return what follows a joint's name in the column of its confidence; the first if there is none."""
    return next((part for part in _SURE if f"{joint}_{part}" in header), _SURE[0])


def _refuse_other_names(path: Path, joints: Sequence[str], header: Collection[str]) -> None:
    """Raise `DatasetError` if all joints have one more column, none that is known: they would all be sure."""
    known = any(f"{joint}_{part}" in header for joint in joints for part in _SURE)
    first = f"{joints[0]}_"
    endings = {name.removeprefix(first) for name in header if name.startswith(first)} - {"x", "y"}
    odd = sorted(part for part in endings if all(f"{joint}_{part}" in header for joint in joints))
    if odd and not known:
        expected = f"confidences as NAME_{', NAME_'.join(_SURE)}, or none"
        raise DatasetError(path, "line 1", expected, first + odd[0])


def _note_unsure(path: Path, joints: Sequence[str], header: Collection[str]) -> None:
    """Warn if some joints have a confidence and others none, which are certain."""
    without = tuple(joint for joint in joints if f"{joint}_{_sure(joint, header)}" not in header)
    if 0 < len(without) < len(joints):
        sentence = f"{path}: {listed(without)} without a confidence, as others have, count as certain."
        subject = Subject(joints=without, files=(str(path),))
        warn(Finding("confidence_lacking", "warning", subject, sentence=sentence))


def _note_times(path: Path, header: Sequence[str]) -> None:
    """Note a column of times, which number no frames."""
    for name in (name for name in header if name.lower() in _TIMES):
        sentence = (
            f"{path}: {name} is not read: lines count from frame 0, unless a column frame numbers them."
        )
        warn(Finding("times_unused", "note", Subject(files=(str(path),)), sentence=sentence))


def _counted(joints: Sequence[str]) -> bool:
    """Whether names are one word and the numbers from 0."""
    word = re.sub(r"\d+$", "", joints[0])
    return all(joint in (f"{word}{place}", f"{word}{place:02d}") for place, joint in enumerate(joints))


FORMATS = (
    DetectionFormat("wide_csv", (".csv",), lambda path: bool(_joints(csv_header(path))), each(read_wide)),
)

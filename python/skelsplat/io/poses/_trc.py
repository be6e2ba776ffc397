"""TRC, the tab-separated marker file of OpenSim and its kin.

Five header lines, a blank line (its documentation asks for it, some writers leave it out), one row per frame.
Lines 4 and 5 and every row end in a tab, as motion-capture systems write them: OpenSim drops one empty field
from the end of a line, and a row whose last marker is missing would be one field short without it.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array, Index, positive
from skelsplat._atomic import atomic_write
from skelsplat._budget import read_text
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.findings import Finding, Subject, warn
from skelsplat.io._files import frame_number
from skelsplat.io.poses._parts import Poses, parts_of
from skelsplat.io.poses._pose_data import Y_UP, PoseData, checked, known_frame_rate
from skelsplat.io.poses._pose_data import marker_names as named

_HEADER = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame OrigNumFrames"
# share by which a rounded frame rate is off; 59.94 and 60 differ by twice as much
_SAME_RATE = 5e-4
# a micrometre, far below what keypoints of a body of 1 cm or more resolve
_DECIMALS = {"m": 6, "mm": 3}
_LARGE_MM = 10.0


def write_trc(
    path: str | os.PathLike[str],
    data: Poses,
    *,
    frame_rate: float | None = None,
    unit: str = "m",
    y_up: bool = False,
    marker_names: str = "skelsplat",
) -> None:
    """Write the poses as TRC.

    Rows are numbered from 1 at the first frame; a gap in `data.frames` is a gap in the rows' numbers and
    times. A joint without a position has empty fields, since the text "nan" breaks readers downstream.
    Positions have steps of 1 µm, of bodies that measure less than 1 cm finer ones.

    Parameters
    ----------
    path : path
    data : PoseData
    frame_rate : float
        Frames per second; that of `data` if left out.
    unit : "m" or "mm"
        Unit of the file; lengths are converted.
    y_up : bool
        Write a world with z up as y up, (x, y, z) → (y, z, x). The default keeps the axes of the calibration.
    marker_names : "skelsplat" or "pose2sim"
        What the joints are called: ``right_hip``, or ``RHip`` as Pose2Sim and its OpenSim models know it.
    """
    if unit not in _DECIMALS:
        raise InvalidInputError(f'unit: expected "m" or "mm" in a TRC file, got {unit!r}')
    head, frames, parts = parts_of(data)
    rate = known_frame_rate(head, frame_rate, "TRC")
    names = named(head.joint_names, marker_names)
    check_trc_names(names)
    start = int(frames[0]) if frames.size else 0
    with atomic_write(path) as stream:
        lines = _header(Path(path).name, names, len(frames), rate, unit)
        decimals = _DECIMALS[unit] + _further_decimals(data)
        stream.write("".join(f"{line}\n" for line in lines).encode())
        for part in parts:
            points = part.pose * (MM_PER_UNIT[head.unit] / MM_PER_UNIT[unit])
            rows = _rows(points[..., Y_UP] if y_up else points, part.frames - start, rate, decimals)
            stream.write("".join(f"{row}\n" for row in rows).encode())


def _further_decimals(data: Poses) -> int:
    """Return how many decimals more poses need than those of a person: one below 1 cm, two below 1 mm."""
    largest, (head, _, parts) = 0.0, parts_of(data)
    for part in parts:
        known = np.isfinite(part.pose)
        low, high = (np.where(known, part.pose, own) for own in (np.inf, -np.inf))
        sizes = (high.max(axis=1) - low.min(axis=1)) * MM_PER_UNIT[head.unit]
        largest = max(largest, float(sizes.max(initial=0.0)))
        if largest >= _LARGE_MM:
            return 0
    return math.floor(math.log10(_LARGE_MM / largest) - 1e-9) + 1 if largest > 0.0 else 0


def _rows(points: Array, steps: Index, rate: float, decimals: int) -> Iterator[str]:
    """Yield the rows of points (T, N, 3), ``steps`` (T,) after the first frame."""
    for step, pose in zip(steps.tolist(), points, strict=True):
        values = pose.ravel().tolist()
        fields = [f"{value:.{decimals}f}" if math.isfinite(value) else "" for value in values]
        yield "\t".join([str(step + 1), f"{step / rate:.6f}", *fields, ""])


def check_trc_names(names: Sequence[str]) -> None:
    """Raise `InvalidInputError` if a joint's name cannot stand in a line of tab-separated fields."""
    for name in names:
        if not name.strip() or "\t" in name or name.splitlines() != [name]:
            raise InvalidInputError(f"joint_names: expected names without tabs and line breaks, got {name!r}")


def _header(file_name: str, names: Sequence[str], steps: int, frame_rate: float, unit: str) -> list[str]:
    rate, joints = f"{frame_rate:g}", len(names)
    file_name = " ".join(file_name.split())  # a tab or a line break would be one of the header
    numbers = range(1, joints + 1)
    return [
        f"PathFileType\t4\t(X/Y/Z)\t{file_name.encode(errors='replace').decode()}",
        _HEADER.replace(" ", "\t"),
        "\t".join([rate, rate, str(steps), str(joints), unit, rate, "1", str(steps)]),
        "\t".join(["Frame#", "Time", *(f"{name}\t\t" for name in names), ""]),
        "\t".join(["", "", *(f"X{n}\tY{n}\tZ{n}" for n in numbers), ""]),
        "",
    ]


@checked
def read_trc(path: str | os.PathLike[str]) -> PoseData:
    """Read a TRC file; its axes are kept as they are.

    The blank sixth line may be missing, and empty fields and "nan" are NaN. ``frames`` are the file's own row
    numbers, ``frame_rate`` is its DataRate. Slips of the header are warned of, and the rows decide: another
    number of frames than there are, a DataRate of 0 or NaN, and one that the rows' times contradict.
    """
    source = Path(path)
    lines = read_text(source).splitlines()
    if len(lines) < 5 or not lines[0].startswith("PathFileType"):
        raise DatasetError(source, "header", "five lines that start with PathFileType", f"{len(lines)} lines")
    stated = lines[2].split("\t")
    if len(stated) < 5 or stated[4] not in MM_PER_UNIT:
        actual = repr(stated[4]) if len(stated) > 4 else f"only {len(stated)}"
        raise DatasetError(source, "line 3 Units", "m, cm or mm in the fifth field", actual)
    markers = tuple(name for name in lines[3].split("\t")[2:] if name.strip())
    if str(len(markers)) != stated[3].strip():
        expected = f"the {stated[3]} marker names that line 3 states"
        raise DatasetError(source, "line 4", expected, len(markers))
    body = [(number, line) for number, line in enumerate(lines[5:], start=6) if line.strip()]
    rows = [_read_row(source, number, line, 3 * len(markers)) for number, line in body]
    _check_count(source, stated[2].strip(), len(rows))
    frames = np.array([frame for frame, _ in rows], dtype=np.int64)
    rate = _rate(source, stated[0], frames, [line for _, line in body])
    points = np.array([values for _, values in rows], dtype=np.float64)
    pose = points.reshape(len(rows), len(markers), 3)
    return PoseData(pose, markers, frames, stated[4], frame_rate=rate)


def _check_count(path: Path, stated: str, rows: int) -> None:
    """Warn if the header counts other rows."""
    stated = re.sub(r"\.0*$", "", stated)  # some programs write all numbers as floats
    if not stated.isdecimal():
        raise DatasetError(path, "line 3 NumFrames", "a whole number", repr(stated))
    difference = frame_number(path, "line 3 NumFrames", stated) - rows
    if difference:
        numbers = {"stated": rows + difference, "rows": rows}
        words = f"{path}: the header (line 3) states {rows + difference} frames; {rows} follow and are read."
        warn(Finding("header_contradicts", "warning", Subject(files=(str(path),)), numbers, sentence=words))


def _rate(path: Path, stated: str, frames: Index, body: Sequence[str]) -> float | None:
    """Return the frame rate that the header states, or that of the rows' times if they contradict it.

    A rate of 0 or NaN states none.
    """
    try:
        rate = float(stated)
        unknown = rate == 0.0 or math.isnan(rate)
        if not unknown:
            positive("frame_rate", rate)
    except ValueError as error:
        expected = "frames per second, a positive number"
        raise DatasetError(path, "line 3 DataRate", expected, repr(stated)) from error
    times = [line.split("\t")[1] for line in body]
    found = _rate_of(frames, times)
    if not unknown and (found is None or not _contradict(rate, frames, times)):
        return rate
    given = f"it is {found:g} by those of the rows, which decide" if found else "the rows give none either"
    words = f"{path}: the header (line 3) states {rate:g} frames per second; {given}."
    numbers = {"stated": rate, "frame_rate": found}
    warn(Finding("header_contradicts", "warning", Subject(files=(str(path),)), numbers, sentence=words))
    return found


def _rate_of(frames: Index, times: Sequence[str]) -> float | None:
    """Return the frame rate at which frames have these times; None if the times are none that ascend."""
    try:
        seconds = np.array([float(time) for time in times])
    except ValueError:
        return None
    if len(seconds) < 2 or not (np.diff(seconds) > 0.0).all():
        return None
    rate = round(float((frames[-1] - frames[0]) / (seconds[-1] - seconds[0])), 3)
    return rate if 0.0 < rate < math.inf else None


def _contradict(stated: float, frames: Index, times: Sequence[str]) -> bool:
    """Say whether times that ascend are not those of the rate stated, but for rounding.

    They have to pass evenly, to half a frame: with a jump in them, no rate is that of all rows.
    """
    seconds = np.array([float(time) for time in times])
    steps, passed = frames - frames[0], seconds - seconds[0]
    digit = 10.0 ** -max(len(time.strip().partition(".")[2]) for time in times)
    frame = passed[-1] / steps[-1]
    even = bool((np.abs(passed - steps * frame) <= 0.5 * frame + digit).all())
    return even and bool(abs(passed[-1] - steps[-1] / stated) > digit + _SAME_RATE * passed[-1])


def _read_row(path: Path, number: int, line: str, count: int) -> tuple[int, list[float]]:
    """Frame number and `count` coordinates of a row."""
    fields = line.split("\t")
    if len(fields) == count + 3 and not fields[-1].strip():
        fields.pop()  # some writers end rows with a tab
    if len(fields) != count + 2:
        raise DatasetError(path, f"line {number}", f"{count + 2} fields", f"{len(fields)}")
    try:
        frame, values = int(fields[0]), [float(value) if value.strip() else math.nan for value in fields[2:]]
    except ValueError as error:
        raise DatasetError(path, f"line {number}", "numbers", str(error).partition(": ")[2]) from error
    return frame_number(path, f"line {number}, frame", frame), values

"""TRC, the tab-separated marker file of OpenSim and its kin.

Five header lines, a blank line (its documentation asks for it, some writers leave it out), one row per frame.
Lines 4 and 5 and every row end in a tab, as motion-capture systems write them: OpenSim drops one empty field
from the end of a line, and a row whose last marker is missing would be one field short without it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from skelsplat._atomic import atomic_write_text
from skelsplat._budget import read_text
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.findings import Finding, Subject, warn
from skelsplat.io._files import frame_number
from skelsplat.io.poses._markers import Y_UP, as_markers
from skelsplat.io.poses._markers import marker_names as named
from skelsplat.io.poses._pose_data import PoseData, Poses, checked, known_frame_rate, parts_of

_HEADER = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame OrigNumFrames"
# a micrometre
_DECIMALS = {"m": 6, "mm": 3}


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
    Positions have steps of 1 µm.

    ``frame_rate`` is by default that of `data`, ``unit`` ``"m"`` or ``"mm"``. ``y_up`` writes a world with z
    up as y up, (x, y, z) → (y, z, x). ``marker_names`` ``"pose2sim"`` calls joints ``RHip`` in place of
    ``right_hip``, as Pose2Sim and its OpenSim models know them.
    """
    if unit not in _DECIMALS:
        raise InvalidInputError(f'unit: expected "m" or "mm" in a TRC file, got {unit!r}')
    head, frames, parts = parts_of(data)
    rate = known_frame_rate(head, frame_rate, "TRC")
    names = named(head.joint_names, marker_names)
    check_trc_names(names)
    start = int(frames[0]) if frames.size else 0

    def rows(part: PoseData) -> Iterator[str]:
        points = as_markers(part, marker_names).pose * (MM_PER_UNIT[head.unit] / MM_PER_UNIT[unit])
        points = points[..., Y_UP] if y_up else points
        for step, pose in zip((part.frames - start).tolist(), points, strict=True):
            values = pose.ravel().tolist()
            fields = [f"{value:.{_DECIMALS[unit]}f}" if math.isfinite(value) else "" for value in values]
            yield "\t".join([str(step + 1), f"{step / rate:.6f}", *fields, ""]) + "\n"

    header = _header(Path(path).name, names, len(frames), rate, unit)
    atomic_write_text(path, (f"{line}\n" for line in header), (row for part in parts for row in rows(part)))


def check_trc_names(names: Sequence[str]) -> None:
    """Raise `InvalidInputError` if a joint's name cannot stand in a line of tab-separated fields."""
    for name in names:
        if not name.strip() or "\t" in name or name.splitlines() != [name]:
            raise InvalidInputError(f"joint_names: expected names without tabs and line breaks, got {name!r}")


def _header(file_name: str, names: Sequence[str], steps: int, frame_rate: float, unit: str) -> list[str]:
    rate, joints = f"{frame_rate:g}", len(names)
    file_name = " ".join(file_name.split())  # a tab or a line break would be one of the header
    return [
        f"PathFileType\t4\t(X/Y/Z)\t{file_name.encode(errors='replace').decode()}",
        _HEADER.replace(" ", "\t"),
        "\t".join([rate, rate, str(steps), str(joints), unit, rate, "1", str(steps)]),
        "\t".join(["Frame#", "Time", *(f"{name}\t\t" for name in names), ""]),
        "\t".join(["", "", *(f"X{n}\tY{n}\tZ{n}" for n in range(1, joints + 1)), ""]),
        "",
    ]


@checked
def read_trc(path: str | os.PathLike[str]) -> PoseData:
    """Read a TRC file; its axes are kept as they are.

    The blank sixth line may be missing, and empty fields and "nan" are NaN. ``frames`` are the file's own row
    numbers, ``frame_rate`` is its DataRate, None if that is 0 or NaN. If the header counts other frames than
    there are rows, a warning is given.
    """
    source = Path(path)
    lines = read_text(source).splitlines()
    if len(lines) < 5 or not lines[0].startswith("PathFileType"):
        raise DatasetError(source, "header", "five lines that start with PathFileType", f"{len(lines)} lines")
    stated = [*lines[2].split("\t"), "", "", "", "", ""]
    if stated[4] not in MM_PER_UNIT:
        raise DatasetError(source, "line 3 Units", "m, cm or mm in the fifth field", repr(stated[4]))
    markers = tuple(name for name in lines[3].split("\t")[2:] if name.strip())
    if str(len(markers)) != stated[3].strip():
        expected = f"the {stated[3]} marker names that line 3 states"
        raise DatasetError(source, "line 4", expected, len(markers))
    body = [(number, line) for number, line in enumerate(lines[5:], start=6) if line.strip()]
    rows = [_read_row(source, number, line, 3 * len(markers)) for number, line in body]
    count = _stated(source, "NumFrames", stated[2])
    if count != len(rows):
        numbers = {"stated": int(count), "rows": len(rows)}
        words = f"{source}: the header (line 3) states {count:g} frames; {len(rows)} follow and are read."
        warn(Finding("header_contradicts", "warning", Subject(files=(str(path),)), numbers, sentence=words))
    frames = np.array([frame for frame, _ in rows], dtype=np.int64)
    rate = _stated(source, "DataRate", stated[0]) or None
    points = np.array([values for _, values in rows], dtype=np.float64)
    pose = points.reshape(len(rows), len(markers), 3)
    return PoseData(pose, markers, frames, stated[4], frame_rate=rate)


def _stated(path: Path, name: str, text: str) -> float:
    """Return a number of the header's third line, which some programs write as NaN if they do not know it."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not (math.isnan(value) or 0.0 <= value < 2**53):
        raise DatasetError(path, f"line 3 {name}", "a number of at least 0", repr(text))
    return 0.0 if math.isnan(value) else value


def _read_row(path: Path, number: int, line: str, count: int) -> tuple[int, list[float]]:
    """Return the frame number and ``count`` coordinates of a row."""
    fields = line.split("\t")
    if len(fields) == count + 3 and not fields[-1].strip():
        fields.pop()  # the tab at the end
    if len(fields) != count + 2:
        raise DatasetError(path, f"line {number}", f"{count + 2} fields", f"{len(fields)}")
    try:
        frame, values = int(fields[0]), [float(value) if value.strip() else math.nan for value in fields[2:]]
    except ValueError as error:
        raise DatasetError(path, f"line {number}", "numbers", str(error).partition(": ")[2]) from error
    return frame_number(path, f"line {number}, frame", frame), values

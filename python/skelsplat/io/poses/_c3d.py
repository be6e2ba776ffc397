"""C3D, the binary marker file of motion-capture systems; read and written by ezc3d."""

from __future__ import annotations

import json
import math
import os
import struct
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index
from skelsplat._atomic import atomic_path
from skelsplat._budget import read_bytes
from skelsplat._optional import require
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._files import parsing
from skelsplat.io.poses._pose_data import Y_UP, PoseData, checked, known_frame_rate
from skelsplat.io.poses._pose_data import marker_names as named

# Frame numbers are 16-bit words that start at 1, and a residual is seven bits of a byte in whole units.
MAX_FRAMES = 65535
_MAX_RESIDUAL = 127
# Names are stored 255 at a time, padded to the longest, within 32,767 bytes; texts have at most 255 bytes.
_MAX_NAME, _MAX_TEXT = 127, 255
# What is added to frame numbers is stored in single precision.
_EXACT = 2**24
# Beyond it, mm, the coordinates of a C3D file (single precision) are off by more than half a millimetre.
_FAR = 1e7
_MOST = float(np.finfo(np.float32).max)  # of a coordinate
_MISSING, _INTERPOLATED = -1.0, 0.0
_GROUP = "SKELSPLAT"
_CHILD = Path(__file__).with_name("_c3d_child.py")
_COMPLETE = "a complete C3D file"
# What reading may take: of sound files, 13 bytes of memory and 0.1 µs were measured per byte.
_MEMORY, _SECONDS = (256_000_000, 64), (10, 1_000_000)
_BLOCK = 512
_KEY = 0x50
# Intel, DEC, MIPS: the order of the bytes of an integer, and which byte of a float has the sign
_PROCESSORS = {84: ("<", 3), 85: ("<", 1), 86: (">", 0)}
_TYPES = {-1: 1, 1: 1, 2: 2, 4: 4}  # of a parameter: bytes per value


def write_c3d(
    path: str | os.PathLike[str],
    data: PoseData,
    *,
    frame_rate: float | None = None,
    y_up: bool = False,
    marker_names: str = "skelsplat",
) -> None:
    """Write the poses as points of a C3D file, in mm.

    A point's residual is the joint's error bar in whole mm, the root of the mean variance of its axes in
    `PoseData.error_bar`, from 1 to 127: C3D has a byte for it. It is 0 for a joint that was interpolated over
    a gap or has no error bar, and −1 for a joint that is missing, as C3D means these values. A gap in
    `data.frames` becomes frames without points. Numbers that C3D cannot hold (below 1, above 65535) are
    shifted to start at 1; ``SKELSPLAT:FRAME_SHIFT`` is what was added, ``SKELSPLAT:PROCESSING`` holds
    `data.processing`.

    Parameters
    ----------
    path : path
    data : PoseData
    frame_rate : float
        Frames per second; that of `data` if left out.
    y_up : bool
        Write a world with z up as y up, (x, y, z) → (y, z, x), and say so in ``POINT:Y_SCREEN``.
    marker_names : "skelsplat" or "pose2sim"
        What the joints are called, as in `write_trc`.

    Raises
    ------
    InvalidInputError
        If no frame rate is known, `marker_names` is unknown, a name is empty or longer than 127 bytes, or
        there are no frames, or more than 65535 from the first to the last, or the poses are further than
        10 km from the origin, where the numbers of a C3D file are no longer exact to a millimetre.
    MissingPackageError
        If ezc3d is not installed.
    DatasetError
        If the path cannot be written.
    """
    ezc3d = require("ezc3d", "C3D files")
    labels = named(data.joint_names, marker_names)
    rate = known_frame_rate(data, frame_rate, "C3D")
    check_c3d(data.frames, labels)
    fits = data.frames[0] >= 1 and data.frames[-1] <= MAX_FRAMES
    shift = 0 if fits else 1 - int(data.frames[0])  # added to the frame numbers so that C3D can hold them
    rows = data.frames - data.frames[0]
    points = np.full((4, len(data.joint_names), int(rows[-1]) + 1), np.nan)
    points[3] = 1.0
    position = data.pose * MM_PER_UNIT[data.unit]
    check_c3d_place(position)
    points[:3, :, rows] = np.moveaxis(position[..., Y_UP] if y_up else position, (0, 1, 2), (2, 1, 0))
    residuals = np.full((1, *points.shape[1:]), _MISSING)
    residuals[0][:, rows] = _residuals(data).T

    file = ezc3d.c3d()
    point = file["parameters"]["POINT"]
    point["RATE"]["value"] = [rate]
    point["UNITS"]["value"] = ["mm"]
    point["LABELS"]["value"] = list(labels)
    file["header"]["points"]["first_frame"] = int(data.frames[0]) + shift - 1
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = residuals
    file["data"]["meta_points"]["camera_masks"] = np.zeros((7, *points.shape[1:]), dtype=bool)
    if y_up:
        file.add_parameter("POINT", "X_SCREEN", ["+X"])
        file.add_parameter("POINT", "Y_SCREEN", ["+Y"])
    file.add_parameter(_GROUP, "VERSION", [sk.__version__])
    file.add_parameter(_GROUP, "FRAME_SHIFT", [shift])
    if data.processing:
        texts = [text.encode()[:_MAX_TEXT].decode(errors="ignore") for text in data.processing]
        file.add_parameter(_GROUP, "PROCESSING", texts)
    with atomic_path(path, suffix=".c3d") as temporary:  # ezc3d appends it to a name without it
        file.write(str(temporary))


def check_c3d(frames: Index, names: Sequence[str]) -> None:
    """Raise `InvalidInputError` unless frame numbers and joints of these names fit into one C3D file."""
    span = int(frames[-1] - frames[0]) + 1 if len(frames) else 0
    if not 1 <= span <= MAX_FRAMES:
        raise InvalidInputError(
            f"frame numbers: expected 1 to {MAX_FRAMES} from the first to the last in a C3D file, got {span}"
        )
    if (np.diff(frames) < 1).any():
        raise InvalidInputError("frame numbers: expected ascending numbers, got some that are not")
    if abs(int(frames[0])) > _EXACT:
        expected = f"numbers up to {_EXACT:,} in a C3D file"
        raise InvalidInputError(f"frame numbers: expected {expected}, got {frames[0]}")
    for name in names:
        if not name.strip() or len(name.encode()) > _MAX_NAME:
            expected = f"names of 1 to {_MAX_NAME} bytes in a C3D file"
            raise InvalidInputError(f"joint_names: expected {expected}, got {name!r:.60}")


def check_c3d_place(points_mm: Array) -> None:
    """Raise `InvalidInputError` unless most points (…, 3) are near enough to the origin for a C3D file."""
    furthest = np.abs(points_mm).max(axis=-1)
    known = furthest[np.isfinite(furthest)]
    if known.size and np.median(known) > _FAR:
        expected = f"positions within {_FAR / 1e6:g} km of the origin in a C3D file, of 7 digits"
        raise InvalidInputError(f"pose: expected {expected}, got {np.median(known) / 1e6:.6g} km")
    if known.size and known.max() > _MOST:
        expected = f"positions within {_MOST:.3g} mm of the origin in a C3D file"
        raise InvalidInputError(f"pose: expected {expected}, got one at {known.max():.3g} mm")


def _residuals(data: PoseData) -> Array:
    """Return the residual of every joint, (T, N)."""
    missing = ~np.isfinite(data.pose).all(axis=-1)
    residuals = np.full(missing.shape, _INTERPOLATED)
    if data.uncertainty.size:
        variance = np.trace(data.error_bar, axis1=-2, axis2=-1) / 3
        deviation = np.sqrt(variance) * MM_PER_UNIT[data.unit]
        residuals = np.where(np.isfinite(variance), np.clip(np.rint(deviation), 1, _MAX_RESIDUAL), residuals)
    if data.joint_status.size:
        residuals[data.joint_status == "filled"] = _INTERPOLATED
    residuals[missing] = _MISSING
    return residuals


@checked
def read_c3d(path: str | os.PathLike[str]) -> PoseData:
    """Read the points of a C3D file; its axes are kept as they are.

    A point with a negative residual is missing. The other residuals are not read: what they mean differs
    between writers.

    Raises
    ------
    MissingPackageError
        If ezc3d is not installed.
    DatasetError
        If the file cannot be read, does not state its unit, frame rate or a label for every point, or is cut
        short.
    """
    source = Path(path)
    found = _read(source)
    point, own, points = found.parameters["POINT"], found.parameters["SKELSPLAT"], found.points
    steps = found.last_frame - found.first_frame + 1
    if points.shape[2] != steps:
        raise DatasetError(source, "frames", f"{steps} as the header states", points.shape[2])
    if not points.shape[1]:
        raise DatasetError(source, "points", "at least one", "none")
    missing = found.residuals[0] < 0.0
    pose = np.moveaxis(np.where(missing, np.nan, points[:3]), (0, 1, 2), (2, 1, 0))
    shift = _shift(source, own.get("FRAME_SHIFT", [0.0]))
    return PoseData(
        pose=np.ascontiguousarray(pose),
        joint_names=_labels(source, point, points.shape[1]),
        frames=np.arange(steps, dtype=np.int64) + found.first_frame + 1 - shift,
        unit=_unit(source, point),
        frame_rate=_rate(source, point),
        processing=tuple(own.get("PROCESSING", ())),
    )


def c3d_is_y_up(path: str | os.PathLike[str]) -> bool:
    """Tell whether a C3D file states, in ``POINT:Y_SCREEN``, that its y axis points up the screen."""
    point = _read(Path(path)).parameters["POINT"]
    return [axis.strip() for axis in point.get("Y_SCREEN", ())] == ["+Y"]


@dataclass(frozen=True)
class _Read:
    """What ezc3d finds in a file: points (4, N, T), residuals (1, N, T), parameters by group and name."""

    points: Array
    residuals: Array
    parameters: dict[str, dict[str, list[Any]]]
    first_frame: int
    last_frame: int


def _read(source: Path) -> _Read:
    """Read a file in a process of its own: of damaged files, some end ezc3d, or fill the memory."""
    require("ezc3d", "C3D files")
    with parsing(source, _COMPLETE):
        content = read_bytes(source)
        _check_structure(source, content)
    memory, seconds = _MEMORY[0] + _MEMORY[1] * len(content), _SECONDS[0] + len(content) // _SECONDS[1]
    with tempfile.TemporaryDirectory() as place:
        target = Path(place, "read.npz")
        ended = _child(str(source.absolute()), str(target), memory, seconds)
        if ended or not target.is_file():
            got = f"one that ends its reader ({ended or 'nothing read'})"
            raise DatasetError(source, "file", _COMPLETE, got)
        with np.load(target, allow_pickle=False) as arrays:
            about = json.loads(arrays["about"].tobytes())
            if "error" in about:
                raise DatasetError(source, "file", _COMPLETE, about["error"])
            return _Read(arrays["points"], arrays["residuals"], **about)


def _child(source: str, target: str, memory: int, seconds: int) -> str:
    """Run `_c3d_child` within limits; return how it ended, "" if well."""
    paths = [path for path in sys.path if path]
    call = [sys.executable, "-I", str(_CHILD), source, target, str(memory), str(seconds), *paths]
    try:
        done = subprocess.run(
            call,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            check=False,
            timeout=10 * seconds,  # on a busy machine
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )
    except subprocess.TimeoutExpired:
        return f"after {10 * seconds} s"
    return ended_with(done.returncode)


def ended_with(status: int) -> str:
    """Return how a process ended, "" if well."""
    return f"signal {-status}" if status < 0 else f"status {status}" if status else ""


def _labels(path: Path, point: dict[str, list[Any]], count: int) -> tuple[str, ...]:
    keys = ["LABELS", *(f"LABELS{k}" for k in range(2, 10))]
    labels = [label.strip() for key in keys for label in point.get(key, ())]
    if len(labels) < count or not all(labels[:count]):
        raise DatasetError(path, "POINT:LABELS", f"a label for each of {count} points", len(labels))
    return tuple(labels[:count])


def _shift(path: Path, values: list[Any]) -> int:
    if not values or not abs(values[0]) <= _EXACT:
        raise DatasetError(path, f"{_GROUP}:FRAME_SHIFT", "a whole number", values)
    return int(values[0])


def _unit(path: Path, point: dict[str, list[Any]]) -> str:
    values = point.get("UNITS", [])
    unit = values[0].strip().lower() if values else ""
    if unit not in MM_PER_UNIT:
        raise DatasetError(path, "POINT:UNITS", "mm, cm or m", repr(unit))
    return unit


def _rate(path: Path, point: dict[str, list[Any]]) -> float:
    values = point.get("RATE", [])
    rate = float(str(np.float32(values[0]))) if len(values) else 0.0  # stored in single precision
    if not (np.isfinite(rate) and rate > 0.0):
        raise DatasetError(path, "POINT:RATE", "frames per second, a positive number", rate)
    return rate


def _check_structure(path: Path, content: bytes) -> None:
    """Raise `DatasetError` unless header, parameters and data of a C3D file lie within ``content``.

    A damaged file can send ezc3d into an endless loop or out of its memory, so every length and offset is
    followed here first. The format: a header and parameter entries in blocks of 512 bytes, and the points
    after them (https://www.c3d.org/docs/C3D_User_Guide.pdf).
    """
    if len(content) < 2 * _BLOCK or content[1] != _KEY or content[0] < 2:
        raise DatasetError(path, "file", "a C3D file (its second byte is 80)", "something else")
    start = _BLOCK * (content[0] - 1)
    if start + 4 > len(content):
        raise _cut(path, "parameters", start, content)
    if content[start + 3] not in _PROCESSORS:
        raise DatasetError(path, "processor type", "84, 85 or 86", content[start + 3])
    order, sign = _PROCESSORS[content[start + 3]]
    _check_parameters(path, content, start + 4, order)
    _check_data(path, content, order, negative_scale=bool(content[12 + sign] & 0x80))


def _cut(path: Path, what: str, end: int, content: bytes) -> DatasetError:
    return DatasetError(path, what, f"them to end at byte {end}", f"a file of {len(content)} bytes")


def _check_parameters(path: Path, content: bytes, at: int, order: str) -> None:
    """Walk from entry to entry: length of the name, number, name, offset of the next, and what it holds."""
    while True:
        if at + 2 > len(content):
            raise _cut(path, "parameters", at + 2, content)
        name_length, number = struct.unpack_from("bb", content, at)
        if name_length == 0:
            return
        at += 2 + abs(name_length)
        if at + 2 > len(content):
            raise _cut(path, "parameters", at + 2, content)
        (offset,) = struct.unpack_from(f"{order}h", content, at)
        end = at + offset if offset else len(content)
        if not at + 2 < end <= len(content):
            raise _cut(path, "parameters", end, content)
        if number > 0:
            _check_value(path, content[at + 2 : end])
        if offset == 0:
            return
        at = end


def _check_value(path: Path, entry: bytes) -> None:
    kind, dimensions = struct.unpack_from("bB", entry.ljust(2, b"\0"))
    sizes = entry[2 : 2 + dimensions]
    if kind not in _TYPES or dimensions > 7 or len(sizes) != dimensions:
        raise DatasetError(path, "parameters", "types and sizes of the format", "another entry")
    end = 2 + dimensions + _TYPES[kind] * math.prod(sizes)
    if end >= len(entry):
        raise DatasetError(path, "parameters", f"an entry of more than {end} bytes", f"{len(entry)} bytes")


def _check_data(path: Path, content: bytes, order: str, *, negative_scale: bool) -> None:
    """Compare the length of the file with the frames that the header counts."""
    points, analog, first, last = struct.unpack_from(f"{order}4H", content, 2)
    (start,) = struct.unpack_from(f"{order}H", content, 16)
    if start < 2 or last < first:
        raise DatasetError(path, "header", "data after the parameters and ascending frames", "others")
    size = 4 if negative_scale else 2  # floats, else 16-bit integers
    end = _BLOCK * (start - 1) + (last - first + 1) * size * (4 * points + analog)
    if last < MAX_FRAMES and end > len(content):  # longer recordings count their frames elsewhere
        raise _cut(path, "frames", end, content)

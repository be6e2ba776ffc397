"""C3D, the binary marker file of motion-capture systems; read and written by ezc3d."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index
from skelsplat._atomic import atomic_path
from skelsplat._optional import require
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.exceptions import DatasetError, InvalidInputError
from skelsplat.io._guarded import read_guarded
from skelsplat.io.poses._markers import Y_UP, as_markers
from skelsplat.io.poses._pose_data import PoseData, checked, known_frame_rate

# Frame numbers are 16-bit words that start at 1, and a residual is seven bits of a byte in whole units.
MAX_FRAMES = 65535
_MAX_RESIDUAL = 127
# Names are stored 255 at a time, padded to the longest, within 32,767 bytes; texts have at most 255 bytes.
_MAX_NAME, _MAX_TEXT = 127, 255
# What is added to frame numbers is stored in single precision.
_EXACT = 2**24
_MISSING, _INTERPOLATED = -1.0, 0.0
_GROUP = "SKELSPLAT"
_WHOLE = "a complete C3D file"


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
    a gap or has no error bar, and −1 for a joint that is missing. A gap in `data.frames` becomes frames
    without points. Numbers that C3D cannot hold (below 1, above 65535) are shifted to start at 1, by
    ``SKELSPLAT:FRAME_SHIFT``. ``SKELSPLAT:PROCESSING`` holds `data.processing`.

    The parameters are those of `write_trc`; ``POINT:Y_SCREEN`` says if y is up.
    """
    ezc3d = require("ezc3d", "C3D files")
    data = as_markers(data, marker_names)
    labels = data.joint_names
    rate = known_frame_rate(data, frame_rate, "C3D")
    check_c3d(data.frames, labels)
    fits = data.frames[0] >= 1 and data.frames[-1] <= MAX_FRAMES
    shift = 0 if fits else 1 - int(data.frames[0])  # added to the frame numbers so that C3D can hold them
    rows = data.frames - data.frames[0]
    points = np.full((4, len(data.joint_names), int(rows[-1]) + 1), np.nan)
    points[3] = 1.0
    position = data.pose * MM_PER_UNIT[data.unit]
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
    if not 1 <= span <= MAX_FRAMES or (np.diff(frames) < 1).any() or abs(int(frames[0])) > _EXACT:
        expected = f"1 to {MAX_FRAMES} ascending numbers, below {_EXACT:,}, in a C3D file"
        got = f"{span} from {frames[0]} on" if len(frames) else "none"
        raise InvalidInputError(f"frame numbers: expected {expected}, got {got}")
    for name in names:
        if not name.strip() or len(name.encode()) > _MAX_NAME:
            expected = f"names of 1 to {_MAX_NAME} bytes in a C3D file"
            raise InvalidInputError(f"joint_names: expected {expected}, got {name!r:.60}")


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
    """
    source = Path(path)
    found: dict[str, Any] = read_guarded("c3d", source, _WHOLE)
    point, own, points = found["parameters"]["POINT"], found["parameters"][_GROUP], found["points"]
    steps, count = found["last_frame"] - found["first_frame"] + 1, points.shape[1]
    parts = ("LABELS", *(f"LABELS{k}" for k in range(2, 10)))
    labels = [label.strip() for part in parts for label in point.get(part, ())]
    labelled = len(labels) >= count and all(labels[:count])
    unit = "".join(point.get("UNITS", [])[:1]).strip().lower()
    rate = float(str(np.float32([*point.get("RATE", []), 0.0][0])))  # stored in single precision
    shift = [*own.get("FRAME_SHIFT", [0.0]), np.inf][0]
    for field, expected, fits, got in (
        ("frames", f"{steps} as the header states", points.shape[2] == steps, points.shape[2]),
        ("points", "at least one", count > 0, "none"),
        ("POINT:LABELS", f"a label for each of {count} points", labelled, labels),
        ("POINT:UNITS", "mm, cm or m", unit in MM_PER_UNIT, repr(unit)),
        ("POINT:RATE", "frames per second, a positive number", 0.0 < rate < np.inf, rate),
        (f"{_GROUP}:FRAME_SHIFT", "a whole number", abs(shift) <= _EXACT, shift),
    ):
        if not fits:
            raise DatasetError(source, field, expected, got)
    missing = found["residuals"][0] < 0.0
    pose = np.moveaxis(np.where(missing, np.nan, points[:3]), (0, 1, 2), (2, 1, 0))
    return PoseData(
        pose=np.ascontiguousarray(pose),
        joint_names=tuple(labels[:count]),
        frames=np.arange(steps, dtype=np.int64) + found["first_frame"] + 1 - int(shift),
        unit=unit,
        frame_rate=rate,
        processing=tuple(own.get("PROCESSING", ())),
    )


def c3d_is_y_up(path: str | os.PathLike[str]) -> bool:
    """Tell whether a C3D file states, in ``POINT:Y_SCREEN``, that its y axis points up the screen."""
    point = read_guarded("c3d", Path(path), _WHOLE)["parameters"]["POINT"]
    return [axis.strip() for axis in point.get("Y_SCREEN", ())] == ["+Y"]

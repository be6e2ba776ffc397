"""DeepLabCut results in csv, single- and multi-animal: one file per camera.

Three header lines scorer, bodyparts, coords, or four with individuals after the scorer; then a line per frame
that begins with the frame number. An empty field is a missing value. Parts are matched to joints by name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from skelsplat.exceptions import DatasetError
from skelsplat.io._files import frame_number
from skelsplat.io.detections._csv import csv_header, csv_lines
from skelsplat.io.detections._dlc_table import LEVELS, Table, camera_part
from skelsplat.io.detections._format import DetectionFormat, View

if TYPE_CHECKING:
    from pathlib import Path


def read_file(path: Path) -> View:
    """Return the view of one camera."""
    lines = [line for line in csv_lines(path) if line]
    names = [line[0] for line in lines[:4]]
    depth = 4 if len(names) > 1 and names[1] == "individuals" else 3
    levels = tuple(names[:depth])
    if levels not in LEVELS:
        expected = " or ".join("/".join(known) for known in LEVELS)
        raise DatasetError(path, "header", expected, "/".join(levels) or "an empty file")
    width = len(lines[0])
    for place, line in enumerate(lines):
        if len(line) != width:
            raise DatasetError(path, f"line {place + 1}", f"{width} fields", f"{len(line)} fields")
    header = [line[1:] for line in lines[:depth]]
    body = list(enumerate(lines[depth:], start=depth + 1))
    frames = [_frame(path, number, line[0]) for number, line in body]
    values = [[_value(path, number, text) for text in line[1:]] for number, line in body]
    array = np.array(values, dtype=np.float64).reshape(len(body), width - 1)
    return Table(path, levels, list(zip(*header, strict=True)), frames, array).view()


def _frame(path: Path, line: int, text: str) -> int:
    if not text.isdecimal():
        raise DatasetError(path, f"line {line}", "a frame number (results of a video)", repr(text))
    return frame_number(path, f"line {line}", text)


def _value(path: Path, line: int, text: str) -> float:
    try:
        return float(text) if text.strip() else float("nan")
    except ValueError:
        raise DatasetError(path, f"line {line}", "a number or an empty field", repr(text)) from None


FORMAT = DetectionFormat(
    name="deeplabcut_csv",
    suffixes=(".csv",),
    matches=lambda path: len(first := csv_header(path)) > 1 and first[0] == "scorer",
    file=read_file,
    camera_part=camera_part,
)

"""What a report is made of: plain values and arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from skelsplat._arrays import Array, read_fields
from skelsplat.viz._skeleton import Skeleton


@dataclass(frozen=True)
class CameraShapes:
    """The cameras as they are drawn.

    Parameters
    ----------
    names
        M names.
    centres : (M, 3)
        Their positions, in mm.
    corners : (M, 4, 3)
        From the centre to the image's corners (top left, top right, bottom right, bottom left), at depth 1.
    """

    names: Sequence[str]
    centres: Array
    corners: Array

    def __post_init__(self) -> None:
        read_fields(self, "centres", "corners")


@dataclass(frozen=True)
class Sequence3D:
    """The sequence that the page plays.

    Parameters
    ----------
    start, refined : (T, N, 3)
        Joint positions before and after, in mm; NaN where unknown.
    uncertainty : (T, N, 3, 3)
        Covariances of the refined joints, in mm²; NaN where unknown.
    status : (T, N)
        Joints whose status is not ``"ok"`` are drawn hollow.
    frames : (T,)
        Frame numbers.
    frame_rate
        Frames per second; None if unknown.
    joint_names
        N names.
    skeleton
        Limbs and sides.
    up : (3,)
        The vertical: an axis of the world or its opposite.
    start_name
        What ``start`` is, in words.
    """

    start: Array
    refined: Array
    uncertainty: Array
    status: npt.NDArray[np.str_]
    frames: npt.NDArray[np.int64]
    frame_rate: float | None
    joint_names: Sequence[str]
    skeleton: Skeleton
    up: Array
    start_name: str

    def __post_init__(self) -> None:
        read_fields(self, "start", "refined", "uncertainty", "up")


@dataclass(frozen=True)
class KeyNumber:
    """A number worth a glance: what it is, its text, and a remark."""

    label: str
    value: str
    remark: str = ""


@dataclass(frozen=True)
class Column:
    """The head of a column, and what its numbers are, in words."""

    head: str
    meaning: str = ""


@dataclass(frozen=True)
class Table:
    """Cells as texts; the first of a row names it. ``total`` is a last row for all."""

    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]
    total: Sequence[str] = ()


@dataclass(frozen=True)
class TimeLine:
    """A curve over the frames.

    Parameters
    ----------
    title, unit
        What the values are.
    values : (T,)
        NaN where there is none.
    peaks
        Of a sequence that is thinned out, keep the largest value between two frames shown.
    beside : (T,), optional
        A second curve in grey, called ``beside_name``.
    """

    title: str
    unit: str
    values: Array
    peaks: bool = False
    beside: Array | None = None
    beside_name: str = ""

    def __post_init__(self) -> None:
        read_fields(self, "values", *(() if self.beside is None else ("beside",)))


@dataclass(frozen=True)
class ProblemRow:
    """Frames from ``first`` to ``last`` (numbers) that have the same problem, in words."""

    first: int
    last: int
    words: str


@dataclass(frozen=True)
class ReportData:
    """A whole report.

    Parameters
    ----------
    title
        What was refined.
    facts
        (name, value) pairs for the line below it.
    warnings
        Sentences; empty without any.
    notes
        Sentences on how to read the numbers and on what was done to the poses.
    numbers, cameras, joints, lines, problems, sequence, shapes
        The parts of the page.
    errors_px, rejected : (M, N)
        By camera and joint: median error in px, and the part of the detections that is rejected; NaN where a
        camera has no detection of a joint that is used.
    """

    title: str
    facts: Sequence[tuple[str, str]]
    warnings: Sequence[str]
    notes: Sequence[str]
    numbers: Sequence[KeyNumber]
    sequence: Sequence3D
    shapes: CameraShapes
    cameras: Table
    joints: Table
    errors_px: Array
    rejected: Array
    lines: Sequence[TimeLine]
    problems: Sequence[ProblemRow]

    def __post_init__(self) -> None:
        read_fields(self, "errors_px", "rejected")

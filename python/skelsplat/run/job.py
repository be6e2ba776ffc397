"""What a run is asked to do."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from skelsplat.cli._calibration import CalibrationOptions
from skelsplat.run.over_time import OverTime

if TYPE_CHECKING:
    from pathlib import Path


@dataclass(frozen=True)
class Job:
    """One run: where the input is, how to read it, how to refine it.

    Parameters
    ----------
    calibration, detections
        The calibration file, and the folder or file of detections.
    layout
        Name of the joint layout of the detections; None: the one whose joints the files name.
    out
        Folder for the results.
    cameras
        What the user says about the calibration.
    person
        ``"consistent"``, ``"largest"`` or the index of a person.
    frames
        What to do with cameras of different frame counts: ``"strict"``, ``"intersection"`` or ``"union"``.
    format
        Format of the detections; None to find it from the files.
    offsets
        By camera, frames to add to its frame numbers; names as the user wrote them.
    order
        The source of each camera's detections, or ``"sorted"``; None to match by name.
    without
        Names of cameras that are left out, as the user wrote them.
    mapping
        By joint of the layout, its name or place in the files, where these differ.
    sequence
        Which sequence of a file that has several.
    init
        A pose file to start from; None for triangulation.
    init_sigma_mm
        Standard deviation per axis of that pose, if it is independent of the detections; None: it only says
        where to begin.
    paper
        Use the paper's preset, `skelsplat.RefineConfig.paper`, instead of the default.
    fps
        Frames per second of the recording; None if unknown.
    y_up
        Write ``pose.trc`` and ``pose.c3d`` with y pointing up, for OpenSim, instead of z.
    marker_names
        What joints are called in these two, of `skelsplat.io.poses.MARKER_NAMES`.
    write
        The pose files to write, keys of `skelsplat.io.poses.POSE_FORMATS`.
    html
        Write ``report.html``.
    over_time
        What to do with gaps and noise over time; nothing by default.
    settings
        The fields of `skelsplat.RefineConfig` that the user set; the others keep the preset's values.
    note
        A sentence about the input that belongs beside its numbers.
    """

    calibration: Path
    detections: Path
    layout: str | None
    out: Path
    cameras: CalibrationOptions = field(default_factory=CalibrationOptions)
    person: str = "consistent"
    frames: str = "strict"
    format: str | None = None
    offsets: dict[str, int] = field(default_factory=dict)
    order: str | tuple[str, ...] | None = None
    without: tuple[str, ...] = ()
    mapping: dict[str, str | int | None] = field(default_factory=dict)
    sequence: str | None = None
    init: Path | None = None
    init_sigma_mm: float | None = None
    paper: bool = False
    fps: float | None = None
    y_up: bool = False
    marker_names: str = "skelsplat"
    write: tuple[str, ...] = ("npz", "csv", "trc")
    html: bool = True
    over_time: OverTime = field(default_factory=OverTime)
    settings: dict[str, Any] = field(default_factory=dict)
    note: str = ""


@dataclass(frozen=True)
class Verbosity:
    """What a run says while it works: ``quiet`` nothing but warnings, ``as_json`` the report on stdout."""

    quiet: bool = False
    as_json: bool = False

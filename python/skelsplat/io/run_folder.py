"""The folder of a run: what went in and what came out, enough to draw it or to run it again.

==================  ==========================================================================================
pose.npz            every array of the refinement (`skelsplat.io.write_npz`)
cameras.json        the cameras, in the unit of the poses (`skelsplat.io.write_calibration`)
detections.npz      the detections of the person who was followed (`skelsplat.io.read_detections`)
layout.toml         the layout, if it is not a built-in one (`skelsplat.layouts.read`)
report.json         settings, inputs and statistics
==================  ==========================================================================================

All of them say which run they are of; `read_run` refuses the files of two runs.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index
from skelsplat._atomic import atomic_write, atomic_write_text
from skelsplat._clocks import Clock
from skelsplat._fields import FRAME_LIMIT, Field
from skelsplat.exceptions import DatasetError
from skelsplat.io._arrays import RowFile, write_npz
from skelsplat.io._files import json_document
from skelsplat.io._run_files import (
    CAMERAS,
    DETECTIONS,
    LAYOUT,
    MARKED,
    POSES,
    REPORT,
    RUN,
    check_finished,
    check_one_run,
    folders_of_run,
    mark,
)
from skelsplat.io.calibration import read_calibration, write_calibration
from skelsplat.io.detections import open_detections
from skelsplat.io.poses._npz import read_npz, read_npz_range
from skelsplat.io.poses._pose_data import PoseData


@dataclass(frozen=True)
class RunFolder:
    """A run as `read_run` finds it.

    `rig` is in the unit of the `poses`, which have all arrays of the refinement; `detections` (T, M, N, 3)
    are one person's pixels and confidences, NaN where missing; `report` is ``report.json``. `ends` are the
    numbers of the first and the last frame of the run, of which the arrays may hold a part.
    """

    path: Path
    rig: sk.CameraRig
    layout: sk.Layout
    detections: Array
    poses: PoseData
    report: dict[str, Any]
    ends: tuple[int, int] = (0, 0)

    @property
    def undistorted(self) -> bool:
        """Whether the lens distortion of the cameras was taken out of the detections."""
        return bool(self.report["settings"]["undistort"])

    @property
    def clocks(self) -> dict[str, Clock]:
        """How each camera counts, against the frames of the run."""
        given = self.report["input"]
        offsets, rates = (given.get(name) or {} for name in ("offsets", "frame_rates_hz"))
        slowest, first = min(rates.values(), default=1.0), given.get("counted_from", 0)
        return {
            name: Clock(offsets.get(name, 0), rates.get(name, slowest) / slowest, first)
            for name in self.rig.names
        }


def write_run_inputs(
    folder: Path,
    rig: sk.CameraRig,
    layout: sk.Layout,
    detections: Array | RowFile,
    frames: Index,
    frame_rate: float | None = None,
    run: str | None = None,
) -> list[str]:
    """Write cameras, detections (T, M, N, 3) of one person and an own layout; return the files' names.

    They say that they are of ``run``.
    """
    write_calibration(folder / CAMERAS, rig, note=None if run is None else mark(run))
    own = not sk.layouts.is_built_in(layout)
    if own:
        first = "" if run is None else f"# {mark(run)}\n"
        atomic_write_text(folder / LAYOUT, f"{first}{sk.layouts.to_toml(layout)}")
    arrays: dict[str, Any] = {
        "detections": detections,
        "frames": frames,
        "frame_rate": np.array(np.nan if frame_rate is None else frame_rate),
        "camera_names": np.array(rig.names, dtype=np.str_),
        "joint_names": np.array(layout.joints, dtype=np.str_),
        **({} if run is None else {RUN: np.array(run)}),
    }
    with atomic_write(folder / DETECTIONS) as stream:
        write_npz(stream, arrays)
    return [CAMERAS, DETECTIONS, *([LAYOUT] if own else [])]


def read_run(
    path: str | os.PathLike[str], *, within: Callable[[Index], tuple[int, int]] | None = None
) -> RunFolder:
    """Read the folder that ``skelsplat refine`` or ``skelsplat demo`` wrote.

    Given the numbers (T,) of the run's frames, ``within`` returns the first and the last one to read; of a
    long run the others then take no memory. `DatasetError` if a file is missing or malformed, or the files do
    not belong to one run.
    """
    folder = Path(path)
    if not (folder / REPORT).is_file():
        got = "a folder without it" if folder.is_dir() else "no such folder"
        raise DatasetError(folder, REPORT, "the folder of a run of skelsplat refine", got)
    report = _read_report(folder / REPORT)
    own = folder / LAYOUT
    needed = (folder / name for name in MARKED if name != LAYOUT or own.is_file())
    check_one_run(folder / REPORT, needed)
    layout = sk.layouts.read(own) if own.is_file() else sk.layouts.named(report["input"]["layout"])
    rig = read_calibration(folder / CAMERAS)
    opened = open_detections(folder / DETECTIONS, list(rig.names), layout=layout, format="npz")
    every = opened.frames
    ends = (int(every[0]), int(every[-1])) if len(every) else (0, 0)
    first, last = ends if within is None else within(every)
    if (first, last) == ends:
        poses = read_npz(folder / POSES)
    else:
        poses = read_npz_range(folder / POSES, first, last)
        opened = replace(opened, frames=every[(every >= first) & (every <= last)])
    found = opened.read()
    for name, expected, actual in (
        ("joint_names", tuple(layout.joints), poses.joint_names),
        ("camera_names", tuple(rig.names), poses.camera_names),
        ("unit", rig.unit, poses.unit),
        ("frames", found.frames.tolist(), poses.frames.tolist()),
    ):
        if expected != actual:
            same = f"those of the same run ({str(expected)[:60]})"
            raise DatasetError(folder / POSES, name, same, str(actual)[:60])
    return RunFolder(folder, rig, layout, found.people[:, :, 0], poses, report.value, ends)


def _read_report(path: Path) -> Field:
    report = json_document(path, "the report of a run")
    check_finished(path, report.value)
    if "folders" in report and isinstance(report["folders"].value, list):
        people = ", ".join(folders_of_run(path.parent))
        raise report["folders"].error("the folder of one person", f"the run of several ({people})")
    settings, given = (report[key].table() for key in ("settings", "input"))
    if not isinstance(settings["undistort"].value, bool):
        raise settings["undistort"].error("true or false", settings["undistort"].shown)
    for key, least, expected in (
        ("offsets", -FRAME_LIMIT, "a number of frames"),
        ("frame_rates_hz", 0, "a frame rate"),
    ):
        table = given[key].table() if given.value.get(key) else Field(path, "", {})
        for name in table.value:
            if not least < table[name].number() < FRAME_LIMIT:
                raise table[name].error(expected, table[name].shown)
    if "counted_from" in given:
        given["counted_from"].index()
    return report

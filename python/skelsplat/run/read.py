"""From files to a refined sequence: check the output folder, read, choose the person, refine."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import skelsplat as sk
from skelsplat.association import take_people
from skelsplat.cameras import MM_PER_UNIT
from skelsplat.cli._reading import leave_out, named_offsets, read_found
from skelsplat.exceptions import DatasetError
from skelsplat.io import read_npz
from skelsplat.run.person import look_around, pick_places

if TYPE_CHECKING:
    import numpy.typing as npt

    from skelsplat._crowd import Crowd
    from skelsplat.run.job import Job

    Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Inputs:
    """What was read.

    Parameters
    ----------
    rig, layout
        The cameras, and what the joints are.
    detections : (T, M, N, 3)
        One person's detections; NaN where missing.
    nobody_fits : (T, M)
        Somebody is detected in this view and another, but nobody who fits: the person is missing here.
    frames : (T,)
        Frame numbers of the files.
    init_pose : (T, N, 3)
        The start in the rig's unit, or None for triangulation.
    format, calibration_format
        Names of the formats of the detections and of the calibration; None where it is not known.
    lacking
        Joints that the files lack by the user's own word.
    offsets
        By camera, frames that were added to its numbers, where the user gave them.
    without
        Cameras of the calibration that are left out.
    sources
        The files or folders that hold the cameras' detections.
    person
        Whom to follow, as `Job.person`.
    crowd
        The people whom the cameras see; None where they see one.
    """

    rig: sk.CameraRig
    layout: sk.Layout
    detections: Array
    nobody_fits: npt.NDArray[np.bool_]
    frames: npt.NDArray[np.int64]
    init_pose: Array | None
    format: str = ""
    calibration_format: str | None = None
    lacking: frozenset[str] = frozenset()
    offsets: dict[str, int] = field(default_factory=dict)
    without: tuple[str, ...] = ()
    sources: tuple[Path, ...] = ()
    person: str = "consistent"
    crowd: Crowd | None = None


def read_inputs(job: Job) -> Inputs:
    """Read what ``job`` names and follow one person through it.

    Raises
    ------
    DatasetError, InvalidInputError, typer.BadParameter
        If a file is missing or malformed, or files and options do not fit each other; the message names it.
    """
    every = job.cameras.read(job.calibration, format_option="--calibration-format")
    if len(every) < 2:
        raise DatasetError(job.calibration, "cameras", "at least two cameras", len(every))
    rig = leave_out(every, job.without)
    found = read_found(
        job.detections,
        every,
        without=job.without,
        layout=job.layout,
        format=job.format,
        frames=job.frames,
        offsets=job.offsets,
        order=job.order,
        mapping=job.mapping,
        sequence=job.sequence,
    )
    layout = sk.layouts.get(found.layout)
    index, nobody_fits = pick_places(found.people, rig, job.person, layout)
    init = None if job.init is None else _read_init(job.init, rig, (len(found.frames), layout))
    known = job.cameras.format_of(job.calibration)
    lacking = frozenset(joint for joint, place in job.mapping.items() if place is None)
    return Inputs(
        rig,
        layout,
        take_people(found.people, index),
        nobody_fits,
        found.frames,
        init,
        format=found.format,
        calibration_format=known,
        lacking=lacking,
        offsets=named_offsets(every, job.offsets),
        without=tuple(name for name in every.names if name not in rig.names),
        sources=tuple(path for path in found.sources if path is not None),
        person=job.person,
        crowd=look_around(found.people, index, rig, job.person, layout),
    )


def _read_init(path: Path, rig: sk.CameraRig, size: tuple[int, sk.Layout]) -> Array:
    """Read an initial pose for ``size`` = (frames, layout), in the rig's unit."""
    data = read_npz(path)
    steps, layout = size
    expected = (steps, layout.n_joints, 3)
    if data.pose.shape != expected:
        raise DatasetError(path, "pose", f"shape {expected} like the detections", data.pose.shape)
    if data.joint_names != tuple(layout.joints):
        raise DatasetError(path, "joint_names", f"the joints of {layout.name}", ", ".join(data.joint_names))
    scaled: Array = data.pose * (MM_PER_UNIT[data.unit] / rig.mm_per_unit)
    return scaled

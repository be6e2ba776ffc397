"""From inputs to refined poses, and the plain triangulation they are compared with."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

import skelsplat as sk
from skelsplat.cameras import without_distortion

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from skelsplat.run.job import Job
    from skelsplat.run.read import Inputs

    Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Outcome:
    """A refined sequence and what it is compared with.

    Parameters
    ----------
    result, config
        What `skelsplat.refine` returned, and its settings.
    start : (T, N, 3)
        The initial pose if the user gave one, otherwise the plain triangulation (DLT) of the detections. The
        default method begins with a robust triangulation, which would hide what robustness changes.
    seconds
        Wall time of `skelsplat.refine` alone.
    """

    result: sk.Refinement
    config: sk.RefineConfig
    start: Array
    seconds: float


def refine_inputs(inputs: Inputs, job: Job, progress: Callable[[int, int], None] | None = None) -> Outcome:
    """Refine all frames; ``progress`` is called with (frames done, frames in all)."""
    config = sk.RefineConfig.paper(**job.settings) if job.paper else sk.RefineConfig(**job.settings)
    begin = time.perf_counter()
    result = sk.refine(
        inputs.init_pose,
        inputs.detections,
        inputs.rig,
        layout=inputs.layout,
        init_sigma=None if job.init_sigma_mm is None else job.init_sigma_mm / inputs.rig.mm_per_unit,
        config=config,
        progress=progress if progress is not None else False,
    )
    seconds = time.perf_counter() - begin
    start = _plain(inputs, config) if inputs.init_pose is None else np.asarray(result.init_pose)
    return Outcome(result, config, start, seconds)


def _plain(inputs: Inputs, config: sk.RefineConfig) -> Array:
    """Triangulate the detections that count, by DLT, (T, N, 3)."""
    counts = inputs.detections[..., 2] >= config.min_confidence
    detections = np.where(counts[..., None], inputs.detections, np.nan)
    rig = rig_as_used(inputs.rig, undistort=config.undistort)
    return sk.triangulate(detections, rig, method="dlt")


def rig_as_used(rig: sk.CameraRig, *, undistort: bool) -> sk.CameraRig:
    """Return the cameras with which detections are compared: with ideal lenses if distortion is ignored."""
    return rig if undistort else sk.CameraRig([without_distortion(camera) for camera in rig], unit=rig.unit)


def default_threads(config: sk.RefineConfig) -> int:
    """Return the number of threads that a batch uses."""
    return int(config.n_threads or os.cpu_count() or 1)

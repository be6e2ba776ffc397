"""From inputs to refined poses, and the plain triangulation that they are compared with."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat.cameras import without_distortion
from skelsplat.run.job import Job
from skelsplat.run.read import Inputs

Progress = Callable[[int, int], None]

PLAIN_START, GIVEN_START = "plain triangulation", "initial pose"


@dataclass(frozen=True)
class Outcome:
    """A refined sequence and what it is compared with."""

    # what `skelsplat.refine` returned, and its settings
    result: sk.Refinement
    config: sk.RefineConfig
    # (T, N, 3) the initial pose if the user gave one, otherwise the plain triangulation (DLT) of the
    # detections. The default method begins with a robust triangulation, which would hide what
    # robustness changes.
    start: Array
    start_name: str = PLAIN_START  # what ``start`` is, in words
    seconds: float = float("nan")  # wall time of `skelsplat.refine` alone; NaN if unknown

    @classmethod
    def of(
        cls, result: sk.Refinement, config: sk.RefineConfig, inputs: Inputs, seconds: float = float("nan")
    ) -> Outcome:
        """Return a result with what it is compared with."""
        if inputs.init_pose is None:
            return cls(result, config, _plain(inputs, config), seconds=seconds)
        return cls(result, config, np.asarray(result.init_pose), GIVEN_START, seconds)


def refine_inputs(inputs: Inputs, job: Job, progress: Progress | None = None) -> Outcome:
    """Refine all frames; ``progress`` is called with (frames done, frames in all)."""
    sigma_mm, config = job.init_sigma_mm, job.settings
    if progress is not None:
        progress(0, len(inputs.frames))
    begin = time.perf_counter()
    result = sk.refine(
        inputs.init_pose,
        inputs.detections,
        inputs.rig,
        layout=inputs.layout,
        init_sigma=None if sigma_mm is None else sigma_mm / inputs.rig.mm_per_unit,
        config=config,
        progress=progress if progress is not None else False,
    )
    return Outcome.of(result, config, inputs, time.perf_counter() - begin)


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

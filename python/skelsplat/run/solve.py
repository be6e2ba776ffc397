"""From inputs to refined poses, over time or frame by frame, and the plain triangulation beside them."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

import skelsplat as sk
from skelsplat._arrays import Array, Index
from skelsplat._sequence import frames_of
from skelsplat.cameras import without_distortion
from skelsplat.io import PoseData
from skelsplat.run.job import Job
from skelsplat.run.read import Inputs

Progress = Callable[[int, int], None]

PLAIN_START, GIVEN_START = "plain triangulation", "initial pose"
# Why a recording was solved frame by frame (`Outcome.alone`), in a sentence if that is worth one.
ALONE = {
    "paper": "Solved frame by frame, as always with the method paper.",
    "asked": "Solved frame by frame, as asked.",
    "one frame": "",
    "prior": "Solved frame by frame: a prior of the start (init_sigma_mm) is for single frames.",
    "no rate": "Solved frame by frame, as the frame rate (fps) is unknown.",
    "sparse": "Solved frame by frame: most frames are missing.",
}
# A longer gap between frames says no more than one of so many seconds: nothing is bridged over it.
_APART_S = 2.0
# Of frame numbers that leave out more than this multiple of those that are there, most are far apart.
_MOST_EMPTY = 8


@dataclass(frozen=True)
class Outcome:
    """A refined sequence and what it is compared with."""

    result: sk.Refinement  # of `skelsplat.refine_sequence` or `skelsplat.refine`
    config: sk.RefineConfig
    # (T, N, 3) the initial pose if the user gave one, otherwise the plain triangulation (DLT) of the
    # detections. The default method begins with a robust triangulation, which would hide what
    # robustness changes.
    start: Array
    start_name: str = PLAIN_START  # what ``start`` is, in words
    seconds: float = float("nan")  # wall time of the refinement alone; NaN if unknown
    alone: str = ""  # why it was solved frame by frame, of `ALONE`; "" if solved over time or unknown

    @classmethod
    def of(cls, result: sk.Refinement, config: sk.RefineConfig, inputs: Inputs) -> Outcome:
        """Return a result with what it is compared with."""
        if inputs.init_pose is None:
            return cls(result, config, _plain(inputs, config))
        start = np.asarray(result.init_pose)
        if isinstance(result, sk.SequenceRefinement):
            start = np.where(np.isfinite(inputs.init_pose), inputs.init_pose, start)
        return cls(result, config, start, GIVEN_START)

    @property
    def sequence(self) -> sk.SequenceRefinement | None:
        """The result, if it was solved over time."""
        return self.result if isinstance(self.result, sk.SequenceRefinement) else None

    def bones_mm(self, inputs: Inputs) -> list[tuple[int, int, float, float]]:
        """Return the bones of a solution over time: their joints, length and standard error in mm."""
        found, mm = self.sequence, inputs.rig.mm_per_unit
        if found is None:
            return []
        sizes = zip(found.bones.tolist(), found.bone_lengths * mm, found.bone_length_sigma * mm, strict=True)
        return [(a, b, float(length), float(sigma)) for (a, b), length, sigma in sizes]


def silent(done: int, total: int) -> None:
    """Report no progress."""


def part_of(progress: Progress, before: int, parts: int) -> Progress:
    """Return the progress of one of some parts, each of all frames or steps, after so many."""
    return lambda done, total: progress((before * total + done) // parts, total)


def refine_inputs(inputs: Inputs, job: Job, progress: Progress = silent) -> Outcome:
    """Refine all frames, over time if that is possible and not refused."""
    config, alone, begin = job.settings, why_alone(inputs, job), time.perf_counter()
    progress(0, len(inputs.frames))
    if not alone and inputs.solved is not None and inputs.init_pose is None:
        return replace(Outcome.of(inputs.solved, config, inputs), seconds=inputs.solved_s)
    if not alone:
        result: sk.Refinement = _in_time(inputs, config, progress)
    else:
        sigma_mm = job.init_sigma_mm
        result = sk.refine(
            inputs.init_pose,
            inputs.detections,
            inputs.rig,
            layout=inputs.layout,
            init_sigma=None if sigma_mm is None else sigma_mm / inputs.rig.mm_per_unit,
            config=config,
            progress=progress,
        )
    return replace(Outcome.of(result, config, inputs), seconds=time.perf_counter() - begin, alone=alone)


def why_alone(inputs: Inputs, job: Job) -> str:
    """Return why the frames have to be solved one by one, of `ALONE`; "" if they are solved over time."""
    reasons = {
        "paper": job.settings.method == "paper",
        "asked": job.frame_by_frame,
        "one frame": len(inputs.frames) < 2,
        "prior": job.init_sigma_mm is not None,
        "no rate": inputs.fps is None,
    }
    found = next((reason for reason, holds in reasons.items() if holds), "")
    return found or ("sparse" if is_sparse(inputs) else "")


def is_sparse(inputs: Inputs) -> bool:
    """Whether most frames between the first and the last are missing."""
    return bool(even_clock(inputs)[0][-1] >= _MOST_EMPTY * len(inputs.frames))


def poses_of(inputs: Inputs, result: sk.Refinement) -> PoseData:
    """Return the poses of a result, with their names."""
    return PoseData.from_refinement(
        result,
        joint_names=inputs.layout.joints,
        frames=inputs.frames,
        camera_names=inputs.rig.names,
        unit=inputs.rig.unit,
        frame_rate=inputs.fps,
    )


def even_clock(inputs: Inputs) -> tuple[Index, float]:
    """Return the frames' places on an even clock, from 0, and its rate in Hz, that of those given."""
    if inputs.fps is None:
        raise TypeError("the frame rate is needed")
    gaps = np.diff(inputs.frames)
    step = step_of(inputs.frames)
    rate = inputs.fps / step
    most = max(1, int(np.ceil(_APART_S * rate)))
    return np.concatenate([[0], np.cumsum(np.minimum(gaps // step, most))]), rate


def _in_time(inputs: Inputs, config: sk.RefineConfig, progress: Progress) -> sk.SequenceRefinement:
    """Refine the frames together; those missing between them are solved as well, and left out again."""
    places, rate = even_clock(inputs)
    steps = len(places)
    result = sk.refine_sequence(
        spread(inputs.detections, places),
        inputs.rig,
        fps=rate,
        layout=inputs.layout,
        init_pose=None if inputs.init_pose is None else spread(inputs.init_pose, places),
        config=config,
        progress=lambda done, total: progress(done * steps // total, steps),
    )
    return frames_of(result, places)


def step_of(frames: Index) -> int:
    """Return what frame numbers go up by."""
    return int(np.gcd.reduce(frames - frames[0])) or 1


def evened(values: Array, frames: Index) -> tuple[Array, Index]:
    """Return the values (T, …) of frames at even times, NaN in between, and all frames.

    As they are if most would be empty.
    """
    step = step_of(frames)
    places = (frames - frames[0]) // step
    if places[-1] >= _MOST_EMPTY * len(places):
        return values, frames
    return spread(values, places), np.arange(frames[0], frames[-1] + 1, step)


def spread(values: Array, places: Index) -> Array:
    """Return the values (T, …) of frames at these places of an even clock, NaN in between."""
    whole = np.full((int(places[-1]) + 1, *values.shape[1:]), np.nan)
    whole[places] = values
    return whole


def frame_by_frame(inputs: Inputs, outcome: Outcome) -> Outcome:
    """Return the same frames solved one by one, from which cameras and people are judged.

    Over time, an offset turns into rejected detections, and limbs keep their length in any case.
    """
    if outcome.sequence is None:
        return outcome
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # those of the result were given already
        given = inputs.init_pose, inputs.detections, inputs.rig
        result = sk.refine(*given, layout=inputs.layout, config=outcome.config)
    return Outcome(result, outcome.config, outcome.start, outcome.start_name)


def _plain(inputs: Inputs, config: sk.RefineConfig) -> Array:
    """Triangulate the detections that count, by DLT, (T, N, 3)."""
    counts = inputs.detections[..., 2:] >= config.min_confidence
    rig = rig_as_used(inputs.rig, undistort=config.undistort)
    return sk.triangulate(np.where(counts, inputs.detections, np.nan), rig, method="dlt")


def rig_as_used(rig: sk.CameraRig, *, undistort: bool) -> sk.CameraRig:
    """Return the cameras with which detections are compared: with ideal lenses if distortion is ignored."""
    return rig if undistort else rig.of([without_distortion(camera) for camera in rig])


def default_threads(config: sk.RefineConfig) -> int:
    """Return the number of threads that a batch uses."""
    return int(config.n_threads or os.cpu_count() or 1)

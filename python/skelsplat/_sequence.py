"""``refine_sequence``: the frames of a recording in one solve. All computation is in the compiled core."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat import _skelsplat
from skelsplat._arrays import Index, positive
from skelsplat._refine import Cameras, Progress, Refinement, refinement_fields, reporter, warn_of_size
from skelsplat._skelsplat import Layout, RefineConfig

# Fields that all frames share.
OF_BONES = ("bones", "bone_lengths", "bone_length_sigma")

_Kind = TypeVar("_Kind", bound=Refinement)


@dataclass(frozen=True, slots=True)
class SequenceRefinement(Refinement):
    """What ``refine_sequence`` returns: a `Refinement` of T frames, and what they show together.

    ``init_pose`` is the pose of each frame alone, ``noise`` that of the whole recording, and ``joint_status``
    ``"inferred"`` for a joint that its bones and the frames around it determine.

    Attributes
    ----------
    velocity : (T, N, 3) float64
        Units of the cameras per second; NaN where a neighbouring frame is missing.
    velocity_uncertainty : (T, N, 3, 3) float64
        Its posterior covariance.
    bones : (B, 2) int64
        Joints at both ends of every limb of the layout.
    bone_lengths, bone_length_sigma : (B,) float64
        Their lengths, one for the whole recording, and standard errors; NaN and infinite for a bone that is
        never seen.
    """

    velocity: NDArray[np.float64]
    velocity_uncertainty: NDArray[np.float64]
    bones: NDArray[np.int64]
    bone_lengths: NDArray[np.float64]
    bone_length_sigma: NDArray[np.float64]


def refine_sequence(
    detections: ArrayLike,
    cameras: Cameras,
    *,
    fps: float,
    layout: str | Layout | None = None,
    init_pose: ArrayLike | None = None,
    confidence: ArrayLike | None = None,
    config: RefineConfig | None = None,
    progress: bool | Progress = False,
) -> SequenceRefinement:
    """Refine the frames of one motion together: bones keep their length, joints move smoothly.

    Lengths of the layout's limbs, speeds and the detector's errors are learnt from the recording. Gaps of up
    to a second are bridged. Where all of at least three views agree on a joint, the other frames never
    outvote them. docs/method.md has the mathematics.

    Parameters
    ----------
    detections : (T, M, N, 2|3)
        As in ``refine``: the frames of one motion in order, at a constant rate. A frame without detections is
        NaN, not left out.
    cameras, layout, init_pose, confidence, config, progress
        As in ``refine``; ``annealed`` only. Without a layout, or with one that has no limbs, there are no
        bones.
    fps : float
        Frames per second.

    Raises
    ------
    InvalidInputError
        As ``refine``, and if ``fps`` is not a positive number, ``detections`` is a single frame or the method
        is ``paper``. Warnings are those of ``refine``.
    """
    positive("fps", fps)
    prepared = _skelsplat.Refiner(cameras, layout=layout, config=config)
    with reporter(progress) as report:
        given = (init_pose, detections, float(fps))
        out = prepared.refine_sequence(*given, confidence=confidence, progress=report)
    warn_of_size(out["pose"], cameras, layout)
    return SequenceRefinement(**refinement_fields(out))


def frames_of(result: _Kind, frames: Index | slice) -> _Kind:
    """Return some frames of a result."""
    names = {entry.name for entry in fields(result)} - {*OF_BONES}
    return replace(result, **{name: getattr(result, name)[frames] for name in names})


def joined(results: Sequence[_Kind]) -> _Kind:
    """Return the frames of all results of one recording, in time with the bones of the last."""
    names = {entry.name for entry in fields(results[0])} - {*OF_BONES}
    parts = {name: np.concatenate([getattr(result, name) for result in results]) for name in names}
    return replace(results[-1], **parts)

"""``refine_sequence``: the frames of a recording in one solve. All computation is in the compiled core."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from skelsplat import _skelsplat
from skelsplat._arrays import Index, positive
from skelsplat._refine import Cameras, Judge, Progress, Refinement, refinement_fields, reporter
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
    bone_lengths : (B,) float64
        Their lengths, one for the whole recording; NaN for a bone that is never seen.
    bone_length_sigma : (B,) float64
        Standard errors of the lengths; infinite for a bone that is never seen.
    """

    velocity: NDArray[np.float64]
    velocity_uncertainty: NDArray[np.float64]
    bones: NDArray[np.int64]
    bone_lengths: NDArray[np.float64]
    bone_length_sigma: NDArray[np.float64]

    def __repr__(self) -> str:
        # A slots dataclass has no zero-argument super().
        frames = Refinement.__repr__(self).removeprefix("Refinement(")
        return f"SequenceRefinement({len(self.bones)} bones, {frames}"


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

    One robust solve has the terms of ``refine``, the length of every limb of the layout, and the acceleration
    of every joint; lengths, speeds and the detector's errors are learnt from the recording. Gaps of up to a
    second are bridged. Where all of at least three views agree on a joint, the other frames never outvote
    them. docs/method.md has the mathematics.

    Parameters
    ----------
    detections : (T, M, N, 2|3)
        As in ``refine``: the frames of one motion in order, at a constant rate. A frame without detections is
        NaN, not left out.
    cameras, layout, confidence, config, progress
        As in ``refine``; ``annealed`` only. Without a layout, or with one that has no limbs, there are no
        bones.
    fps : float
        Frames per second.
    init_pose : (T, N, 3), optional
        As in ``refine``: it places joints that fewer than two views see.

    Returns
    -------
    SequenceRefinement

    Raises
    ------
    InvalidInputError
        As ``refine``, and if ``fps`` is not a positive number, ``detections`` is a single frame or the method
        is ``paper``.

    Warns
    -----
    UserWarning
        As ``refine``.
    """
    positive("fps", fps)
    prepared = _skelsplat.Refiner(cameras, layout=layout, config=config)
    with reporter(progress) as report:
        out: dict[str, Any] = prepared.refine_sequence(
            init_pose, detections, float(fps), confidence=confidence, progress=report
        )
    Judge(cameras, layout).unit(out["pose"])
    return SequenceRefinement(**refinement_fields(out))


def frames_of(result: _Kind, frames: Index | slice) -> _Kind:
    """Return some frames of a result."""
    parts = {entry.name: getattr(result, entry.name) for entry in fields(result)}
    return type(result)(
        **{name: value if name in OF_BONES else value[frames] for name, value in parts.items()}
    )


def joined(results: Sequence[_Kind]) -> _Kind:
    """Return the frames of all results of one recording, in time with the bones of the last."""
    if len(results) == 1:
        return results[0]
    parts = {entry.name: [getattr(result, entry.name) for result in results] for entry in fields(results[0])}
    return type(results[0])(
        **{name: each[-1] if name in OF_BONES else np.concatenate(each) for name, each in parts.items()}
    )

"""Methods that solve a recording: a take in, poses and, where there are any, error bars out."""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from recordings import Take
from scenarios import FloatArray

import skelsplat as sk
from skelsplat.evaluation.methods import butterworth as filtered


@dataclass(frozen=True)
class Solved:
    """Poses (T, N, 3), and the covariance of their errors (T, N, 3, 3) where the method states one."""

    pose: FloatArray
    covariance: FloatArray | None = None


Method = Callable[[Take], Solved]


def _given(take: Take, **fields: object) -> dict[str, object]:
    """Return the arguments that all have in common."""
    return {"layout": take.scene.layout, "config": sk.RefineConfig(n_threads=1, **fields)}


def frames(take: Take, **fields: object) -> Solved:
    """`sk.refine`, every frame by itself."""
    result = sk.refine(None, take.scene.detections, take.scene.rig, **_given(take, **fields))
    return Solved(result.pose, result.uncertainty)


def sequence(take: Take) -> Solved:
    """`sk.refine_sequence`: bones and motion in the same solve."""
    result = sk.refine_sequence(take.scene.detections, take.scene.rig, fps=take.fps, **_given(take))
    return Solved(result.pose, result.uncertainty)


def refiner(take: Take, *, fps: bool = False, lag: int = 0) -> Solved:
    """`sk.Refiner`; with `fps` the past predicts, with a lag the frames after count as well."""
    detections = take.scene.detections
    live = sk.Refiner(take.scene.rig, fps=take.fps if fps else None, lag=lag, **_given(take))
    end = np.full((lag, *detections.shape[1:]), np.nan)
    results = [live.step(frame) for frame in np.concatenate([detections, end])][lag:]
    return Solved(np.array([r.pose for r in results]), np.array([r.uncertainty for r in results]))


def butterworth(take: Take) -> Solved:
    """Frame by frame, gaps filled linearly, then a zero-lag Butterworth filter of 6 Hz."""
    return Solved(filtered(frames(take).pose, take.fps))


def anipose(take: Take, *, ransac: bool = False, **tuned: float) -> Solved:
    """Aniposelib's `CameraGroup.triangulate_optim`: constant bones, smooth motion, confidences as scores.

    All bones of the layout are constrained; all else is at its defaults but for what is `tuned`.
    """
    import cv2
    from aniposelib.cameras import Camera, CameraGroup

    scene = take.scene
    group = CameraGroup(
        [Camera(matrix=c.K, rvec=cv2.Rodrigues(c.R)[0].ravel(), tvec=c.t, size=c.size) for c in scene.rig]
    )
    points = np.ascontiguousarray(np.moveaxis(scene.detections, 1, 0))
    limbs = [list(limb) for limb in sk.layouts.get(scene.layout).limbs]
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of Numba, about what it cannot compile
        pose = group.triangulate_optim(
            points[..., :2].copy(),
            init_ransac=ransac,
            constraints=limbs,
            scores=points[..., 2].copy(),
            **tuned,
        )
    return Solved(np.asarray(pose))


# The best on these recordings of 1, 2, 3 and of 2, 5, 15 px, from DLT.
_TUNED = {"n_deriv_smooth": 2, "reproj_error_threshold": 5}

METHODS: dict[str, Method] = {
    "free": partial(frames, bones="free"),
    "frames": frames,
    "refiner": refiner,
    "live": partial(refiner, fps=True),
    "lag5": partial(refiner, fps=True, lag=5),
    "lag15": partial(refiner, fps=True, lag=15),
    "butterworth": butterworth,
    "anipose": anipose,
    "anipose-tuned": partial(anipose, **_TUNED),
    "anipose-ransac": partial(anipose, ransac=True, **_TUNED),
    "sequence": sequence,
}

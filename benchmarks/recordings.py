"""Recordings, of CMU motions in a room with detections simulated with memory, and methods that solve them.

The motions are the CMU takes at 30 frames per second without the damaged frames (without the data: the
package's synthetic motions); 15 and 10 frames per second are every second and third of them. All is
determined by the seed.
"""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from scenarios import CMU_30HZ, FloatArray, Scene, cmu_takes, rig

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.evaluation.methods import butterworth as filtered
from skelsplat.synthetic import DetectionNoise

CAPTURE_HZ = 30
CONDITIONS = ("good", "occluded 2", "occluded 3", "heavy")
# Acceleration of a joint, m/s², that none of the undamaged takes reaches (246).
_LARGEST_ACCELERATION = 250.0
# Takes in which the whole body moves back and forth within tenths of a second while it walks and runs.
_DAMAGED = ("07_12", "09_10")
# Shorter takes are left out.
_FEWEST_FRAMES = 25
# Headings that are tried until the person stays in view.
_HEADINGS = 24


@dataclass(frozen=True)
class Take:
    """A recording under one condition: consecutive frames of a scene."""

    name: str
    scene: Scene
    fps: float


def unsure(scene: Scene) -> Scene:
    """Return the scene with confidence 1 for everything that is detected."""
    detections = scene.detections.copy()
    detections[..., 2] = np.where(scene.detected, 1.0, 0.0)
    return replace(scene, detections=detections)


def noise(condition: str, n_views: int, fps: float) -> DetectionNoise:
    """Return the detector of a condition; of fewer views than it occludes, it occludes all but one."""
    usual = DetectionNoise.recording(frame_rate=fps)
    if condition == "good":
        return usual
    hidden = min(2 if condition == "occluded 2" else 3, n_views - 1)
    return DetectionNoise.recording_occluded(hidden, heavy=condition == "heavy", frame_rate=fps)


@cache
def motions() -> dict[str, FloatArray]:
    """Return all motions (F, 17, 3) mm at 30 Hz by name, of the capture their longest parts `unbroken`."""
    if CMU_30HZ.is_file():
        captured = cmu_takes(CMU_30HZ)
        parts = {name: unbroken(take) for name, take in captured.items() if name not in _DAMAGED}
        return {name: part for name, part in parts.items() if len(part) >= _FEWEST_FRAMES}
    names = synthetic.motion_names
    return {name: synthetic.motion(name, 300, fps=CAPTURE_HZ, seed=k) for k, name in enumerate(names)}


def unbroken(take: FloatArray) -> FloatArray:
    """Return the longest part of a captured take (F, 17, 3) mm that a person can have moved.

    The first frame is a calibration pose, from which the person jumps; in some dances a leg or an arm flips
    for a frame or two where a joint angle of the capture is singular, at 300 to 2000 m/s².
    """
    second = np.linalg.norm(np.diff(take, n=2, axis=0), axis=-1).max(axis=1) * CAPTURE_HZ**2 / 1000.0
    broken = np.flatnonzero(second > _LARGEST_ACCELERATION)
    bad = np.unique(np.concatenate([[-1, 0, len(take)], *(broken + k for k in range(3))])).astype(int)
    longest = int(np.diff(bad).argmax())
    return take[bad[longest] + 1 : bad[longest + 1]]


def sample(names: Sequence[str], count: int | None, seed: int) -> list[str]:
    """Return all names, or one drawn from each of `count` equal parts of the list."""
    if count is None or count >= len(names):
        return list(names)
    rng = np.random.default_rng(seed)
    return [str(rng.choice(part)) for part in np.array_split(np.array(names), count)]


def placed(poses: FloatArray, cameras: sk.CameraRig, seed: int) -> FloatArray:
    """Return the motion (F, 17, 3) in the middle of the room, with a random heading that stays in view.

    Of some headings it is the one with the largest share of joints in the images; the floor stays the floor.
    """
    path = poses[:, 0, :2]
    centred = poses - np.append((path.min(axis=0) + path.max(axis=0)) / 2, 0.0)
    sizes = np.array([camera.size for camera in cameras])

    def turned(angle: float) -> FloatArray:
        cos, sin = np.cos(angle), np.sin(angle)
        return centred @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])

    def seen(angle: float) -> float:
        pixels = np.moveaxis(sk.project(turned(angle)[:: CAPTURE_HZ // 3], cameras), 0, 2)
        return float(((pixels >= 0) & (pixels <= sizes - 1)).all(axis=-1).mean())

    angles = np.random.default_rng(seed).uniform(0.0, 2 * np.pi, size=_HEADINGS)
    return turned(max(angles, key=seen))


def takes(
    condition: str,
    *,
    count: int | None = None,
    names: Sequence[str] | None = None,
    n_views: int = 4,
    fps: int = CAPTURE_HZ,
    seed: int = 0,
    most_frames: int | None = None,
    confidence: bool = True,
) -> list[Take]:
    """Simulate takes of a condition: those of these names, or a `sample`.

    Of long ones the middle `most_frames` frames. A take has the same heading and detections in every sample.
    """
    cameras = rig(n_views)
    detector = noise(condition, n_views, fps)
    out = []
    everything = motions()
    every = list(everything)
    for name in sample(every, count, seed) if names is None else names:
        own = seed + every.index(name)
        poses = placed(everything[name][:: CAPTURE_HZ // fps], cameras, own)
        if most_frames is not None and len(poses) > most_frames:
            first = (len(poses) - most_frames) // 2
            poses = poses[first : first + most_frames]
        detections = synthetic.simulate_detections(poses, cameras, noise=detector, layout="h36m17", seed=own)
        scene = Scene(poses, detections, cameras, "h36m17", "CMU motion capture, simulated detections")
        out.append(Take(name, scene if confidence else unsure(scene), float(fps)))
    return out


@dataclass(frozen=True)
class Solved:
    """Poses (T, N, 3), and the covariance of their errors (T, N, 3, 3) where the method states one."""

    pose: FloatArray
    covariance: FloatArray | None = None


Method = Callable[[Take], Solved]


def _given(take: Take) -> dict[str, object]:
    """Return the arguments that all have in common."""
    return {"layout": take.scene.layout, "config": sk.RefineConfig(n_threads=1)}


def frames(take: Take) -> Solved:
    """`sk.refine`, every frame by itself."""
    result = sk.refine(None, take.scene.detections, take.scene.rig, **_given(take))
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


def anipose(take: Take, **tuned: float) -> Solved:
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
            constraints=limbs,
            scores=points[..., 2].copy(),
            **tuned,
        )
    return Solved(np.asarray(pose))


# The best on these recordings of 1, 2, 3 and of 2, 5, 15 px, from DLT.
_TUNED = {"n_deriv_smooth": 2, "reproj_error_threshold": 5}

METHODS: dict[str, Method] = {
    "frames": frames,
    "refiner": refiner,
    "live": partial(refiner, fps=True),
    "lag5": partial(refiner, fps=True, lag=5),
    "lag15": partial(refiner, fps=True, lag=15),
    "butterworth": butterworth,
    "anipose": anipose,
    "anipose-tuned": partial(anipose, **_TUNED),
    "sequence": sequence,
}

"""Recordings for measuring methods that use time: CMU motions in a room, detections simulated with memory.

The motions are the CMU takes at 30 frames per second without the damaged frames (without the data: the
package's synthetic motions); 15 and 10 frames per second are every second and third of them. All is
determined by the seed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scenarios import CMU_30HZ, FloatArray, Scene, cmu_takes, rig

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.synthetic import DetectionNoise

CAPTURE_HZ = 30
CONDITIONS = ("good", "occluded 2", "occluded 3", "heavy", "swaps")
# Acceleration of a joint, m/s², that none of the undamaged takes reaches (246).
_LARGEST_ACCELERATION = 250.0
# Takes in which the whole body moves back and forth within tenths of a second while it walks and runs.
_DAMAGED = ("07_12", "09_10")
# Shorter takes are left out.
_FEWEST_FRAMES = 25
# Headings that are tried until the person stays in view.
_HEADINGS = 24
# Share of the frames of `swaps` in which a limb, and everything in a view, is exchanged.
_LIMB_SWAPS, _VIEW_SWAPS = 0.05, 0.02


@dataclass(frozen=True)
class Take:
    """A recording under one condition: consecutive frames of a scene."""

    name: str
    scene: Scene
    fps: float


def unsure(take: Take) -> Take:
    """Return the take with confidence 1 for everything that is detected."""
    detections = take.scene.detections.copy()
    detections[..., 2] = np.where(take.scene.detected, 1.0, 0.0)
    return replace(take, scene=replace(take.scene, detections=detections))


def noise(condition: str, n_views: int, fps: float) -> DetectionNoise:
    """Return the detector of a condition; of fewer views than it occludes, it occludes all but one."""
    usual = DetectionNoise.recording(frame_rate=fps)
    if condition == "good":
        return usual
    if condition == "swaps":
        return replace(usual, limb_swap_rate=_LIMB_SWAPS, view_swap_rate=_VIEW_SWAPS)
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
        out.append(Take(name, scene, float(fps)))
    return out

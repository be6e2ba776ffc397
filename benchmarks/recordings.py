"""Recordings for measuring methods that use time: CMU motions in a room, detections simulated with memory.

The motions are the CMU takes at 30 frames per second (without the data: the package's synthetic motions); 15
and 10 frames per second are every second and third of them. All is determined by the seed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scenarios import CMU_30HZ, FloatArray, Scene, cmu_takes, rig

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.synthetic import DetectionNoise

CAPTURE_HZ = 30
CONDITIONS = ("good", "occluded 2", "occluded 3", "heavy", "swaps")
# Headings that are tried until the person stays in view.
_HEADINGS = 24
# Share of the frames of `swaps` in which a limb, and everything in a view, is exchanged.
_LIMB_SWAPS, _VIEW_SWAPS = 0.05, 0.02


@dataclass(frozen=True)
class Take:
    """A recording of one condition: a scene whose frames follow each other."""

    name: str
    scene: Scene
    fps: float


def noise(condition: str, n_views: int, fps: float) -> DetectionNoise:
    """Return the detector of a condition; of fewer views than it occludes, it occludes all but one."""
    usual = DetectionNoise.recording(frame_rate=fps)
    if condition == "good":
        return usual
    if condition == "swaps":
        return replace(usual, limb_swap_rate=_LIMB_SWAPS, view_swap_rate=_VIEW_SWAPS)
    hidden = min(2 if condition == "occluded 2" else 3, n_views - 1)
    return DetectionNoise.recording_occluded(hidden, heavy=condition == "heavy", frame_rate=fps)


def motions(count: int | None, seed: int) -> dict[str, FloatArray]:
    """Return motions (F, 17, 3) mm at 30 Hz by name: all, or one drawn from each of `count` equal parts."""
    if CMU_30HZ.is_file():
        takes = cmu_takes(CMU_30HZ)
    else:
        names = synthetic.motion_names
        takes = {name: synthetic.motion(name, 300, fps=CAPTURE_HZ, seed=k) for k, name in enumerate(names)}
    if count is None or count >= len(takes):
        return takes
    rng = np.random.default_rng(seed)
    parts = np.array_split(np.array(list(takes)), count)
    return {name: takes[name] for name in (str(rng.choice(part)) for part in parts)}


def placed(poses: FloatArray, cameras: sk.CameraRig, seed: int) -> FloatArray:
    """Return the motion (F, 17, 3) in the middle of the room, with a random heading that stays in view.

    Of some headings it is the one with the largest share of joints in the images; the floor stays the floor.
    """
    rng = np.random.default_rng(seed)
    path = poses[:, 0, :2]
    centred = poses - np.append((path.min(axis=0) + path.max(axis=0)) / 2, 0.0)

    def turned(angle: float) -> FloatArray:
        cos, sin = np.cos(angle), np.sin(angle)
        out: FloatArray = centred @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return out

    def seen(angle: float) -> float:
        some = turned(angle)[:: CAPTURE_HZ // 3]
        pixels = np.moveaxis(sk.project(some, cameras), 0, 2)
        sizes = np.array([camera.size for camera in cameras])
        return float(((pixels >= 0) & (pixels <= sizes - 1)).all(axis=-1).mean())

    return turned(max(rng.uniform(0.0, 2 * np.pi, size=_HEADINGS), key=seen))


def takes(
    condition: str,
    *,
    count: int | None = None,
    n_views: int = 4,
    fps: int = CAPTURE_HZ,
    seed: int = 0,
    most_frames: int | None = None,
) -> list[Take]:
    """Simulate the takes of a condition; of long ones the middle `most_frames` frames."""
    cameras = rig("room", n_views)
    detector = noise(condition, n_views, fps)
    out = []
    for k, (name, motion) in enumerate(motions(count, seed).items()):
        poses = placed(motion[:: CAPTURE_HZ // fps], cameras, seed + k)
        if most_frames is not None and len(poses) > most_frames:
            first = (len(poses) - most_frames) // 2
            poses = poses[first : first + most_frames]
        detections = synthetic.simulate_detections(
            poses, cameras, noise=detector, layout="h36m17", seed=seed + k
        )
        scene = Scene(poses, detections, cameras, "h36m17", "CMU motion capture, simulated detections")
        out.append(Take(name, scene, float(fps)))
    return out

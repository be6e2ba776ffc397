"""What the writers put into their data sets: simulated people, seen exactly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import skelsplat as sk
from skelsplat import synthetic

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Person:
    """Truth (T, N, 3) mm, its cameras, and detections (T, M, N, 3) half a pixel off."""

    layout: sk.Layout
    rig: sk.CameraRig
    truth: FloatArray
    detections: FloatArray


def person(
    layout: sk.Layout,
    rig: sk.CameraRig,
    n_frames: int,
    *,
    motion: str = "walk",
    seed: int = 0,
    at: tuple[float, float] = (0.0, 0.0),
) -> Person:
    """Simulate somebody round a place, mm, who is in all images."""
    body = synthetic.motion(motion, n_frames, fps=4.0, seed=seed)
    body[..., :2] -= body[:, :1, :2].mean(axis=0) - at
    truth = synthetic.in_layout(body, layout)
    noise = synthetic.DetectionNoise(sigma_px=0.5)
    detections = synthetic.simulate_detections(truth, rig, noise=noise, layout=layout, seed=seed)
    assert np.isfinite(detections).all()
    return Person(layout, rig, truth, detections)


def at_centre(camera: sk.Camera) -> dict[str, object]:
    """Return the table R, T, fx, fy, cx, cy, k, p of AdaFuse and VoxelPose, with x_cam = R (X − T)."""
    k1, k2, p1, p2, k3 = [0.0] * 5 if camera.distortion is None else camera.distortion.tolist()
    return {
        "R": camera.R.tolist(),
        "T": camera.centre.reshape(3, 1).tolist(),
        "fx": camera.K[0, 0],
        "fy": camera.K[1, 1],
        "cx": camera.K[0, 2],
        "cy": camera.K[1, 2],
        "k": [[k1], [k2], [k3]],
        "p": [[p1], [p2]],
    }

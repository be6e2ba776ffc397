"""Takes and data sets made by hand or from `skelsplat.synthetic`, for the tests of the evaluation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import skelsplat as sk
from skelsplat.datasets import Dataset, Take


def hand_made(
    key: str = "S9/Directions 1",
    *,
    frames: Sequence[int] = (0,),
    rig: sk.CameraRig | None = None,
    n_joints: int = 17,
    action: str | None = None,
) -> Take:
    """Return a take whose truth is arbitrary and that has no detections."""
    subject, _, name = key.partition("/")
    return Take(
        key,
        subject,
        name.rstrip(" 0123456789") if action is None else action,
        sk.synthetic.human36m_like() if rig is None else rig,
        np.asarray(frames, dtype=np.int64),
        np.random.default_rng(0).normal(0, 500, (len(frames), n_joints, 3)),
    )


def simulated(
    n_frames: int = 6, keys: Sequence[str] = ("S9/Directions 1", "S11/Walking"), *, distortion: bool = True
) -> Dataset:
    """Return a Human3.6M-like data set with detections, boxes and monocular poses; every 64th frame."""
    rig = sk.synthetic.human36m_like(distortion=distortion)
    takes = []
    for k, key in enumerate(keys):
        truth = sk.synthetic.motion("walk", n_frames, seed=k)
        noise = sk.synthetic.DetectionNoise.good()
        blank = hand_made(key, frames=range(0, 64 * n_frames, 64), rig=rig)
        takes.append(
            Take(
                key,
                blank.subject,
                blank.action,
                rig,
                blank.frames,
                truth,
                sk.synthetic.simulate_detections(truth, rig, noise=noise, seed=10 + k),
                sk.synthetic.monocular_poses(truth, rig, 60.0, seed=20 + k),
                np.tile([100.0, 100.0, 484.0, 868.0], (n_frames, 4, 1)),
            )
        )
    source = "simulated for tests; no image was seen"
    return Dataset("human36m-like", sk.layouts.H36M17, tuple(takes), "simulated-good", source)


def recording(n_frames: int = 40, gap: tuple[int, int] = (25, 28), *, fps: float | None = 25.0) -> Dataset:
    """Return a Human3.6M-like take at 25 Hz of consecutive frames but for those numbered gap[0] to gap[1]."""
    rig = sk.synthetic.human36m_like()
    truth = sk.synthetic.motion("walk", n_frames, fps=25.0, seed=3)
    seen = sk.synthetic.simulate_detections(truth, rig, noise=sk.synthetic.DetectionNoise.good(), seed=4)
    take = Take("S9/Walking", "S9", "Walking", rig, np.arange(n_frames), truth, seen, fps=fps)
    keep = (take.frames < gap[0]) | (take.frames > gap[1])
    source = "simulated for tests; no image was seen"
    return Dataset("human36m-like", sk.layouts.H36M17, (take.select(keep),), "simulated-good", source)

"""Attacks on what files mean: cameras by another convention than the format's."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.rig_check import check_rig

from . import attack

Lens = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64] | None, bool]]

_LENSES: dict[str, Lens] = {
    "right": lambda k: (k, False),
    "k3 before p1": lambda k: (k[[0, 1, 4, 2, 3]], False),
    "none": lambda _: (None, False),
    "other sign": lambda k: (-k, False),
    "fisheye": lambda k: (k[:4], True),
}


@attack("18a", "lenses wrong in all cameras alike: mean error, findings of check_rig", "found")
def lenses_wrong() -> str:
    rig = synthetic.human36m_like(distortion=True)
    truth = synthetic.motion("walk", 24, seed=1)
    found = synthetic.simulate_detections(truth, rig, noise=synthetic.DetectionNoise.good(), seed=3)
    results = []
    for name, change in _LENSES.items():
        cameras = [_with_lens(camera, change) for camera in rig]
        pose = sk.refine(None, found, cameras, layout="h36m17").pose
        error = float(np.nanmean(np.linalg.norm(pose - truth, axis=-1)))
        findings = check_rig(sk.CameraRig(cameras), found, layout="h36m17").findings
        results.append(f"{name} {error:.0f} mm, {len(findings)}")
    return "; ".join(results)


def _with_lens(camera: sk.Camera, change: Lens) -> sk.Camera:
    lens, fisheye = change(np.asarray(camera.distortion))
    return sk.Camera(
        camera.K,
        camera.R,
        camera.t,
        size=camera.size,
        distortion=lens,
        fisheye=fisheye,
        name=camera.name,
    )

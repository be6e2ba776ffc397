"""Arrays in, pose out: cameras from numbers, detections from any detector, one frame at a time.

    python examples/own_arrays.py

Replace `detect` with your detector and the cameras with yours; everything else stays the same.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import skelsplat as sk
from skelsplat import synthetic

FRAMES = 20


def cameras() -> sk.CameraRig:
    """Four cameras; with your own calibration: ``sk.Camera(K, R, t, distortion=..., size=(w, h))``."""
    rig = synthetic.human36m_like(distortion=True)
    return sk.CameraRig(
        [sk.Camera(c.K, c.R, c.t, distortion=c.distortion, size=c.size, name=c.name) for c in rig], unit="mm"
    )


def detect(rig: sk.CameraRig) -> Iterator[np.ndarray]:
    """Yield detections (M, 17, 3) frame by frame: u, v, confidence; NaN where a joint is not detected."""
    walk = synthetic.motion("walk", FRAMES, seed=0)
    yield from synthetic.simulate_detections(walk, rig, noise=synthetic.DetectionNoise.noisy(), seed=0)


def main() -> None:
    rig = cameras()
    refiner = sk.Refiner(rig, layout="h36m17")
    wrist = sk.layouts.H36M17.joints.index("right_wrist")
    for frame, detections in enumerate(detect(rig)):
        result = refiner.step(detections)
        x, y, z = result.pose[wrist]
        error = np.nanmedian(result.reprojection_error)
        weak = np.count_nonzero(result.joint_status != "ok")
        print(
            f"frame {frame:2d}: right wrist {x:6.0f} {y:6.0f} {z:6.0f} mm, {error:.1f} px, {weak} weak joints"
        )


if __name__ == "__main__":
    main()

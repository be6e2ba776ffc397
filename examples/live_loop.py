"""A live loop of twenty lines: any detector, arrays in, pose out.

    python examples/live_loop.py

`sk.Refiner(fps=…)` predicts each frame from those before. Replace `camera_loop`, here a simulated walk, with
your cameras and detector. A program in another language pipes the same arrays as JSON lines through
`skelsplat live`.
"""

from __future__ import annotations

import time

import numpy as np

import skelsplat as sk
from skelsplat import synthetic

rig = synthetic.human36m_like()  # yours: skelsplat.io.read_calibration("Calib.toml", unit="m")
walk = synthetic.motion("walk", 60, fps=30, seed=0)
camera_loop = synthetic.simulate_detections(walk, rig, noise=synthetic.DetectionNoise.recording(), seed=0)

refiner = sk.Refiner(rig, layout="h36m17", fps=30, config=sk.RefineConfig(n_threads=1))
wrist = sk.layouts.H36M17.joints.index("right_wrist")
latency = []
# (M, N, 3): x, y in pixels, confidence in [0, 1] (RTMPose: np.clip it); NaN where a joint was not detected
for detections in camera_loop:
    begin = time.perf_counter()
    result = refiner.step(detections)
    latency.append(1e3 * (time.perf_counter() - begin))
    if result.joint_status[wrist] in ("ok", "inferred"):  # not "weak" (undetermined) and not "unobserved"
        x, y, z = result.pose[wrist]  # in the unit of the rig
        bar = np.sqrt(np.trace(result.error_bar[wrist]) / 3)
        print(f"right wrist {x:6.0f} {y:6.0f} {z:6.0f} ± {bar:.0f} {rig.unit}")
print(f"median latency {np.median(latency):.2f} ms")

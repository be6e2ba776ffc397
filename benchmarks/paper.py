"""Speed and memory of `paper`: 17 joints, 4 views, all 125 steps.

    python benchmarks/paper.py

Simulated detections in a Human3.6M-like room. Times are the median of repeated calls of ``skelsplat.refine``
from Python, everything included; memory is the increase of the peak resident size during one refinement,
measured in a fresh process.
"""

from __future__ import annotations

import statistics
import subprocess
import sys
from functools import partial

import lab
import numpy as np
from lab import Table
from speed import wanted

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.cameras import altered

REPEATS = 15
BATCH = 16


def scene(size: int, frames: int) -> tuple[sk.CameraRig, np.ndarray, np.ndarray]:
    """Return a rig of ``size`` × ``size`` px images (same focal length), starts and detections."""
    cameras = []
    for camera in synthetic.human36m_like():
        K = camera.K
        K[:2, 2] = (size - 1) / 2
        cameras.append(altered(camera, K=K, size=(size, size)))
    rig = sk.CameraRig(cameras)
    pose = synthetic.motion("walk", frames, seed=0)
    detections = sk.project(pose, rig).swapaxes(0, 1)
    detections = detections + np.random.default_rng(0).normal(0, 3.0, detections.shape)
    return rig, synthetic.perturb(pose, 20.0, seed=1), detections


def refined(size: int, frames: int, **fields: object) -> partial[sk.Refinement]:
    """Return the refinement of so many frames as a call, without early stopping unless it is given."""
    rig, start, detections = scene(size, frames)
    config = sk.RefineConfig.paper(**{"stop_tolerance": 0.0, "n_threads": 1, **fields})
    if frames == 1:
        start, detections = start[0], detections[0]
    return partial(sk.refine, start, detections, rig, layout="h36m17", config=config)


def median_ms(call: partial[sk.Refinement], per: int = 1) -> str:
    """Return the median time of a call over `REPEATS` runs, divided by ``per``."""
    call()
    return f"{statistics.median(lab.seconds(call, 1) for _ in range(REPEATS)) * 1e3 / per:.1f} ms"


def grown_mib() -> float:
    """Return the increase of the peak during one refinement, in MiB."""
    refined(1000, 2, max_steps=0)()
    before = lab.peak_mib()
    refined(1000, 1)()
    return lab.peak_mib() - before


def paper() -> Table:
    """Measure everything."""
    usual = sk.RefineConfig.paper().stop_tolerance
    batch = partial(refined, 1000, BATCH)
    name = f"batch of {BATCH}"
    rows = {
        "one pose, 1000 × 1000 px, 125 steps, 1 core": (median_ms(refined(1000, 1)), "≤ 30 ms"),
        "one pose, 4000 × 4000 px, 125 steps, 1 core": (median_ms(refined(4000, 1)), "as 1000 px"),
        f"{name}, 125 steps, 1 core, per pose": (median_ms(batch(), BATCH), ""),
        f"{name}, 125 steps, 2 cores, per pose": (median_ms(batch(n_threads=2), BATCH), ""),
        f"{name}, early stopping, 1 core, per pose": (median_ms(batch(stop_tolerance=usual), BATCH), ""),
        "closed form, 125 steps, per pose": (median_ms(batch(renderer="closed_form"), BATCH), ""),
    }
    command = [sys.executable, __file__, "--memory"]
    grown = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    rows["peak memory of one refinement"] = (f"{float(grown):.1f} MiB", "< 20 MB")
    return wanted("RefineConfig.paper(): 17 joints, 4 views (the paper reports about 3 s on a GPU)", rows)


if __name__ == "__main__":
    if "--memory" in sys.argv:
        print(grown_mib())
    else:
        lab.main(__doc__, paper)

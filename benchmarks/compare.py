"""Time per pose and accuracy of SkelSplat and other triangulations, on the same simulated detections.

    python benchmarks/compare.py [--poses 300] [--noise good|noisy|occluded2|occluded3]

Six simulated motions seen by four cameras in a Human3.6M-like room. Everything runs on one core. The
accuracy is over all poses; the time is the best of repeated runs, for slow methods on every k-th pose (the
column "timed on" has their number). Accuracy counts the joints that at least two views see, the same for
every method; "missing" is the share of these without a position. ``paper`` and its closed form start from DLT
weighted by confidence.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable

import lab
import numpy as np
from lab import ONE_THREAD, Table, brief
from peers import opencv_dlt, scipy_cauchy
from scenarios import Scene, simulated

import skelsplat as sk
from skelsplat.evaluation import baselines

Method = Callable[[slice], np.ndarray]

_NOISES = {"occluded2": "occluded 2", "occluded3": "occluded 3"}
_DEFAULT = "SkelSplat, default"
# Side of the crop in whose pixels Iskakov's threshold is.
_CROP_PX = 384.0
# A run that takes longer is timed on fewer poses.
_LONGEST_RUN_S = 1.0


def methods(scene: Scene) -> dict[str, Method]:
    """Return all methods, poses of some frames by name; the default last."""
    rig, found = scene.rig, scene.detections
    pixels = sk.project(scene.truth, rig).swapaxes(0, 1)
    crop_scale = np.ptp(pixels, axis=2).max(axis=-1) / _CROP_PX

    def from_dlt(frames: slice, **fields: object) -> np.ndarray:
        start = sk.triangulate(found[frames], rig, method="dlt")
        config = sk.RefineConfig.paper(n_threads=1, **fields)
        return sk.refine(start, found[frames], rig, layout="h36m17", config=config).pose

    return {
        "DLT, NumPy": lambda f: baselines.dlt(found[f], rig),
        "DLT with confidence, NumPy": lambda f: baselines.dlt(found[f], rig, confidence=True),
        "DLT of two views, OpenCV": lambda f: opencv_dlt(found[f], rig),
        "RANSAC of AdaFuse": lambda f: baselines.ransac_adafuse(found[f], rig),
        "RANSAC of Iskakov et al.": lambda f: baselines.ransac_iskakov(
            found[f], rig, crop_scale=crop_scale[f]
        ),
        "Cauchy loss, SciPy": lambda f: scipy_cauchy(found[f], rig),
        "Cauchy loss, NumPy, all joints at once": lambda f: baselines.cauchy(found[f], rig),
        "SkelSplat, paper": from_dlt,
        "SkelSplat, closed form, Adam": lambda f: from_dlt(f, renderer="closed_form"),
        _DEFAULT: lambda f: sk.refine(None, found[f], rig, layout="h36m17", config=ONE_THREAD).pose,
    }


def measured(method: Method, scene: Scene, repeat: int) -> dict[str, float]:
    """Run one method on every pose for its accuracy, then repeatedly for its time."""
    method(slice(0, 1))  # imports and compiles what it needs
    begun = time.perf_counter()
    points = method(slice(None))
    every = int(np.ceil((time.perf_counter() - begun) / _LONGEST_RUN_S))
    timed = slice(None, None, every)
    timed_on = len(scene.truth[timed])
    best = lab.seconds(lambda: method(timed), repeat)
    judged = (scene.detections[..., 2] > 0).sum(axis=1) >= 2
    errors = sk.metrics.mpjpe(points, scene.truth, reduce="none")[judged]
    missing = np.isnan(errors)
    found = errors[~missing]
    return {
        "ms/pose": 1e3 * best / timed_on,
        "mean mm": float(found.mean()),
        "median": float(np.median(found)),
        "p90": float(np.percentile(found, 90)),
        "missing %": 100 * float(missing.mean()),
        "timed on": timed_on,
    }


def compare(*, poses: int = 300, noise: str = "good", seed: int = 0, repeat: int = 5) -> Table:
    """Compare methods on poses."""
    with contextlib.suppress(ImportError):
        import cv2

        cv2.setNumThreads(1)  # it ignores the variables used by NumPy
    scene = simulated(poses, noise=_NOISES.get(noise, noise), seed=seed)
    rows, notes = {}, []
    for name, method in methods(scene).items():
        try:
            rows[name] = measured(method, scene, repeat)
        except ImportError as error:
            notes.append(f"{name}: left out, {error}")
    default_ms = rows[_DEFAULT]["ms/pose"]
    cells = {}
    for name, row in rows.items():
        ms = row.pop("ms/pose")
        cells[name] = {"ms/pose": brief(ms), "× default": brief(ms / default_ms), **row}
        cells[name] |= {key: f"{row[key]:.1f}" for key in ("mean mm", "median", "p90", "missing %")}
    title = f"{len(scene.truth)} poses, 17 joints, simulated detections '{noise}', one core"
    return Table.of(title, "method", cells, notes)


if __name__ == "__main__":
    lab.main(__doc__, compare)

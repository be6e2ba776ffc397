"""Time per pose and accuracy of SkelSplat and other triangulations, on the same simulated detections.

    python benchmarks/compare.py [--poses 300] [--noise good|noisy|occluded2|occluded3]

Six simulated motions seen by four cameras in a Human3.6M-like room. Everything runs on one core. The mean
error is over the joints of all poses that at least two views see, but for those that a method leaves out,
which a note says; the time is the best of repeated runs, for slow methods on every k-th pose. ``paper`` and
its closed form start from DLT weighted by confidence.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import lab
import numpy as np
from lab import ONE_THREAD, Table
from scenarios import FloatArray, Scene, missing, simulated

import skelsplat as sk
from skelsplat.evaluation import baselines
from skelsplat.evaluation.baselines._observations import homogeneous_to_world, observe

Method = Callable[[slice], FloatArray]

_NOISES = {"occluded2": "occluded 2", "occluded3": "occluded 3"}
_DEFAULT = "SkelSplat, default"
_CROP_PX = 384.0  # side of the crop in whose pixels Iskakov's threshold is
_LONGEST_RUN_S = 1.0  # a run that takes longer is timed on fewer poses


def opencv_dlt(detections: FloatArray, cameras: sk.CameraRig) -> FloatArray:
    """Triangulate by ``cv2.triangulatePoints`` from the first two views that see the joint."""
    joints = observe(detections, cameras)
    points = np.full((len(joints.seen), 3), np.nan)
    first_two = np.argsort(~joints.seen, axis=1, kind="stable")[:, :2]
    for a, b in np.unique(first_two[joints.determined], axis=0):
        own = joints.determined & (first_two == (a, b)).all(axis=1)
        found = cv2.triangulatePoints(
            joints.projections[a], joints.projections[b], joints.pixels[own, a].T, joints.pixels[own, b].T
        )
        points[own] = homogeneous_to_world(found.T)
    return joints.points(points)


def methods(scene: Scene) -> dict[str, Method]:
    """Return all methods, poses of some frames by name; the default last."""
    rig, found = scene.rig, scene.detections
    crop = np.ptp(sk.project(scene.truth, rig).swapaxes(0, 1), axis=2).max(axis=-1) / _CROP_PX

    def from_dlt(frames: slice, **fields: object) -> FloatArray:
        start = sk.triangulate(found[frames], rig, method="dlt")
        config = sk.RefineConfig.paper(n_threads=1, **fields)
        return sk.refine(start, found[frames], rig, layout="h36m17", config=config).pose

    return {
        "DLT, NumPy": lambda f: baselines.dlt(found[f], rig),
        "DLT with confidence, NumPy": lambda f: baselines.dlt(found[f], rig, confidence=True),
        "DLT of two views, OpenCV": lambda f: opencv_dlt(found[f], rig),
        "RANSAC of AdaFuse": lambda f: baselines.ransac_adafuse(found[f], rig),
        "RANSAC of Iskakov et al.": lambda f: baselines.ransac_iskakov(found[f], rig, crop_scale=crop[f]),
        "Cauchy loss, NumPy": lambda f: baselines.cauchy(found[f], rig),
        "SkelSplat, paper": from_dlt,
        "SkelSplat, closed form, Adam": lambda f: from_dlt(f, renderer="closed_form"),
        _DEFAULT: lambda f: sk.refine(None, found[f], rig, layout="h36m17", config=ONE_THREAD).pose,
    }


def measured(method: Method, scene: Scene, repeat: int) -> tuple[FloatArray, float]:
    """Run one method on every pose, then repeatedly; return the poses, and ms per pose."""
    method(slice(0, 1))  # imports and compiles what it needs
    points: list[FloatArray] = []
    once = lab.seconds(lambda: points.append(method(slice(None))))
    timed = slice(None, None, int(np.ceil(once / _LONGEST_RUN_S)))
    return points[0], 1e3 * lab.seconds(lambda: method(timed), repeat) / len(scene.truth[timed])


def compare(*, poses: int = 300, noise: str = "good", seed: int = 0, repeat: int = 5) -> Table:
    """Compare methods on poses."""
    cv2.setNumThreads(1)  # it ignores the variables used by NumPy
    scene = simulated(poses, noise=_NOISES.get(noise, noise), seed=seed)
    found = {name: measured(method, scene, repeat) for name, method in methods(scene).items()}
    rows = {}
    for name, (pose, ms) in found.items():
        times = {"ms/pose": f"{ms:.2g}", "× default": f"{ms / found[_DEFAULT][1]:.3g}"}
        rows[name] = {**times, "mean mm": scene.mpjpe(pose)}
    title = f"{len(scene.truth)} poses, 17 joints, simulated detections '{noise}', one core"
    notes = missing({name: pose for name, (pose, _) in found.items()}, scene, noise)
    return Table.of(title, "method", rows, notes)


if __name__ == "__main__":
    lab.main(__doc__, compare)

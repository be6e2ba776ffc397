"""The compared methods: each takes a scene and returns the pose (T, N, 3)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import combinations
from typing import Any

import numpy as np
from scenarios import FloatArray, Scene

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.evaluation import baselines

Fields = Mapping[str, Any]
Method = Callable[[Scene], FloatArray]

# Scale of the Cauchy loss, px: about twice the detector's jitter.
CAUCHY_SCALE_PX = 5.0
# Side of the crop, px: Iskakov's threshold is in its pixels.
CROP_PX = 384.0
# A body extends beyond its joints.
BOX_MARGIN = 1.1


def dlt(scene: Scene, *, weighted: bool = False) -> FloatArray:
    """DLT, with or without the confidences as weights."""
    detections = scene.detections if weighted else scene.detections[..., :2]
    return sk.triangulate(detections, scene.rig, method="dlt")


def dlt_weighted(scene: Scene) -> FloatArray:
    """DLT with the confidences as weights."""
    return dlt(scene, weighted=True)


def oracle_views(scene: Scene) -> FloatArray:
    """Triangulate each joint from the views that bring it closest to the truth: no choice does better."""
    n_views = len(scene.rig)
    best, least = np.full(scene.truth.shape, np.nan), np.full(scene.truth.shape[:2], np.inf)
    for used in (kept for n in range(2, n_views + 1) for kept in combinations(range(n_views), n)):
        detections = scene.detections[..., :2].copy()
        detections[:, np.setdiff1d(range(n_views), used)] = np.nan
        pose = sk.triangulate(detections, scene.rig, method="dlt")
        distance = np.linalg.norm(pose - scene.truth, axis=-1)
        nearer = distance < least
        best[nearer], least[nearer] = pose[nearer], distance[nearer]
    return best


def ransac_iskakov(scene: Scene) -> FloatArray:
    """Run Iskakov's with its threshold in the pixels of a 384 px crop of the person, as published."""
    pixels = np.where(scene.detected[..., None], scene.detections[..., :2], np.nan)
    low, high = np.fmin.reduce(pixels, axis=2), np.fmax.reduce(pixels, axis=2)
    side = BOX_MARGIN * (high - low).max(axis=-1)
    scale = np.where(side > 0, side, CROP_PX) / CROP_PX
    return baselines.ransac_iskakov(scene.detections, scene.rig, crop_scale=scale)


def cauchy(scene: Scene) -> FloatArray:
    """Minimise the Cauchy loss of the reprojection errors from DLT."""
    return baselines.cauchy(scene.detections, scene.rig, f_scale=CAUCHY_SCALE_PX)


RANSACS: dict[str, Method] = {
    "AdaFuse": lambda scene: baselines.ransac_adafuse(scene.detections, scene.rig),
    "RANSAC": lambda scene: sk.triangulate(scene.detections, scene.rig, method="ransac"),
}
# With the non-linear refinement of Iskakov et al., which takes longest.
ALL_RANSACS = {"Iskakov": ransac_iskakov, **RANSACS}


def triangulations(*, fast: bool = False) -> dict[str, Method]:
    """Return the methods that only triangulate."""
    return {"DLT": dlt, "DLT conf.": dlt_weighted, **(RANSACS if fast else ALL_RANSACS)}


def paper(scene: Scene, start: FloatArray | None = None, **fields: Any) -> sk.Refinement:
    """Run the paper's method from `start`, by default from DLT without weights."""
    first = dlt(scene) if start is None else start
    config = sk.RefineConfig.paper(**fields)
    return sk.refine(first, scene.detections, scene.rig, layout=scene.layout, config=config)


def default(
    scene: Scene,
    start: FloatArray | None = None,
    *,
    init_sigma: float | FloatArray | None = None,
    fields: Fields | None = None,
) -> sk.Refinement:
    """Run ``RefineConfig()`` with `fields` changed."""
    config = sk.RefineConfig(**(fields or {}))
    return sk.refine(
        start, scene.detections, scene.rig, layout=scene.layout, config=config, init_sigma=init_sigma
    )


def monocular_start(scene: Scene, error_mm: float, seed: int) -> FloatArray:
    """Fuse simulated monocular poses, with noise that gives the fused pose an MPJPE of `error_mm`."""
    sigma = error_mm
    for _ in range(4):
        poses = synthetic.monocular_poses(scene.truth, scene.rig, sigma, seed=seed)
        start = sk.fuse_monocular(poses, scene.detections, scene.rig)
        sigma *= error_mm / float(sk.metrics.mpjpe(start, scene.truth))
    return start


def mpjpe(pose: FloatArray, scene: Scene) -> float:
    """MPJPE in mm over the joints that at least two views detect."""
    return float(sk.metrics.mpjpe(pose, scene.judged))


def missing(columns: Mapping[str, FloatArray], scene: Scene, where: str) -> list[str]:
    """Note for each column the share of evaluated joints without a position, if any."""
    shares = {name: float(sk.metrics.missing_rate(pose, scene.judged)) for name, pose in columns.items()}
    return [
        f"{where}: {name} leaves {100 * s:.2f} % of the joints out" for name, s in shares.items() if s > 0
    ]


def coverage(result_pose: FloatArray, covariance: FloatArray, truth: FloatArray) -> FloatArray:
    """Share of joints within 1, 2 and 3 standard deviations, %; ideal are 19.9, 73.9 and 97.1."""
    return np.asarray(100 * sk.metrics.sigma_coverage(result_pose, covariance, truth))

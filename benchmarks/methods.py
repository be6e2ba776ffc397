"""The compared methods: each takes a scene and returns the pose (T, N, 3)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import combinations
from typing import Any, TypeVar

import numpy as np
from scenarios import FloatArray, Scene

import skelsplat as sk
from skelsplat import synthetic

Fields = Mapping[str, Any]
T = TypeVar("T")

# Scale of the Cauchy loss, px.
CAUCHY_SCALE_PX = 5.0
# Side of the crop, px: Iskakov's threshold is in its pixels.
CROP_PX = 384.0
# A body extends beyond its joints.
BOX_MARGIN = 1.1


class UnavailableError(Exception):
    """A method not available in this version of the package."""


def available(columns: Mapping[str, Callable[[], T]]) -> tuple[dict[str, T], list[str]]:
    """Call every entry; return the results, and a note on those not available in this version."""
    out: dict[str, T] = {}
    absent: dict[str, list[str]] = {}
    for name, call in columns.items():
        try:
            out[name] = call()
        except (UnavailableError, ImportError, AttributeError, TypeError) as reason:
            absent.setdefault(str(reason), []).append(name)
    return out, [f"without {', '.join(names)}: {reason}" for reason, names in absent.items()]


def dlt(scene: Scene, *, weighted: bool = False) -> FloatArray:
    """DLT, with or without the confidences as weights."""
    detections = scene.detections if weighted else scene.detections[..., :2]
    return sk.triangulate(detections, scene.rig, method="dlt")


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


def core_ransac(scene: Scene) -> FloatArray:
    try:
        return sk.triangulate(scene.detections, scene.rig, method="ransac")
    except sk.InvalidInputError as error:
        if "method" not in str(error):
            raise
        raise UnavailableError(str(error)) from error


def ransac_iskakov(scene: Scene) -> FloatArray:
    """Run Iskakov's with its threshold in the pixels of a 384 px crop of the person, as published."""
    from skelsplat.evaluation import baselines

    return baselines.ransac_iskakov(scene.detections, scene.rig, crop_scale=_box_px(scene) / CROP_PX)


def _box_px(scene: Scene) -> FloatArray:
    """Side of the square box around the detections of each view, (T, M) px; a crop's if there are none."""
    pixels = np.where(scene.detected[..., None], scene.detections[..., :2], np.nan)
    low = np.fmin.reduce(pixels, axis=2)
    high = np.fmax.reduce(pixels, axis=2)
    side = BOX_MARGIN * (high - low).max(axis=-1)
    return np.where(side > 0, side, CROP_PX)


def ransac_adafuse(scene: Scene) -> FloatArray:
    from skelsplat.evaluation import baselines

    return baselines.ransac_adafuse(scene.detections, scene.rig)


def cauchy(scene: Scene) -> FloatArray:
    """Minimise the Cauchy loss of the reprojection errors from DLT."""
    from skelsplat.evaluation import baselines

    return baselines.cauchy(scene.detections, scene.rig, f_scale=CAUCHY_SCALE_PX)


RANSACS: dict[str, Callable[[Scene], FloatArray]] = {
    "AdaFuse": ransac_adafuse,
    "RANSAC": core_ransac,
}
# With the non-linear refinement of Iskakov et al.
ALL_RANSACS = {"Iskakov": ransac_iskakov, **RANSACS}


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
    if sk.RefineConfig() == sk.RefineConfig.paper():
        raise UnavailableError("RefineConfig() is still RefineConfig.paper()")
    config = sk.RefineConfig(**(fields or {}))
    prior = {} if init_sigma is None else {"init_sigma": init_sigma}
    return sk.refine(start, scene.detections, scene.rig, layout=scene.layout, config=config, **prior)


def monocular_start(scene: Scene, error_mm: float, seed: int) -> FloatArray:
    """Fuse simulated monocular poses, with noise that gives the fused pose an MPJPE of `error_mm`."""
    sigma = error_mm
    for _ in range(4):
        poses = synthetic.monocular_poses(scene.truth, scene.rig, sigma, seed=seed)
        start = sk.fuse_monocular(poses, scene.detections, scene.rig)
        sigma *= error_mm / float(sk.metrics.mpjpe(start, scene.truth))
    return start


def per_axis_sigma(start: FloatArray, truth: FloatArray) -> float:
    """Root mean square error per axis, mm."""
    return float(np.sqrt(np.nanmean((start - truth) ** 2)))


def covariance(start: FloatArray, truth: FloatArray) -> FloatArray:
    """Mean square error of every joint, (N, 3, 3) mm²; about zero, as for an unbiased initial pose."""
    error = start - truth
    return np.einsum("tni,tnj->nij", error, error) / len(error)

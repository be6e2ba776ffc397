"""The methods that are compared: each takes a scene and gives the pose (T, N, 3)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import numpy as np
from scenarios import FloatArray, Scene
from scipy.optimize import least_squares

import skelsplat as sk
from skelsplat import synthetic

Fields = Mapping[str, Any]
T = TypeVar("T")

# Residual beyond which SciPy's Cauchy loss flattens, px.
CAUCHY_SCALE_PX = 5.0


class UnavailableError(Exception):
    """A method that this version of the package does not have."""


def available(columns: Mapping[str, Callable[[], T]]) -> tuple[dict[str, T], list[str]]:
    """Call every entry; give the results, and a note on those that this version cannot compute."""
    out: dict[str, T] = {}
    absent: dict[str, list[str]] = {}
    for name, call in columns.items():
        try:
            out[name] = call()
        except (UnavailableError, ImportError, AttributeError, TypeError) as reason:
            absent.setdefault(str(reason), []).append(name)
    return out, [f"without {', '.join(names)}: {reason}" for reason, names in absent.items()]


def dlt(scene: Scene, *, weighted: bool = False) -> FloatArray:
    """Plain triangulation, with the confidences as weights or without any."""
    detections = scene.detections if weighted else scene.detections[..., :2]
    return sk.triangulate(detections, scene.rig, method="dlt")


def core_ransac(scene: Scene) -> FloatArray:
    try:
        return sk.triangulate(scene.detections, scene.rig, method="ransac")
    except sk.InvalidInputError as error:
        if "method" not in str(error):
            raise
        raise UnavailableError(str(error)) from error


def baseline(name: str) -> Callable[[Scene], FloatArray]:
    """Return ``skelsplat.evaluation.baselines.<name>`` as a method."""

    def method(scene: Scene) -> FloatArray:
        from skelsplat.evaluation import baselines

        return np.asarray(getattr(baselines, name)(scene.detections, scene.rig))

    return method


RANSACS: dict[str, Callable[[Scene], FloatArray]] = {
    "RANSAC Iskakov": baseline("ransac_iskakov"),
    "RANSAC AdaFuse": baseline("ransac_adafuse"),
    "RANSAC core": core_ransac,
}


def cauchy(scene: Scene) -> FloatArray:
    """Minimise SciPy's Cauchy loss of the reprojection errors from DLT, joint by joint; pinhole cameras."""
    start = dlt(scene)
    matrices = np.stack([c.K @ np.column_stack([c.R, c.t]) for c in scene.rig])
    out = start.copy()
    for t, j in np.argwhere(np.isfinite(scene.judged).all(axis=-1) & np.isfinite(start).all(axis=-1)):
        seen = scene.detected[t, :, j]
        P, pixels = matrices[seen], scene.detections[t, seen, j, :2]

        def residuals(x: FloatArray, P: FloatArray = P, pixels: FloatArray = pixels) -> FloatArray:
            h = P[:, :, :3] @ x + P[:, :, 3]
            return (h[:, :2] / h[:, 2:] - pixels).ravel()

        out[t, j] = least_squares(residuals, start[t, j], loss="cauchy", f_scale=CAUCHY_SCALE_PX).x
    return out


def paper(scene: Scene, start: FloatArray | None = None, **fields: Any) -> sk.Refinement:
    """Run the paper's method from `start`, by default from DLT without weights."""
    first = dlt(scene) if start is None else start
    config = sk.RefineConfig.paper(**fields)
    return sk.refine(first, scene.detections, scene.rig, layout=scene.layout, config=config)


def default(
    scene: Scene,
    start: FloatArray | None = None,
    *,
    init_sigma: float | None = None,
    fields: Fields | None = None,
) -> sk.Refinement:
    """Run ``RefineConfig()`` with `fields` changed."""
    if sk.RefineConfig() == sk.RefineConfig.paper():
        raise UnavailableError("RefineConfig() is still RefineConfig.paper()")
    config = sk.RefineConfig(**(fields or {}))
    prior = {} if init_sigma is None else {"init_sigma": init_sigma}
    return sk.refine(start, scene.detections, scene.rig, layout=scene.layout, config=config, **prior)


def monocular_start(scene: Scene, error_mm: float, seed: int) -> FloatArray:
    """Fuse simulated monocular poses whose noise is such that the fused pose errs `error_mm` (MPJPE)."""
    sigma = error_mm
    for _ in range(4):
        poses = synthetic.monocular_poses(scene.truth, scene.rig, sigma, seed=seed)
        start = sk.fuse_monocular(poses, scene.detections, scene.rig)
        sigma *= error_mm / float(sk.metrics.mpjpe(start, scene.truth))
    return start


def per_axis_sigma(start: FloatArray, truth: FloatArray) -> float:
    """Root mean square error per axis, mm."""
    return float(np.sqrt(np.nanmean((start - truth) ** 2)))

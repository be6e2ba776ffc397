"""Gaussian noise of any size: the default compared with DLT, and the coverage of its error bars."""

from __future__ import annotations

from typing import Any

import numpy as np
import report
from methods import Fields, default, dlt
from scenarios import FloatArray, Scene, cmu_poses, pose_source, rig

import skelsplat as sk

SIGMAS_PX = (1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0)
VIEWS = (2, 3, 4, 8)


def noisy_scene(sigma_px: float, poses: int, seed: int, n_views: int) -> Scene:
    """Project poses and add independent normal noise on both axes; every confidence is 1."""
    cameras, truth = rig("room", n_views), cmu_poses(poses, seed)
    pixels = np.moveaxis(sk.project(truth, cameras), 0, 1)
    pixels += sigma_px * np.random.default_rng(seed).standard_normal(pixels.shape)
    detections = np.concatenate([pixels, np.ones((*pixels.shape[:-1], 1))], axis=-1)
    return Scene(truth, detections, cameras, "h36m17", f"{pose_source()}, room, Gaussian noise only")


def gaussian(*, poses: int = 200, seed: int = 0, fields: Fields | None = None) -> dict[str, Any]:
    """MPJPE in mm of DLT with confidence and of the default, their ratio, and coverage of the error bars."""
    rows: dict[str, dict[str, Any]] = {}
    for n_views in VIEWS:
        for sigma in SIGMAS_PX:
            here = noisy_scene(sigma, poses, seed, n_views)
            rows[f"{n_views} views, {sigma:.0f} px"] = row(here, default(here, fields=fields))
    worst = max(rows.values(), key=lambda r: r["ratio"])["ratio"]
    least = min(rows.values(), key=lambda r: r["3 σ"])["3 σ"]
    notes = [
        f"largest ratio to DLT: {worst:.3f}; least coverage at 3 σ: {least:.1f} % (ideal 97.1)",
        "coverage over the joints that are ok; beyond: ok joints further off than 3 σ, %",
    ]
    title = "Gaussian noise: MPJPE, mm, and coverage, %"
    return report.figures(title, "noise", rows, notes, poses=poses, seed=seed, source=here.source)


def row(here: Scene, result: sk.Refinement) -> dict[str, float]:
    plain = report.mpjpe(dlt(here, weighted=True), here)
    ours = report.mpjpe(result.pose, here)
    ok = result.joint_status == "ok"
    share = _coverage(result, here, ok)
    return {
        "DLT conf.": plain,
        "default": ours,
        "ratio": round(ours / plain, 3),
        "1 σ": share[0],
        "2 σ": share[1],
        "3 σ": share[2],
        "beyond": 100 - share[2],
        "ok, %": 100 * float(ok.mean()),
        "noise": float(np.median(result.noise)),
    }


def _coverage(result: sk.Refinement, here: Scene, ok: np.ndarray) -> FloatArray:
    truth = np.where(ok[..., None], here.judged, np.nan)
    return np.asarray(100 * sk.metrics.sigma_coverage(result.pose, result.uncertainty, truth))

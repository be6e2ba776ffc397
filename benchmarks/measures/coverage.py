"""How often the errors lie within the predicted uncertainty."""

from __future__ import annotations

from typing import Any

import numpy as np
import report
from methods import Fields, available, default, paper
from scenarios import NOISES, FloatArray, Scene, louder, mvor, scene
from scipy.stats import spearmanr

import skelsplat as sk

# Share of a Gaussian in three dimensions within 1, 2 and 3 standard deviations, in percent.
IDEAL = np.array([19.9, 73.9, 97.1])
VIEWS = (3, 4, 8)
# MVOR's labels are good to ±50 mm in space, which is this per axis.
LABEL_SIGMA_MM = 30.0
FACTORS = (1, 2)


def coverage(
    *,
    poses: int = 300,
    seed: int = 0,
    fast: bool = False,
    fields: Fields | None = None,
    kind: str = "room",
) -> dict[str, Any]:
    """Coverage in percent at 1, 2, 3 σ, and rank correlation of predicted and true error.

    For four views the paper's splat covariance is added for `paper`, unless `fast`.
    """
    rows, notes = {}, []
    for name in ("good", "occluded 2"):
        for n_views in VIEWS:
            for factor in FACTORS:
                here = scene(louder(NOISES[name], factor), poses, seed, kind=kind, n_views=n_views)
                where = f"{name}, {n_views}v, {NOISES[name].sigma_px * factor:.1f}px"
                calls = {"uncertainty": lambda here=here: _default(here, fields)}
                if not fast and factor == 1 and n_views == 4:
                    calls["paper's splat covariance"] = lambda here=here: _paper(here)
                found, absent = available(calls)
                notes += absent
                rows |= {f"{where}{'' if k == 'uncertainty' else ', paper'}": v for k, v in found.items()}
    deviations = [row["deviation"] for where, row in rows.items() if not where.endswith("paper")]
    if deviations:
        notes.append(f"largest deviation of any row from the ideal: {max(deviations):.1f} points")
    notes.append("rows: detections, views, jitter; paper: its splat covariance")
    notes.append("rank: rank correlation of predicted and true error; predicted, true: median lengths, mm")
    notes.append("if exact: the same, were every error drawn from its predicted covariance")
    return report.figures(
        "Coverage, % (ideal 19.9, 73.9, 97.1), and errors, mm",
        "detections",
        rows,
        notes,
        poses=poses,
        seed=seed,
        source=here.source,
    )


def _default(here: Scene, fields: Fields | None) -> dict[str, float]:
    result = default(here, fields=fields)
    return _row(result.pose, result.uncertainty, here)


def _paper(here: Scene) -> dict[str, float]:
    result = paper(here)
    return _row(result.pose, result.covariance, here)


def _row(pose: FloatArray, covariance: FloatArray, here: Scene) -> dict[str, float]:
    share = 100 * sk.metrics.sigma_coverage(pose, covariance, here.judged)
    error = sk.metrics.mpjpe(pose, here.judged, reduce="none").ravel()
    predicted = np.sqrt(np.trace(covariance, axis1=-2, axis2=-1)).ravel()
    both = np.isfinite(error) & np.isfinite(predicted)
    drawn = _drawn(covariance).ravel()
    return {
        "1 σ": float(share[0]),
        "2 σ": float(share[1]),
        "3 σ": float(share[2]),
        "deviation": float(np.abs(share - IDEAL).max()),
        "rank": float(spearmanr(predicted[both], error[both]).statistic),
        "if exact": float(spearmanr(predicted[both], drawn[both]).statistic),
        "predicted": float(np.median(predicted[both])),
        "true": float(np.median(error[both])),
        "MPJPE": float(error[both].mean()),
    }


def _drawn(covariance: FloatArray) -> FloatArray:
    """Lengths of errors drawn from the covariances: the reference for an exact prediction."""
    known = np.isfinite(covariance).all(axis=(-2, -1))
    factor = np.linalg.cholesky(np.where(known[..., None, None], covariance, np.eye(3)))
    normal = np.random.default_rng(0).standard_normal((*known.shape, 3, 1))
    return np.linalg.norm((factor @ normal)[..., 0], axis=-1)


def coverage_real(
    *,
    label_sigma_mm: float = LABEL_SIGMA_MM,
    detector: str = "openpose",
    poses: int = 300,
    seed: int = 0,
    fields: Fields | None = None,
) -> dict[str, Any]:
    """Measure which percentage of errors scatter and error bar cover, on MVOR and in a simulation.

    The labels' variance is added to every covariance. An offset is the mean error of a joint over all people;
    taking it out uses the labels, and shows what remains beyond a constant difference of definition.
    """
    here = scene(NOISES["good"], poses, seed, n_views=3)
    rows = {"simulated, 3 views": _both(default(here, fields=fields), here.judged, 0.0)}
    real = mvor(detector)
    result = default(real, fields=fields)
    hips = [j for j, name in enumerate(sk.layouts.COCO17.joints) if name.endswith("hip")]
    no_hips, only_hips, by_three = (real.judged.copy() for _ in range(3))
    by_one = np.where((real.detected.sum(axis=1) == 1)[..., None], real.truth, np.nan)
    no_hips[:, hips] = np.nan
    only_hips[:, np.setdiff1d(np.arange(17), hips)] = np.nan
    by_three[real.detected.sum(axis=1) < 3] = np.nan
    parts = {"all": real.judged, "without hips": no_hips, "hips": only_hips}
    parts |= {"three views": by_three, "one view": by_one}
    for name, truth in parts.items():
        rows[f"MVOR, {name}"] = _both(result, truth, label_sigma_mm)
        rows[f"MVOR, {name}, offsets out"] = _both(
            result, truth + _offsets(result.pose, truth), label_sigma_mm
        )
    notes = [
        f"ideal 19.9, 73.9, 97.1; labels of MVOR: {label_sigma_mm:g} mm per axis, added to the covariances",
        "the simulated detector has no systematic error, so the error bar is too wide there",
        "offsets out: the mean error of each joint, which only the labels show, is subtracted",
    ]
    title = "Coverage of scatter and error bar, %"
    return report.figures(title, "", rows, notes, poses=poses, seed=seed, source=real.source)


def _offsets(pose: FloatArray, truth: FloatArray) -> FloatArray:
    """Mean error of every joint, (N, 3); 0 for one that is never judged."""
    error = pose - truth
    known = np.isfinite(error).all(axis=-1, keepdims=True)
    total = np.where(known, error, 0.0).sum(axis=0)
    mean: FloatArray = total / np.maximum(known.sum(axis=0), 1)
    return mean


def _both(result: sk.Refinement, truth: FloatArray, label_sigma_mm: float) -> dict[str, float]:
    """Coverage by scatter and by error bar, with labels that err by so much per axis."""
    out: dict[str, float] = {}
    for name, covariance in (("scatter", result.uncertainty), ("error bar", result.error_bar)):
        share = 100 * sk.metrics.sigma_coverage(
            result.pose, covariance + label_sigma_mm**2 * np.eye(3), truth
        )
        out |= {f"{name} {k} σ": float(value) for k, value in zip((1, 2, 3), share, strict=True)}
    error = sk.metrics.mpjpe(result.pose, truth, reduce="none")
    out["joints"] = int(np.isfinite(error).sum())
    out["MPJPE"] = float(np.nanmean(error))
    return out

"""How often the errors lie within the predicted uncertainty."""

from __future__ import annotations

from typing import Any

import numpy as np
import report
from methods import Fields, available, default, paper
from scenarios import NOISES, FloatArray, Scene, louder, scene
from scipy.stats import spearmanr

import skelsplat as sk

# Share of a Gaussian in three dimensions within 1, 2 and 3 standard deviations, in percent.
IDEAL = np.array([19.9, 73.9, 97.1])
VIEWS = (3, 4, 8)
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

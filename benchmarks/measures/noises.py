"""Error of every method at every detection noise (the table of the README)."""

from __future__ import annotations

from typing import Any

import numpy as np
import report
from methods import (
    ALL_RANSACS,
    RANSACS,
    Fields,
    available,
    covariance,
    default,
    dlt,
    monocular_start,
    paper,
    per_axis_sigma,
)
from scenarios import NOISES, FloatArray, Scene, scene

import skelsplat as sk

# MPJPE of the fused monocular start.
START_MM = 40.0


def table(
    *,
    poses: int = 300,
    seed: int = 0,
    n_seeds: int = 3,
    fast: bool = False,
    fields: Fields | None = None,
    kind: str = "room",
    n_views: int = 4,
) -> dict[str, Any]:
    """MPJPE in mm of all methods; `fast` omits the paper's and RANSAC Iskakov."""
    rows, errors_of_mean, notes = {}, {}, []
    for name, noise in NOISES.items():
        here = scene(noise, poses, seed, kind=kind, n_views=n_views, n_seeds=n_seeds)
        start = monocular_start(here, START_MM, seed)
        sigma, spread = per_axis_sigma(start, here.truth), covariance(start, here.truth)
        found, absent = available(_columns(here, start, (sigma, spread), fast, fields))
        rows[name] = {column: report.mpjpe(pose, here) for column, pose in found.items()}
        errors_of_mean[name] = {column: _standard_error(pose, here) for column, pose in found.items()}
        notes += absent + report.missing(found, here, name)
        axes = ", ".join(f"{s:.1f}" for s in np.sqrt(np.diagonal(spread.mean(axis=0))))
        notes.append(
            f"{name}: start {report.mpjpe(start, here):.1f} mm, {sigma:.1f} mm per axis ({axes} on x, y, z)"
        )
    return report.figures(
        "MPJPE, mm (joints that at least two views detect)",
        "detections",
        rows,
        notes,
        poses=len(here.truth),
        seeds=f"{seed} to {seed + n_seeds - 1}",
        source=here.source,
        details={"standard_error": errors_of_mean},
    )


def _columns(
    here: Scene, start: FloatArray, prior: tuple[float, FloatArray], fast: bool, fields: Fields | None
) -> dict[str, Any]:
    columns: dict[str, Any] = {
        "DLT": lambda: dlt(here),
        "DLT conf.": lambda: dlt(here, weighted=True),
        **{
            name: lambda method=method: method(here)
            for name, method in (RANSACS if fast else ALL_RANSACS).items()
        },
    }
    if not fast:
        columns["paper, DLT"] = lambda: paper(here).pose
        columns["paper, start"] = lambda: paper(here, start).pose
    columns["default"] = lambda: default(here, fields=fields).pose
    columns["from start"] = lambda: default(here, start, fields=fields).pose
    columns["with sigma"] = lambda: default(here, start, init_sigma=prior[0], fields=fields).pose
    columns["with covar."] = lambda: default(here, start, init_sigma=prior[1], fields=fields).pose
    return columns


def _standard_error(pose: FloatArray, here: Scene) -> float:
    each = sk.metrics.mpjpe(pose, here.judged, reduce="per_pose")
    return float(np.nanstd(each, ddof=1) / np.sqrt(np.isfinite(each).sum()))

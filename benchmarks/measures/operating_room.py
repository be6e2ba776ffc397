"""Errors on MVOR: real detections of partly occluded people, three views."""

from __future__ import annotations

from typing import Any

import numpy as np
import report
from methods import (
    ALL_RANSACS,
    CAUCHY_SCALE_PX,
    RANSACS,
    Fields,
    available,
    cauchy,
    default,
    dlt,
    oracle_views,
    paper,
)
from scenarios import FloatArray, Scene
from scenarios import mvor as mvor_scene

import skelsplat as sk

GROSS_MM = 150.0


def mvor(*, detector: str = "openpose", fast: bool = False, fields: Fields | None = None) -> dict[str, Any]:
    """Mean, median, 90th percentile and share of gross errors; `fast` omits methods that take seconds."""
    here = mvor_scene(detector)
    columns: dict[str, Any] = {
        "DLT": lambda: dlt(here),
        "DLT conf.": lambda: dlt(here, weighted=True),
        **{
            name: lambda method=method: method(here)
            for name, method in (RANSACS if fast else ALL_RANSACS).items()
        },
    }
    if not fast:
        columns["Cauchy"] = lambda: cauchy(here)
        for start, weighted in (("DLT", False), ("DLT conf.", True)):
            begin = dlt(here, weighted=weighted)
            columns[f"paper, from {start}"] = lambda begin=begin: paper(here, begin).pose
            columns[f"closed form, Adam, from {start}"] = lambda begin=begin: (
                paper(here, begin, renderer="closed_form").pose
            )
    columns["default"] = lambda: default(here, fields=fields).pose
    columns["oracle: DLT of the best views"] = lambda: oracle_views(here)
    found, notes = available(columns)
    rows = {name: _row(pose, here) for name, pose in found.items()}
    notes += report.missing(found, here, "MVOR")
    notes.append(f"Cauchy loss with a scale of {CAUCHY_SCALE_PX:g} px; labels are good to about ±50 mm")
    joints = int(np.isfinite(here.judged).all(axis=-1).sum())
    return report.figures(
        "MVOR, mm", "method", rows, notes, people=len(here.truth), joints=joints, source=here.source
    )


def _gross(each: FloatArray) -> float:
    """Share of the errors (…) above `GROSS_MM`, %."""
    known = each[np.isfinite(each)]
    return float(100 * (known > GROSS_MM).mean())


def _row(pose: FloatArray, here: Scene) -> dict[str, float]:
    each = sk.metrics.mpjpe(pose, here.judged, reduce="none")
    known = each[np.isfinite(each)]
    hip = np.array(["hip" in joint for joint in sk.layouts.get(here.layout).joints])
    by_three = each[np.isfinite(each) & (here.detected.sum(axis=1) == 3)]
    return {
        "mean": float(known.mean()),
        "median": float(np.median(known)),
        "90 %": float(np.percentile(known, 90)),
        f"> {GROSS_MM:.0f} mm, %": _gross(each),
        "hips": _gross(each[:, hip]),
        "others": _gross(each[:, ~hip]),
        "mean, 3 views": float(by_three.mean()),
        "median, 3 views": float(np.median(by_three)),
    }

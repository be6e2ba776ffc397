"""Left–right swaps: error with and without, and how many are found."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import report
from methods import RANSACS, Fields, available, default, dlt
from numpy.typing import NDArray
from scenarios import NOISES, FloatArray, Scene, scene

import skelsplat as sk

SWAPPED = replace(NOISES["good"], limb_swap_rate=0.05, view_swap_rate=0.02)


def swaps(*, poses: int = 300, seed: int = 0, fields: Fields | None = None) -> dict[str, Any]:
    """MPJPE in mm at all joints and at those swapped in some view; swaps reported, correct and false.

    Counts are of (frame, view, joint). The clean detections differ only in having no swaps, so every
    report there is false.
    """
    clean, swapped = scene("good", poses, seed), scene(SWAPPED, poses, seed)
    differ = ~np.isclose(clean.detections, swapped.detections, equal_nan=True).all(axis=-1)
    rows: dict[str, dict[str, Any]] = {}
    notes = []
    for where, here, true in (("clean", clean, np.zeros_like(differ)), ("swapped", swapped, differ)):
        poses_only = {"DLT": lambda here=here: dlt(here)}
        poses_only |= {name: lambda m=method, here=here: m(here) for name, method in RANSACS.items()}
        found, absent = available(poses_only)
        notes += absent
        for name, pose in found.items():
            rows[f"{where}, {name}"] = _errors(pose, here, differ)
        results, absent = available(
            {
                f"{where}, find_swaps={find}": lambda here=here, find=find: default(
                    here, fields={**(fields or {}), "find_swaps": find}
                )
                for find in (False, True)
            }
        )
        notes += absent
        for name, result in results.items():
            rows[name] = _errors(result.pose, here, differ) | _counts(result.swapped, true)
    notes.append(f"limbs {SWAPPED.limb_swap_rate}, views {SWAPPED.view_swap_rate} per frame; else as 'good'")
    notes.append("counts: (frame, view, joint); flagged views: (frame, view) with any")
    return report.figures(
        "Swaps of left and right, MPJPE in mm",
        "detections, method",
        rows,
        notes,
        poses=poses,
        seed=seed,
        source=clean.source,
    )


def _errors(pose: FloatArray, here: Scene, differ: NDArray[np.bool_]) -> dict[str, float]:
    each = sk.metrics.mpjpe(pose, here.judged, reduce="none")
    return {
        "all joints": float(np.nanmean(each)),
        "swapped joints": float(np.nanmean(each[differ.any(axis=1)])),
    }


def _counts(flagged: NDArray[np.bool_], true: NDArray[np.bool_]) -> dict[str, int]:
    return {
        "true": int(true.sum()),
        "found": int((flagged & true).sum()),
        "wrong": int((flagged & ~true).sum()),
        "flagged views": int(flagged.any(axis=-1).sum()),
    }

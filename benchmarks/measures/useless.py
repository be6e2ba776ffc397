"""Effect of a fifth camera with only wrong detections on the result of four good ones."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import report
from methods import ALL_RANSACS, RANSACS, Fields, available, default, dlt, paper
from scenarios import FloatArray, Scene, rig, scene

import skelsplat as sk

OFFSET_PX = np.array([60.0, -80.0])
# The useless detector has the confidences of a good one.
CONFIDENCE = 0.9


def useless(
    *, poses: int = 300, seed: int = 0, fast: bool = False, fields: Fields | None = None
) -> dict[str, Any]:
    """Change of the result in mm, and MPJPE without and with the fifth view; `fast` omits slow methods."""
    four = scene("good", poses, seed)
    methods: dict[str, Any] = {"DLT": dlt, "DLT conf.": lambda s: dlt(s, weighted=True)}
    methods |= RANSACS if fast else ALL_RANSACS
    if not fast:
        methods["paper"] = lambda s: paper(s).pose
    methods["default"] = lambda s: default(s, fields=fields).pose
    before, notes = available({name: lambda m=m: m(four) for name, m in methods.items()})
    rows = {}
    for kind, pixels in _wrong(four, seed).items():
        five = _with_fifth(four, pixels)
        for name, pose in before.items():
            after = methods[name](five)
            moved = np.linalg.norm(after - pose, axis=-1)
            rows[f"{name}: {kind}"] = {
                "change, median": float(np.nanmedian(moved)),
                "mean": float(np.nanmean(moved)),
                "95 %": float(np.nanpercentile(moved, 95)),
                "MPJPE, 4 views": report.mpjpe(pose, four),
                "MPJPE, 5 views": report.mpjpe(after, four),
            }
    return report.figures(
        "A fifth view that is all wrong, mm",
        "method: detections of the fifth view",
        rows,
        notes,
        poses=poses,
        seed=seed,
        source=four.source,
    )


def _wrong(four: Scene, seed: int) -> dict[str, FloatArray]:
    """Return detections (T, N, 2) px of the fifth camera, by kind of error."""
    rng = np.random.default_rng(seed + 1)
    camera = list(rig("room", 5))[4]
    true = sk.project(four.truth, [camera])[0]
    noisy = true + rng.normal(0.0, 2.3, true.shape)
    return {
        "uniform": rng.uniform(0.0, camera.size, size=true.shape),
        "offset 100 px": noisy + OFFSET_PX,
        "another pose": np.roll(noisy, 1, axis=0),
    }


def _with_fifth(four: Scene, pixels: FloatArray) -> Scene:
    fifth = np.concatenate([pixels, np.full((*pixels.shape[:-1], 1), CONFIDENCE)], axis=-1)
    detections = np.concatenate([four.detections, fifth[:, None]], axis=1)
    return replace(four, detections=detections, rig=rig("room", 5))

"""Error against the noise on the initial pose."""

from __future__ import annotations

from typing import Any

import report
from methods import Fields, available, default, dlt, paper
from scenarios import scene

from skelsplat import synthetic

LEVELS_MM = (0, 10, 20, 40, 60, 80, 100, 200, 400)


def start(
    *,
    poses: int = 300,
    seed: int = 0,
    noise: str = "good",
    fast: bool = False,
    fields: Fields | None = None,
) -> dict[str, Any]:
    """MPJPE in mm from DLT plus Gaussian noise per axis; `fast` omits the paper's method."""
    here = scene(noise, poses, seed)
    triangulated = dlt(here)
    rows: dict[str, dict[str, float]] = {}
    notes = []
    for level in LEVELS_MM:
        first = synthetic.perturb(triangulated, level, seed=seed + 1)
        calls: dict[str, Any] = {"start": lambda first=first: first}
        if not fast:
            calls["paper"] = lambda first=first: paper(here, first).pose
        calls["default"] = lambda first=first: default(here, first, fields=fields).pose
        found, absent = available(calls)
        notes += absent + report.missing(found, here, f"{level} mm")
        for name, pose in found.items():
            rows.setdefault(name, {})[f"{level}"] = report.mpjpe(pose, here)
    return report.figures(
        f"MPJPE, mm, by noise on the start, mm per axis; detections: {noise}",
        "method",
        rows,
        notes,
        poses=poses,
        seed=seed,
        source=here.source,
    )

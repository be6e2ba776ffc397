"""Error against the number of views."""

from __future__ import annotations

from typing import Any

import report
from methods import RANSACS, Fields, available, default, dlt
from scenarios import NOISES, scene

VIEWS = (2, 3, 4, 5, 8, 16, 31)


def views(
    *, poses: int = 300, seed: int = 0, kind: str = "room", fields: Fields | None = None
) -> dict[str, Any]:
    """MPJPE in mm for 2 to 31 views; `kind` of rig: room, dome, table (to 16) or stereo (2)."""
    counts = [m for m in VIEWS if m <= {"stereo": 2, "table": 16}.get(kind, 31)]
    rows: dict[str, dict[str, float]] = {}
    notes = []
    for name, noise in NOISES.items():
        for n_views in counts:
            if n_views < (noise.occluded_views or 0):
                continue
            here = scene(noise, poses, seed, kind=kind, n_views=n_views)
            calls: dict[str, Any] = {"DLT": lambda here=here: dlt(here)}
            calls |= {k: lambda m=method, here=here: m(here) for k, method in RANSACS.items()}
            calls["default"] = lambda here=here: default(here, fields=fields).pose
            found, absent = available(calls)
            notes += absent + report.missing(found, here, f"{name}, {n_views} views")
            for method, pose in found.items():
                rows.setdefault(f"{name}, {method}", {})[f"{n_views}"] = report.mpjpe(pose, here)
    return report.figures(
        "MPJPE, mm, by the number of views",
        "detections, method",
        dict(sorted(rows.items(), key=lambda row: list(NOISES).index(row[0].split(",")[0]))),
        notes,
        poses=poses,
        seed=seed,
        source=here.source,
    )

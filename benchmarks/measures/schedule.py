"""Error against the annealing settings, changing one at a time from its default."""

from __future__ import annotations

import contextlib
from typing import Any

import report
from methods import Fields, default
from scenarios import NOISES, Scene, mvor, scene

import skelsplat as sk

VIEWS = (2, 3, 4, 5, 8, 16)
CHANGES: list[Fields] = [
    {},
    {"sigma_mm": 15.0},
    {"sigma_mm": 20.0},
    {"sigma_mm": 25.0},
    {"sigma_mm": 40.0},
    {"sigma_per_noise": None},
    {"sigma_per_noise": 1.5},
    {"sigma_per_noise": 3.0},
    {"sigma_start_mm": 80.0},
    {"sigma_start_mm": 1280.0},
    {"sigma_decay": 0.25},
    {"sigma_decay": 0.75},
    {"max_steps": 3},
    {"max_steps": 10},
    {"max_steps": 200},
    {"step_tolerance": 0.1},
    {"step_tolerance": 0.001},
    {"symmetry_tier": 0},
    {"symmetry_tier": 2},
    {"symmetry_tier": 3},
    {"symmetry_sigma_mm": 8.0},
    {"symmetry_sigma_mm": 30.0},
]


def schedule(*, poses: int = 300, seed: int = 0, fields: Fields | None = None) -> dict[str, Any]:
    """Mean error in mm: room rigs of 2 to 16 views (mean over them), a table rig, MVOR."""
    groups = _groups(poses, seed)
    rows: dict[str, dict[str, float]] = {}
    for change in CHANGES:
        name = ", ".join(f"{k} {v}" for k, v in change.items()) or "default"
        rows[name] = {
            column: sum(_error(here, {**(fields or {}), **change}) for here in scenes) / len(scenes)
            for column, scenes in groups.items()
        }
    notes = [f"room: mean of {VIEWS} views; table: 4 views, a body of a tenth", "MVOR: oracle association"]
    return report.figures(
        "MPJPE, mm, by the settings of the annealing",
        "setting",
        rows,
        notes,
        poses=poses,
        seed=seed,
        source=groups["room, good"][0].source,
    )


def _groups(poses: int, seed: int) -> dict[str, list[Scene]]:
    groups = {
        f"room, {name}": [
            scene(noise, poses, seed, n_views=m) for m in VIEWS if m >= (noise.occluded_views or 0)
        ]
        for name, noise in NOISES.items()
    }
    for name in ("good", "occluded 2"):
        groups[f"table, {name}"] = [scene(NOISES[name], poses, seed, kind="table", n_views=4)]
    with contextlib.suppress(FileNotFoundError):
        groups["MVOR"] = [mvor()]
    return groups


def _error(here: Scene, fields: Fields) -> float:
    result = default(here, fields=fields)
    return float(sk.metrics.mpjpe(result.pose, here.judged))

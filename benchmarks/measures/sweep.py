"""Error against the stated `init_sigma`, for initial poses with a known true one."""

from __future__ import annotations

from typing import Any

import numpy as np
import report
from methods import Fields, available, default
from scenarios import NOISES, louder, scene

from skelsplat import synthetic

RATIOS = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)
STARTS_MM = (25.0, 60.0)
FACTORS = (1, 2)


def sweep(
    *, poses: int = 300, seed: int = 0, noise: str = "good", fields: Fields | None = None
) -> dict[str, Any]:
    """MPJPE in mm by stated over true standard deviation per axis of independent Gaussian starts.

    ``best`` is the ratio with the smallest error, from a parabola through its neighbours in the logarithm.
    """
    rows, notes = {}, []
    for factor in FACTORS:
        here = scene(louder(NOISES[noise], factor), poses, seed)
        for level in STARTS_MM:
            first = synthetic.perturb(here.truth, level, seed=seed + 1)
            found, absent = available(
                {
                    f"{ratio:g}": lambda here=here, first=first, sigma=ratio * level: (
                        default(here, first, init_sigma=sigma, fields=fields).pose
                    )
                    for ratio in RATIOS
                }
            )
            notes += absent
            if len(found) < len(RATIOS):
                continue
            errors = {name: report.mpjpe(pose, here) for name, pose in found.items()}
            where = f"{NOISES[noise].sigma_px * factor:.1f} px, start {level:.0f} mm"
            rows[where] = {**errors, "best": _least(np.array(list(errors.values())))}
    return report.figures(
        f"MPJPE, mm, by init_sigma / true sigma; detections: {noise}",
        "jitter, start",
        rows,
        notes,
        poses=poses,
        seed=seed,
        source=here.source,
    )


def _least(errors: np.ndarray) -> float:
    """Ratio at which the error is least."""
    k = int(np.clip(errors.argmin(), 1, len(errors) - 2))
    if errors.argmin() != k:
        return float(RATIOS[errors.argmin()])
    a, b, _ = np.polyfit(np.log(RATIOS[k - 1 : k + 2]), errors[k - 1 : k + 2], 2)
    return float(np.exp(-b / (2 * a)))

"""Errors of joint angles, and how often they lie within their error bars."""

from __future__ import annotations

from typing import Any

import numpy as np
import recordings
import report
from methods import Fields
from recordings import Take
from scenarios import FloatArray

import skelsplat as sk

# Share of a Gaussian within 1, 2 and 3 standard deviations, in percent.
IDEAL = (68.3, 95.4, 99.7)
CONDITIONS = ("good", "occluded 2", "occluded 3", "heavy")
# Angles whose true value is smaller cannot err downwards.
STRAIGHT_DEG = 10.0
# Limbs closer to the axis through both sides hardly have a flexion: cosine of the true abduction, 60°.
SIDEWAYS = 0.5
COLUMNS = {
    "hip": "hip_flexion",
    "hip abd": "hip_abduction",
    "knee": "knee_flexion",
    "shoulder": "shoulder_flexion",
    "sh abd": "shoulder_abduction",
    "elbow": "elbow_flexion",
    "trunk": "trunk_inclination",
    "pelvis": "pelvis_obliquity",
}


def angles(
    *, takes: int = 24, frames: int = 200, seed: int = 0, fast: bool = False, fields: Fields | None = None
) -> dict[str, Any]:
    """Mean absolute errors in degrees, frame by frame and over time, and coverage at 1, 2, 3 σ in percent.

    At most `frames` of each of `takes` recordings at 30 Hz in four views, without confidences; with `fast`
    three takes of one condition.
    """
    rows: dict[str, dict[str, float]] = {}
    straight = []
    for condition in CONDITIONS[:1] if fast else CONDITIONS:
        found = recordings.takes(condition, count=3 if fast else takes, most_frames=frames, seed=seed)
        for name, over_time in (("single", False), ("over time", True)):
            pairs = [_errors(take, over_time=over_time, fields=fields) for take in found]
            names = pairs[0][0].names
            true, error, sigma = (
                np.concatenate(parts) for parts in zip(*((t.degrees, e, s) for t, e, s in pairs), strict=True)
            )
            rows[f"{condition}, {name}"] = _row(names, error, sigma)
            straight.append(f"{condition}, {name}: {_straight(names, true, error, sigma)}")
    notes = [
        f"ideal coverage {', '.join(map(str, IDEAL))}; the error bars are the scatter, since the simulated "
        "detector has no systematic error",
        "hip, shoulder: flexion, where the true abduction is below 60°; abd: abduction; trunk: inclination",
        f"knees and elbows truly bent by less than {STRAIGHT_DEG:g}°, mean error and coverage: "
        + "; ".join(straight),
    ]
    title = "Joint angles: mean absolute error in degrees, and coverage in %"
    return report.figures(title, "detections", rows, notes, takes=len(found), frames=len(true), seed=seed)


def _errors(
    take: Take, *, over_time: bool, fields: Fields | None
) -> tuple[sk.JointAngles, FloatArray, FloatArray]:
    """Return the true angles of a take, the errors and the standard deviations (T, A), in degrees."""
    scene, config = take.scene, sk.RefineConfig(**(fields or {}))
    detections = scene.detections.copy()
    detections[..., 2] = np.where(scene.detected, 1.0, 0.0)
    if over_time:
        result = sk.refine_sequence(detections, scene.rig, fps=take.fps, layout=scene.layout, config=config)
    else:
        result = sk.refine(None, detections, scene.rig, layout=scene.layout, config=config)
    found = sk.joint_angles(result, layout=scene.layout, uncertainty=result.uncertainty)
    true = sk.joint_angles(scene.truth, layout=scene.layout)
    error = (found.degrees - true.degrees + 180.0) % 360.0 - 180.0
    for k, name in enumerate(found.names):
        if name.endswith(("hip_flexion", "shoulder_flexion")):
            aside = np.cos(np.radians(true[name.replace("flexion", "abduction")])) < SIDEWAYS
            error[aside, k] = np.nan
    return true, error, found.sigma


def _straight(names: tuple[str, ...], true: FloatArray, error: FloatArray, sigma: FloatArray) -> str:
    """Return the mean error and the coverage of limbs that are nearly straight, in words."""
    bent = [k for k, angle in enumerate(names) if angle.endswith(("knee_flexion", "elbow_flexion"))]
    small = (true[:, bent] < STRAIGHT_DEG) & np.isfinite(error[:, bent])
    if not small.any():
        return "none"
    ratio = np.abs(error / sigma)[:, bent][small]
    shares = " / ".join(f"{100 * np.mean(ratio <= k):.0f}" for k in (1, 2, 3))
    return f"{error[:, bent][small].mean():+.1f}°, {shares} %"


def _row(names: tuple[str, ...], error: FloatArray, sigma: FloatArray) -> dict[str, float]:
    of = {head: [k for k, name in enumerate(names) if name.endswith(end)] for head, end in COLUMNS.items()}
    row = {head: float(np.nanmean(np.abs(error[:, columns]))) for head, columns in of.items()}
    ratio = np.abs(error / sigma)
    ratio = ratio[np.isfinite(ratio)]
    return row | {f"{k} σ": float(100 * np.mean(ratio <= k)) for k in (1, 2, 3)}

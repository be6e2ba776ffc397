"""The population's bones in single frames: error with and without, other bodies, joints in one view."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import report
from methods import Fields, default
from recordings import noise as recorded
from scenarios import NOISES, FloatArray, Scene, scene

import skelsplat as sk
from skelsplat import synthetic

# Occluded as in recordings; the figures of DESIGN §7 are of these.
CONDITIONS = ("good", "occluded 2", "occluded 3", "heavy")
# Bodies: factor on the whole body, and on forearms and shanks.
BODIES = {"1.75 m": (1.0, 1.0), "0.9 m": (0.51, 1.0), "2.1 m": (1.2, 1.0), "long limbs": (1.0, 1.1)}
LIMBS = ((12, 13), (15, 16), (5, 6), (2, 3))
FREE = {"bones": "free"}


def bones(*, poses: int = 300, seed: int = 0, fields: Fields | None = None) -> dict[str, Any]:
    """Mean error in mm, bones free and with those of the population, and 1, 2, 3 σ coverage with them."""
    rows: dict[str, dict[str, Any]] = {}
    clean = scene("good", poses, seed)
    for condition in CONDITIONS:
        detector = replace(recorded(condition, 4, 30.0), memory=None)
        rows[condition] = compared(seen(clean, detector, seed), fields)
    for name, (size, limbs) in list(BODIES.items())[1:]:
        for condition in ("good", "occluded 3"):
            detector = replace(recorded(condition, 4, 30.0), memory=None)
            body = replace(clean, truth=shaped(clean.truth, size, limbs))
            rows[f"{name}, {condition}"] = compared(seen(body, detector, seed), fields)
    for views in ((0, 2), (0, 1)):
        rows[f"good, views {views}"] = compared(of_views(seen(clean, NOISES["good"], seed), views), fields)
    single, at = one_view(seen(clean, NOISES["good"], seed), seed)
    result = default(single, fields=fields)
    error = np.linalg.norm(result.pose[at] - single.truth[at], axis=-1)
    for status in ("inferred", "weak"):
        of = result.joint_status[at] == status
        mean = float(error[of].mean()) if of.any() else None
        inside = covered(result.pose[at][of], result.uncertainty[at][of], single.truth[at][of])
        rows[f"one view: {status}, {of.sum()}"] = {"free": None, "population": mean, **inside}
    notes = [
        "one view: a wrist, elbow or ankle that one of four views detects; without bones it has no position"
    ]
    return report.figures(
        "Bones, mean error in mm", "detections", rows, notes, poses=poses, source=clean.source
    )


def seen(here: Scene, detector: synthetic.DetectionNoise, seed: int) -> Scene:
    """Return the scene with detections of this detector, every frame by itself."""
    found = synthetic.simulate_detections(here.truth, here.rig, noise=detector, layout=here.layout, seed=seed)
    found[..., 2] = np.where(np.isfinite(found[..., 0]), 1.0, 0.0)
    return replace(here, detections=found)


def shaped(truth: FloatArray, size: float, limbs: float) -> FloatArray:
    """Return the bodies scaled, with forearms and shanks longer by a factor."""
    out = truth * size
    for middle, end in LIMBS:
        out[:, end] = out[:, middle] + limbs * (out[:, end] - out[:, middle])
    return out


def of_views(here: Scene, views: tuple[int, ...]) -> Scene:
    rig = sk.CameraRig([here.rig[i] for i in views], unit=here.rig.unit)
    return replace(here, rig=rig, detections=here.detections[:, list(views)])


def one_view(here: Scene, seed: int) -> tuple[Scene, tuple[Any, Any]]:
    """Leave one joint of every frame to one view; return the scene and (frames, joints)."""
    rng = np.random.default_rng(seed)
    frames = np.arange(len(here.truth))
    joints = rng.choice([3, 6, 12, 13, 15, 16], size=len(frames))
    view = rng.integers(len(here.rig), size=len(frames))
    detections = here.detections.copy()
    kept = detections[frames, view, joints].copy()
    detections[frames, :, joints] = np.nan
    detections[frames, view, joints] = kept
    return replace(here, detections=detections), (frames, joints)


def compared(here: Scene, fields: Fields | None) -> dict[str, Any]:
    free, population = default(here, fields={**(fields or {}), **FREE}), default(here, fields=fields)
    return {
        "free": report.mpjpe(free.pose, here),
        "population": report.mpjpe(population.pose, here),
        **covered(population.pose, population.uncertainty, here.judged),
    }


def covered(pose: FloatArray, uncertainty: FloatArray, truth: FloatArray) -> dict[str, float | None]:
    """Share of errors within 1, 2 and 3 σ, %."""
    off = truth - pose
    known = np.isfinite(off).all(axis=-1) & np.isfinite(uncertainty).all(axis=(-2, -1))
    if not known.any():
        return {f"{k} σ %": None for k in (1, 2, 3)}
    square = np.einsum("ni,nij,nj->n", off[known], np.linalg.inv(uncertainty[known]), off[known])
    return {f"{k} σ %": float(100 * (square < k * k).mean()) for k in (1, 2, 3)}

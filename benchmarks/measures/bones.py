"""The population's bones in single frames, and the settings of the annealing."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from typing import Any

import numpy as np
from lab import Table, about
from methods import Fields, default, mpjpe
from recordings import noise as recorded
from scenarios import NOISES, FloatArray, Scene, mvor, scene

import skelsplat as sk
from skelsplat import synthetic

# Occluded as in recordings.
CONDITIONS = ("good", "occluded 2", "occluded 3", "heavy")
# Bodies: factor on the whole body, and on forearms and shanks.
BODIES = {"0.9 m": (0.51, 1.0), "2.1 m": (1.2, 1.0), "long limbs": (1.0, 1.1)}
LIMBS = ((12, 13), (15, 16), (5, 6), (2, 3))
# Knees, ankles, elbows and wrists that are left to one view.
SINGLE = [3, 6, 12, 13, 15, 16]
VIEWS = (2, 3, 4, 5, 8, 16)
CHANGES: list[Fields] = [
    {},
    *({"sigma_mm": value} for value in (15.0, 20.0, 25.0, 40.0)),
    *({"sigma_per_noise": value} for value in (None, 1.5, 3.0)),
    *({"sigma_start_mm": value} for value in (80.0, 1280.0)),
    *({"sigma_decay": value} for value in (0.25, 0.75)),
    *({"max_steps": value} for value in (3, 10, 200)),
    *({"step_tolerance": value} for value in (0.1, 0.001)),
    *({"symmetry_tier": value} for value in (0, 2, 3)),
    *({"symmetry_sigma_mm": value} for value in (8.0, 30.0)),
]


def bones(*, poses: int = 300, seed: int = 0, fields: Fields | None = None) -> Table:
    """Mean error in mm, bones free and with those of the population, and 1, 2, 3 σ coverage with them."""
    rows: dict[str, dict[str, Any]] = {}
    clean = scene("good", poses, seed)

    def compared(here: Scene) -> dict[str, Any]:
        free = default(here, fields={**(fields or {}), "bones": "free"})
        population = default(here, fields=fields)
        both = {"free": mpjpe(free.pose, here), "population": mpjpe(population.pose, here)}
        return both | _covered(population.pose, population.uncertainty, here.judged)

    for condition in CONDITIONS:
        rows[condition] = compared(_seen(clean, _detector(condition), seed))
    for name, (size, limbs) in BODIES.items():
        for condition in ("good", "occluded 3"):
            body = replace(clean, truth=_shaped(clean.truth, size, limbs))
            rows[f"{name}, {condition}"] = compared(_seen(body, _detector(condition), seed))
    good = _seen(clean, NOISES["good"], seed)
    for views in ((0, 2), (0, 1)):
        cameras = sk.CameraRig([good.rig[i] for i in views], unit=good.rig.unit)
        rows[f"good, views {views}"] = compared(
            replace(good, rig=cameras, detections=good.detections[:, list(views)])
        )
    single, at = _one_view(good, seed)
    result = default(single, fields=fields)
    error = np.linalg.norm(result.pose[at] - single.truth[at], axis=-1)
    for status in ("inferred", "weak"):
        of = result.joint_status[at] == status
        mean = float(error[of].mean()) if of.any() else None
        inside = _covered(result.pose[at][of], result.uncertainty[at][of], single.truth[at][of])
        rows[f"one view: {status}, {of.sum()}"] = {"free": None, "population": mean, **inside}
    notes = [
        "one view: a wrist, elbow or ankle that one of four views detects; without bones it has no position",
        about(poses=poses, source=clean.source),
    ]
    return Table.of("Bones, mean error in mm", "detections", rows, notes)


def _detector(condition: str) -> synthetic.DetectionNoise:
    """Return the detector of a recording, every frame by itself."""
    return replace(recorded(condition, 4, 30.0), memory=None)


def _seen(here: Scene, detector: synthetic.DetectionNoise, seed: int) -> Scene:
    found = synthetic.simulate_detections(here.truth, here.rig, noise=detector, layout=here.layout, seed=seed)
    found[..., 2] = np.where(np.isfinite(found[..., 0]), 1.0, 0.0)
    return replace(here, detections=found)


def _shaped(truth: FloatArray, size: float, limbs: float) -> FloatArray:
    """Return the bodies scaled, with forearms and shanks longer by a factor."""
    out = truth * size
    for middle, end in LIMBS:
        out[:, end] = out[:, middle] + limbs * (out[:, end] - out[:, middle])
    return out


def _one_view(here: Scene, seed: int) -> tuple[Scene, tuple[Any, Any]]:
    """Leave one joint of every frame to one view; return the scene and (frames, joints)."""
    rng = np.random.default_rng(seed)
    frames = np.arange(len(here.truth))
    joints = rng.choice(SINGLE, size=len(frames))
    view = rng.integers(len(here.rig), size=len(frames))
    detections = here.detections.copy()
    kept = detections[frames, view, joints].copy()
    detections[frames, :, joints] = np.nan
    detections[frames, view, joints] = kept
    return replace(here, detections=detections), (frames, joints)


def _covered(pose: FloatArray, uncertainty: FloatArray, truth: FloatArray) -> dict[str, float | None]:
    """Share of errors within 1, 2 and 3 σ, %."""
    off = truth - pose
    known = np.isfinite(off).all(axis=-1) & np.isfinite(uncertainty).all(axis=(-2, -1))
    if not known.any():
        return {f"{k} σ %": None for k in (1, 2, 3)}
    square = np.einsum("ni,nij,nj->n", off[known], np.linalg.inv(uncertainty[known]), off[known])
    return {f"{k} σ %": float(100 * (square < k * k).mean()) for k in (1, 2, 3)}


def schedule(*, poses: int = 300, seed: int = 0, fields: Fields | None = None) -> Table:
    """Mean error in mm, changing one setting: room rigs of 2 to 16 views, a table rig, MVOR."""
    groups: dict[str, list[Scene]] = {}
    for name, noise in NOISES.items():
        views = [m for m in VIEWS if m >= (noise.occluded_views or 0)]
        groups[f"room, {name}"] = [scene(noise, poses, seed, n_views=m) for m in views]
    for name in ("good", "occluded 2"):
        groups[f"table, {name}"] = [scene(NOISES[name], poses, seed, kind="table", n_views=4)]
    with contextlib.suppress(FileNotFoundError):
        groups["MVOR"] = [mvor()]
    rows: dict[str, dict[str, float]] = {}
    for change in CHANGES:
        name = ", ".join(f"{k} {v}" for k, v in change.items()) or "default"
        own = {**(fields or {}), **change}
        rows[name] = {
            column: sum(mpjpe(default(here, fields=own).pose, here) for here in scenes) / len(scenes)
            for column, scenes in groups.items()
        }
    notes = [
        f"room: mean of {VIEWS} views; table: 4 views, a body of a tenth",
        "MVOR: oracle association",
        about(poses=poses, seed=seed, source=groups["room, good"][0].source),
    ]
    return Table.of("MPJPE, mm, by the settings of the annealing", "setting", rows, notes)

"""Errors of the methods by noise, with left–right swaps, and with and without the population's bones."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from lab import Table
from recordings import CONDITIONS, noise, unsure
from scenarios import NOISES, FloatArray, Scene, covered, missing, scene

import skelsplat as sk
from skelsplat import synthetic

START_MM = 40.0  # MPJPE of the fused monocular start
SWAPPED = replace(NOISES["good"], limb_swap_rate=0.05, view_swap_rate=0.02)
# Bodies: factor on the whole body, and on forearms and shanks.
BODIES = {"0.9 m": (0.51, 1.0), "long limbs": (1.0, 1.1)}
LIMBS = ((12, 13), (15, 16), (5, 6), (2, 3))
SINGLE = [3, 6, 12, 13, 15, 16]  # knees, ankles, elbows and wrists that are left to one view
TRIANGULATIONS = ("ransac-iskakov", "ransac-adafuse")


def table(*, poses: int = 300, seed: int = 0, n_seeds: int = 3, fast: bool = False) -> Table:
    """MPJPE in mm of all methods; `fast` omits the paper's."""
    rows, notes = {}, []
    for name in NOISES:
        here = scene(name, poses, seed, n_seeds=n_seeds)
        start = monocular_start(here, seed)
        error = start - here.truth
        # Of every joint about zero, as for an unbiased initial pose.
        spread = np.einsum("tni,tnj->nij", error, error) / len(error)
        found = {"dlt": here.dlt(), **{method: here.solved(method) for method in TRIANGULATIONS}}
        if not fast:
            config = sk.RefineConfig.paper()
            found["paper, DLT"] = here.refined(found["dlt"], config).pose
            found["paper, start"] = here.refined(start, config).pose
        found["default"] = here.refined().pose
        found["with covar."] = here.refined(start, init_sigma=spread).pose
        rows[name] = {column: here.mpjpe(pose) for column, pose in found.items()}
        notes += missing(found, here, name)
        notes.append(f"{name}: start {here.mpjpe(start):.1f} mm")
    title = "MPJPE, mm (joints that at least two views detect)"
    return Table.of(title, "detections", rows, [*notes, here.source])


def monocular_start(here: Scene, seed: int) -> FloatArray:
    """Fuse simulated monocular poses, with noise that gives the fused pose an MPJPE of `START_MM`."""
    sigma = START_MM
    for _ in range(4):
        poses = synthetic.monocular_poses(here.truth, here.rig, sigma, seed=seed)
        start = sk.fuse_monocular(poses, here.detections, here.rig)
        sigma *= START_MM / float(sk.metrics.mpjpe(start, here.truth))
    return start


def swaps(*, poses: int = 300, seed: int = 0) -> Table:
    """MPJPE in mm at all joints and at those swapped in some view; swaps reported, correct and false.

    Counts are of (frame, view, joint). In the clean detections every report is false.
    """
    clean, swapped = scene("good", poses, seed), scene(SWAPPED, poses, seed)
    differ = ~np.isclose(clean.detections, swapped.detections, equal_nan=True).all(axis=-1)

    rows: dict[str, dict[str, Any]] = {}
    for where, here, true in (("clean", clean, np.zeros_like(differ)), ("swapped", swapped, differ)):
        for find in (False, True):
            result = here.refined(config=sk.RefineConfig(find_swaps=find))
            each = sk.metrics.mpjpe(result.pose, here.judged, reduce="none")
            rows[f"{where}, find_swaps={find}"] = {
                "all joints": float(np.nanmean(each)),
                "swapped joints": float(np.nanmean(each[differ.any(axis=1)])),
                "true": int(true.sum()),
                "found": int((result.swapped & true).sum()),
                "wrong": int((result.swapped & ~true).sum()),
            }
    rates = f"limbs {SWAPPED.limb_swap_rate}, views {SWAPPED.view_swap_rate} per frame; else as 'good'"
    return Table.of("Swaps of left and right, MPJPE in mm", "detections, method", rows, [rates, clean.source])


def bones(*, poses: int = 300, seed: int = 0) -> Table:
    """Mean error in mm, bones free and with those of the population, and 1, 2, 3 σ coverage with them."""
    rows: dict[str, dict[str, Any]] = {}
    clean = scene("good", poses, seed)

    def compared(here: Scene) -> dict[str, Any]:
        free = here.refined(config=sk.RefineConfig(bones="free"))
        population = here.refined()
        both = {"free": here.mpjpe(free.pose), "population": here.mpjpe(population.pose)}
        return both | covered(population.pose, population.uncertainty, here.judged)

    for condition in CONDITIONS:
        rows[condition] = compared(_seen(clean, _detector(condition), seed))
    for name, (size, limbs) in BODIES.items():
        body = replace(clean, truth=_shaped(clean.truth, size, limbs))
        rows[f"{name}, occluded 3"] = compared(_seen(body, _detector("occluded 3"), seed))
    good = _seen(clean, NOISES["good"], seed)
    two = sk.CameraRig([good.rig[0], good.rig[2]], unit=good.rig.unit)
    rows["good, views [0, 2]"] = compared(replace(good, rig=two, detections=good.detections[:, [0, 2]]))
    single, at = _one_view(good, seed)
    result = single.refined()
    error = np.linalg.norm(result.pose[at] - single.truth[at], axis=-1)
    for status in ("inferred", "weak"):
        of = result.joint_status[at] == status
        inside = covered(result.pose[at][of], result.uncertainty[at][of], single.truth[at][of])
        mean = float(error[of].mean()) if of.any() else None
        rows[f"one view: {status}, {of.sum()}"] = {"free": None, "population": mean, **inside}
    notes = [
        "one view: a wrist, elbow or ankle that one of four views detects; without bones it has no position",
        clean.source,
    ]
    return Table.of("Bones, mean error in mm", "detections", rows, notes)


def _detector(condition: str) -> synthetic.DetectionNoise:
    """Return the detector of a recording, every frame by itself."""
    return replace(noise(condition, 4, 30.0), memory=None)


def _seen(here: Scene, detector: synthetic.DetectionNoise, seed: int) -> Scene:
    found = synthetic.simulate_detections(here.truth, here.rig, noise=detector, layout=here.layout, seed=seed)
    return unsure(replace(here, detections=found))


def _shaped(truth: FloatArray, size: float, limbs: float) -> FloatArray:
    """Return the bodies scaled, with forearms and shanks longer by a factor."""
    out = truth * size
    for middle, end in LIMBS:
        out[:, end] = out[:, middle] + limbs * (out[:, end] - out[:, middle])
    return out


def _one_view(here: Scene, seed: int) -> tuple[Scene, tuple[Any, Any]]:
    """Leave one joint of every frame to one view; return the scene and (frames, joints)."""
    rng, frames = np.random.default_rng(seed), np.arange(len(here.truth))
    joints = rng.choice(SINGLE, size=len(frames))
    view = rng.integers(len(here.rig), size=len(frames))
    detections = here.detections.copy()
    kept = detections[frames, view, joints].copy()
    detections[frames, :, joints] = np.nan
    detections[frames, view, joints] = kept
    return replace(here, detections=detections), (frames, joints)

"""Errors of the methods: by noise, start, number of views, swaps, a useless camera and stated sigma."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from lab import Table, about
from methods import (
    RANSACS,
    Fields,
    default,
    dlt,
    missing,
    monocular_start,
    mpjpe,
    paper,
    triangulations,
)
from scenarios import NOISES, FloatArray, Scene, louder, rig, scene

import skelsplat as sk
from skelsplat import synthetic

# MPJPE of the fused monocular start.
START_MM = 40.0
LEVELS_MM = (0, 10, 20, 40, 60, 80, 100, 200, 400)
VIEWS = (2, 3, 4, 5, 8, 16, 31)
SWAPPED = replace(NOISES["good"], limb_swap_rate=0.05, view_swap_rate=0.02)
RATIOS = (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0)
STARTS_MM = (25.0, 60.0)
FACTORS = (1, 2)
OFFSET_PX = np.array([60.0, -80.0])
# A useless detector has the confidences of a good one.
CONFIDENCE = 0.9
# Jitter of a useless detector, px.
JITTER_PX = 2.3


def table(
    *,
    poses: int = 300,
    seed: int = 0,
    n_seeds: int = 3,
    fast: bool = False,
    fields: Fields | None = None,
    kind: str = "room",
    n_views: int = 4,
) -> Table:
    """MPJPE in mm of all methods; `fast` omits the paper's and RANSAC Iskakov."""
    rows, notes = {}, []
    for name, noise in NOISES.items():
        here = scene(noise, poses, seed, kind=kind, n_views=n_views, n_seeds=n_seeds)
        start = monocular_start(here, START_MM, seed)
        error = start - here.truth
        sigma = float(np.sqrt(np.nanmean(error**2)))
        # Of every joint about zero, as for an unbiased initial pose.
        spread = np.einsum("tni,tnj->nij", error, error) / len(error)
        found = {column: method(here) for column, method in triangulations(fast=fast).items()}
        if not fast:
            found["paper, DLT"], found["paper, start"] = paper(here).pose, paper(here, start).pose
        found["default"] = default(here, fields=fields).pose
        found["from start"] = default(here, start, fields=fields).pose
        found["with sigma"] = default(here, start, init_sigma=sigma, fields=fields).pose
        found["with covar."] = default(here, start, init_sigma=spread, fields=fields).pose
        rows[name] = {column: mpjpe(pose, here) for column, pose in found.items()}
        axes = ", ".join(f"{s:.1f}" for s in np.sqrt(np.diagonal(spread.mean(axis=0))))
        notes += missing(found, here, name)
        notes.append(
            f"{name}: start {mpjpe(start, here):.1f} mm, {sigma:.1f} mm per axis ({axes} on x, y, z)"
        )
    notes.append(about(poses=len(here.truth), seeds=f"{seed} to {seed + n_seeds - 1}", source=here.source))
    return Table.of("MPJPE, mm (joints that at least two views detect)", "detections", rows, notes)


def start(
    *, poses: int = 300, seed: int = 0, noise: str = "good", fast: bool = False, fields: Fields | None = None
) -> Table:
    """MPJPE in mm from DLT plus Gaussian noise per axis; `fast` omits the paper's method."""
    here = scene(noise, poses, seed)
    triangulated = dlt(here)
    rows: dict[str, dict[str, float]] = {}
    notes = []
    for level in LEVELS_MM:
        first = synthetic.perturb(triangulated, level, seed=seed + 1)
        found = {"start": first}
        if not fast:
            found["paper"] = paper(here, first).pose
        found["default"] = default(here, first, fields=fields).pose
        notes += missing(found, here, f"{level} mm")
        for name, pose in found.items():
            rows.setdefault(name, {})[f"{level}"] = mpjpe(pose, here)
    title = f"MPJPE, mm, by noise on the start, mm per axis; detections: {noise}"
    return Table.of(title, "method", rows, [*notes, about(poses=poses, seed=seed, source=here.source)])


def views(*, poses: int = 300, seed: int = 0, kind: str = "room", fields: Fields | None = None) -> Table:
    """MPJPE in mm for 2 to 31 views; `kind` of rig: room, dome, table (to 16) or stereo (2)."""
    counts = [m for m in VIEWS if m <= {"stereo": 2, "table": 16}.get(kind, 31)]
    rows: dict[str, dict[str, float]] = {}
    notes = []
    for name, noise in NOISES.items():
        for n_views in counts:
            if n_views < (noise.occluded_views or 0):
                continue
            here = scene(noise, poses, seed, kind=kind, n_views=n_views)
            found = {column: method(here) for column, method in {"DLT": dlt, **RANSACS}.items()}
            found["default"] = default(here, fields=fields).pose
            notes += missing(found, here, f"{name}, {n_views} views")
            for method, pose in found.items():
                rows.setdefault(f"{name}, {method}", {})[f"{n_views}"] = mpjpe(pose, here)
    notes.append(about(poses=poses, seed=seed, source=here.source))
    return Table.of("MPJPE, mm, by the number of views", "detections, method", rows, notes)


def swaps(*, poses: int = 300, seed: int = 0, fields: Fields | None = None) -> Table:
    """MPJPE in mm at all joints and at those swapped in some view; swaps reported, correct and false.

    Counts are of (frame, view, joint). The clean detections differ only in having no swaps, so every
    report there is false.
    """
    clean, swapped = scene("good", poses, seed), scene(SWAPPED, poses, seed)
    differ = ~np.isclose(clean.detections, swapped.detections, equal_nan=True).all(axis=-1)

    def errors(pose: FloatArray, here: Scene) -> dict[str, float]:
        each = sk.metrics.mpjpe(pose, here.judged, reduce="none")
        at_swaps = float(np.nanmean(each[differ.any(axis=1)]))
        return {"all joints": float(np.nanmean(each)), "swapped joints": at_swaps}

    rows: dict[str, dict[str, Any]] = {}
    for where, here, true in (("clean", clean, np.zeros_like(differ)), ("swapped", swapped, differ)):
        for name, method in {"DLT": dlt, **RANSACS}.items():
            rows[f"{where}, {name}"] = errors(method(here), here)
        for find in (False, True):
            result = default(here, fields={**(fields or {}), "find_swaps": find})
            flagged = result.swapped
            rows[f"{where}, find_swaps={find}"] = errors(result.pose, here) | {
                "true": int(true.sum()),
                "found": int((flagged & true).sum()),
                "wrong": int((flagged & ~true).sum()),
                "flagged views": int(flagged.any(axis=-1).sum()),
            }
    notes = [
        f"limbs {SWAPPED.limb_swap_rate}, views {SWAPPED.view_swap_rate} per frame; else as 'good'",
        "counts: (frame, view, joint); flagged views: (frame, view) with any",
        about(poses=poses, seed=seed, source=clean.source),
    ]
    return Table.of("Swaps of left and right, MPJPE in mm", "detections, method", rows, notes)


def useless(*, poses: int = 300, seed: int = 0, fast: bool = False, fields: Fields | None = None) -> Table:
    """Effect of a fifth camera with only wrong detections on the result of four good ones, mm."""
    four = scene("good", poses, seed)
    methods = triangulations(fast=fast)
    if not fast:
        methods["paper"] = lambda s: paper(s).pose
    methods["default"] = lambda s: default(s, fields=fields).pose
    before = {name: method(four) for name, method in methods.items()}
    rng = np.random.default_rng(seed + 1)
    camera = list(rig("room", 5))[4]
    true = sk.project(four.truth, [camera])[0]
    noisy = true + rng.normal(0.0, JITTER_PX, true.shape)
    wrong = {
        "uniform": rng.uniform(0.0, camera.size, size=true.shape),
        "offset 100 px": noisy + OFFSET_PX,
        "another pose": np.roll(noisy, 1, axis=0),
    }
    rows = {}
    for kind, pixels in wrong.items():
        fifth = np.concatenate([pixels, np.full((*pixels.shape[:-1], 1), CONFIDENCE)], axis=-1)
        detections = np.concatenate([four.detections, fifth[:, None]], axis=1)
        five = replace(four, detections=detections, rig=rig("room", 5))
        for name, pose in before.items():
            after = methods[name](five)
            moved = np.linalg.norm(after - pose, axis=-1)
            rows[f"{name}: {kind}"] = {
                "change, median": float(np.nanmedian(moved)),
                "mean": float(np.nanmean(moved)),
                "95 %": float(np.nanpercentile(moved, 95)),
                "MPJPE, 4 views": mpjpe(pose, four),
                "MPJPE, 5 views": mpjpe(after, four),
            }
    notes = [about(poses=poses, seed=seed, source=four.source)]
    return Table.of("A fifth view that is all wrong, mm", "method: detections of the fifth view", rows, notes)


def sweep(*, poses: int = 300, seed: int = 0, noise: str = "good", fields: Fields | None = None) -> Table:
    """MPJPE in mm by stated over true standard deviation per axis of independent Gaussian starts.

    ``best`` is the ratio with the smallest error, from a parabola through its neighbours in the logarithm.
    """
    rows = {}
    for factor in FACTORS:
        here = scene(louder(NOISES[noise], factor), poses, seed)
        for level in STARTS_MM:
            first = synthetic.perturb(here.truth, level, seed=seed + 1)
            errors = {
                f"{ratio:g}": mpjpe(default(here, first, init_sigma=ratio * level, fields=fields).pose, here)
                for ratio in RATIOS
            }
            where = f"{NOISES[noise].sigma_px * factor:.1f} px, start {level:.0f} mm"
            rows[where] = {**errors, "best": _least(np.array(list(errors.values())))}
    title = f"MPJPE, mm, by init_sigma / true sigma; detections: {noise}"
    return Table.of(title, "jitter, start", rows, [about(poses=poses, seed=seed, source=here.source)])


def _least(errors: np.ndarray) -> float:
    """Ratio at which the error is least."""
    k = int(np.clip(errors.argmin(), 1, len(errors) - 2))
    if errors.argmin() != k:
        return float(RATIOS[errors.argmin()])
    a, b, _ = np.polyfit(np.log(RATIOS[k - 1 : k + 2]), errors[k - 1 : k + 2], 2)
    return float(np.exp(-b / (2 * a)))

"""Error bars: how often errors lie within them, of positions and of angles."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import recordings
from lab import Table, about
from recordings import CONDITIONS, Take
from scenarios import NOISES, POSES, Fields, FloatArray, covered, mvor, scene

import skelsplat as sk
from skelsplat.evaluation.scores import offsets

# Share of a Gaussian in three dimensions within 1, 2 and 3 standard deviations, in percent.
IDEAL = np.array([19.9, 73.9, 97.1])
VIEWS = (3, 4, 8)
# MVOR's labels are good to ±50 mm in space, which is this per axis.
LABEL_SIGMA_MM = 30.0
SIGMAS_PX = (1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0)
# Angles whose true value is smaller cannot err downwards.
STRAIGHT_DEG = 10.0
# Limbs closer to the axis through both sides hardly have a flexion: cosine of the true abduction, 60°.
SIDEWAYS = 0.5
ANGLES = {
    "hip": "hip_flexion",
    "hip abd": "hip_abduction",
    "knee": "knee_flexion",
    "shoulder": "shoulder_flexion",
    "sh abd": "shoulder_abduction",
    "elbow": "elbow_flexion",
    "trunk": "trunk_inclination",
    "pelvis": "pelvis_obliquity",
}


def coverage(*, poses: int = 300, seed: int = 0, fields: Fields | None = None) -> Table:
    """Coverage in percent at 1, 2, 3 σ, and errors."""
    rows = {}
    for name in ("good", "occluded 2"):
        for n_views in VIEWS:
            for factor in (1, 2):
                noise = replace(NOISES[name], sigma_px=factor * NOISES[name].sigma_px)
                here = scene(noise, poses, seed, n_views=n_views)
                where = f"{name}, {n_views}v, {noise.sigma_px:.1f}px"
                result = here.refined(fields=fields)
                inside = covered(result.pose, result.uncertainty, here.judged)
                deviation = float(np.abs(np.array(list(inside.values())) - IDEAL).max())
                rows[where] = inside | {"deviation": deviation, "MPJPE": here.mpjpe(result.pose)}
    notes = [
        "rows: detections, views, jitter",
        about(poses=poses, seed=seed, source=here.source),
    ]
    return Table.of("Coverage, % (ideal 19.9, 73.9, 97.1), and errors, mm", "detections", rows, notes)


def coverage_real(
    *, detector: str = "openpose", poses: int = 300, seed: int = 0, fields: Fields | None = None
) -> Table:
    """Measure which percentage of errors scatter and error bar cover, on MVOR and in a simulation.

    The labels' variance is added to every covariance. An offset is the mean error of a joint over all people;
    taking it out uses the labels, and shows what remains beyond a constant difference of definition.
    """
    here = scene(NOISES["good"], poses, seed, n_views=3)
    rows = {"simulated, 3 views": _both(here.refined(fields=fields), here.judged, 0.0)}
    real = mvor(detector)
    result = real.refined(fields=fields)
    hips = np.array([name.endswith("hip") for name in sk.layouts.COCO17.joints])[:, None]
    seen = real.detected.sum(axis=1)[..., None]
    parts = {
        "all": real.judged,
        "without hips": np.where(hips, np.nan, real.judged),
        "three views": np.where(seen < 3, np.nan, real.judged),
        "one view": np.where(seen == 1, real.truth, np.nan),
    }
    for name, truth in parts.items():
        rows[f"MVOR, {name}"] = _both(result, truth, LABEL_SIGMA_MM)
        moved = truth + offsets(result.pose - truth)
        rows[f"MVOR, {name}, offsets out"] = _both(result, moved, LABEL_SIGMA_MM)
    rows["MVOR, without hips, labels exact"] = _both(result, parts["without hips"], 0.0)
    notes = [
        f"ideal 19.9, 73.9, 97.1; labels of MVOR: {LABEL_SIGMA_MM:g} mm per axis, added to the covariances",
        _label_scatter(real.truth),
        "the simulated detector has no systematic error, so the error bar is too wide there",
        "offsets out: the mean error of each joint, which only the labels show, is subtracted",
        about(poses=poses, seed=seed, source=real.source),
    ]
    return Table.of("Coverage of scatter and error bar, %", "", rows, notes)


def _label_scatter(truth: FloatArray) -> str:
    """Return what the labels err by per axis, if a person's left and right arms are equally long."""
    names, found = sk.layouts.COCO17.joints, []
    for ends in (("shoulder", "elbow"), ("elbow", "wrist")):
        sides = ([names.index(f"{side}_{end}") for end in ends] for side in ("left", "right"))
        left, right = (np.linalg.norm(np.diff(truth[:, limb], axis=1)[:, 0], axis=-1) for limb in sides)
        apart = np.abs(left - right)[np.isfinite(left - right)]  # of four points
        found += [np.median(apart) / 0.6745 / 2, np.percentile(apart, 95) / 1.96 / 2]
    numbers = "median {:.0f}, 95 % {:.0f} of upper arms; {:.0f}, {:.0f} of forearms".format(*found)
    return f"σ per axis in mm by which left and right of the labels differ: {numbers}"


def _both(result: sk.Refinement, truth: FloatArray, label_sigma_mm: float) -> dict[str, float | None]:
    """Coverage by scatter and by error bar, with labels that err by so much per axis."""
    labels = label_sigma_mm**2 * np.eye(3)
    inside = covered(result.pose, result.uncertainty + labels, truth, "scatter ")
    inside |= covered(result.pose, result.error_bar + labels, truth, "error bar ")
    error = sk.metrics.mpjpe(result.pose, truth, reduce="none")
    return inside | {"joints": int(np.isfinite(error).sum()), "MPJPE": float(np.nanmean(error))}


def gaussian(*, poses: int = 200, seed: int = 0, fields: Fields | None = None) -> Table:
    """MPJPE in mm of DLT with confidence and of the default, their ratio, and coverage of the error bars.

    Independent normal noise on both axes; every confidence is 1. Coverage is of the joints that are ok.
    """
    rows = {}
    for n_views, sigma in product((2, *VIEWS), SIGMAS_PX):
        here = scene(sk.synthetic.DetectionNoise(sigma_px=0.0), poses, seed, n_views=n_views)
        pixels = np.moveaxis(sk.project(here.truth, here.rig), 0, 1)
        pixels += sigma * np.random.default_rng(seed).standard_normal(pixels.shape)
        here = replace(here, detections=np.insert(pixels, 2, 1.0, axis=-1))
        result = here.refined(fields=fields)
        plain, ours = here.mpjpe(here.solved("dlt-confidence")), here.mpjpe(result.pose)
        ok = result.joint_status == "ok"
        row = {"DLT conf.": plain, "default": ours, "ratio": round(ours / plain, 3)}
        row |= covered(result.pose, result.uncertainty, np.where(ok[..., None], here.judged, np.nan))
        row |= {"ok, %": 100 * float(ok.mean()), "noise": float(np.median(result.noise))}
        rows[f"{n_views} views, {sigma:.0f} px"] = row
    worst = max(row["ratio"] for row in rows.values())
    notes = [f"largest ratio: {worst:.3f}", about(poses=poses, seed=seed, source=POSES)]
    return Table.of("Gaussian noise: MPJPE, mm, and coverage, %", "noise", rows, notes)


def angles(
    *, takes: int = 24, frames: int = 200, seed: int = 0, fast: bool = False, fields: Fields | None = None
) -> Table:
    """Mean absolute errors in degrees, frame by frame and over time, and coverage at 1, 2, 3 σ in percent.

    At most `frames` of each of `takes` recordings at 30 Hz in four views, without confidences; with `fast`
    three takes of one condition.
    """
    rows: dict[str, dict[str, float]] = {}
    for condition in CONDITIONS[:1] if fast else CONDITIONS:
        given = {"count": 3 if fast else takes, "most_frames": frames, "seed": seed}
        found = recordings.takes(condition, confidence=False, **given)
        for name, over_time in (("single", False), ("over time", True)):
            solved = [_angles(take, over_time, fields) for take in found]
            names = solved[0][0].names
            error, sigma = (np.concatenate(parts) for parts in list(zip(*solved, strict=True))[1:])
            true = np.concatenate([one.degrees for one, *_ in solved])
            row = {}
            for head, end in ANGLES.items():
                columns = [k for k, angle in enumerate(names) if angle.endswith(end)]
                row[head] = float(np.nanmean(np.abs(error[:, columns])))
            ratio = np.abs(error / sigma)[np.isfinite(error / sigma)]
            row |= {f"{k} σ": float(100 * np.mean(ratio <= k)) for k in (1, 2, 3)}
            bent = [k for k, angle in enumerate(names) if angle.endswith(("knee_flexion", "elbow_flexion"))]
            small = (true[:, bent] < STRAIGHT_DEG) & np.isfinite(error[:, bent])
            row["straight"] = float(error[:, bent][small].mean()) if small.any() else None
            rows[f"{condition}, {name}"] = row
    notes = [
        "ideal coverage 68.3, 95.4, 99.7; error bars are the scatter, since the simulated detector has no "
        "systematic error",
        "hip, shoulder: flexion, where the true abduction is below 60°; abd: abduction; trunk: inclination",
        f"straight: mean error of knees and elbows truly bent by less than {STRAIGHT_DEG:g}°",
        about(takes=len(found), frames=len(true), seed=seed),
    ]
    title = "Joint angles: mean absolute error in degrees, and coverage in %"
    return Table.of(title, "detections", rows, notes)


def _angles(
    take: Take, over_time: bool, fields: Fields | None
) -> tuple[sk.JointAngles, FloatArray, FloatArray]:
    """Return the true angles of a take, the errors and the standard deviations (T, A), in degrees."""
    scene, result = take.scene, None
    if over_time:
        given = {"fps": take.fps, "layout": scene.layout, "config": sk.RefineConfig(**(fields or {}))}
        result = sk.refine_sequence(scene.detections, scene.rig, **given)
    result = result or scene.refined(fields=fields)
    found = sk.joint_angles(result, layout=scene.layout, uncertainty=result.uncertainty)
    true = sk.joint_angles(scene.truth, layout=scene.layout)
    error = (found.degrees - true.degrees + 180.0) % 360.0 - 180.0
    for k, name in enumerate(found.names):
        if name.endswith(("hip_flexion", "shoulder_flexion")):
            aside = np.cos(np.radians(true[name.replace("flexion", "abduction")])) < SIDEWAYS
            error[aside, k] = np.nan
    return true, error, found.sigma

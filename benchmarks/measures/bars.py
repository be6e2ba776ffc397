"""Error bars: how often errors lie within them, of positions and of angles."""

from __future__ import annotations

import numpy as np
import recordings
from lab import Table, about
from methods import Fields, default, dlt, mpjpe, paper
from methods import coverage as covered
from recordings import Take
from scenarios import NOISES, FloatArray, Scene, cmu_poses, louder, mvor, pose_source, rig, scene
from scipy.stats import spearmanr

import skelsplat as sk

# Share of a Gaussian in three dimensions within 1, 2 and 3 standard deviations, in percent.
IDEAL = np.array([19.9, 73.9, 97.1])
VIEWS = (3, 4, 8)
FACTORS = (1, 2)
# MVOR's labels are good to ±50 mm in space, which is this per axis.
LABEL_SIGMA_MM = 30.0
SIGMAS_PX = (1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0)
GAUSSIAN_VIEWS = (2, 3, 4, 8)
# Share of a Gaussian of one dimension within 1, 2 and 3 standard deviations, in percent.
IDEAL_ANGLES = (68.3, 95.4, 99.7)
CONDITIONS = ("good", "occluded 2", "occluded 3", "heavy")
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


def coverage(*, poses: int = 300, seed: int = 0, fast: bool = False, fields: Fields | None = None) -> Table:
    """Coverage in percent at 1, 2, 3 σ, and rank correlation of predicted and true error.

    For four views the paper's splat covariance is added for `paper`, unless `fast`.
    """
    rows, deviations = {}, []
    for name in ("good", "occluded 2"):
        for n_views in VIEWS:
            for factor in FACTORS:
                here = scene(louder(NOISES[name], factor), poses, seed, n_views=n_views)
                where = f"{name}, {n_views}v, {NOISES[name].sigma_px * factor:.1f}px"
                result = default(here, fields=fields)
                rows[where] = _row(result.pose, result.uncertainty, here)
                deviations.append(rows[where]["deviation"])
                if not fast and factor == 1 and n_views == 4:
                    published = paper(here)
                    rows[f"{where}, paper"] = _row(published.pose, published.covariance, here)
    notes = [
        f"largest deviation of any row from the ideal: {max(deviations):.1f} points",
        "rows: detections, views, jitter; paper: its splat covariance",
        "rank: rank correlation of predicted and true error; predicted, true: median lengths, mm",
        "if exact: the same, were every error drawn from its predicted covariance",
        about(poses=poses, seed=seed, source=here.source),
    ]
    return Table.of("Coverage, % (ideal 19.9, 73.9, 97.1), and errors, mm", "detections", rows, notes)


def _row(pose: FloatArray, covariance: FloatArray, here: Scene) -> dict[str, float]:
    share = covered(pose, covariance, here.judged)
    error = sk.metrics.mpjpe(pose, here.judged, reduce="none").ravel()
    predicted = np.sqrt(np.trace(covariance, axis1=-2, axis2=-1)).ravel()
    both = np.isfinite(error) & np.isfinite(predicted)
    drawn = _drawn(covariance).ravel()
    return {
        **{f"{k} σ": float(value) for k, value in zip((1, 2, 3), share, strict=True)},
        "deviation": float(np.abs(share - IDEAL).max()),
        "rank": float(spearmanr(predicted[both], error[both]).statistic),
        "if exact": float(spearmanr(predicted[both], drawn[both]).statistic),
        "predicted": float(np.median(predicted[both])),
        "true": float(np.median(error[both])),
        "MPJPE": float(error[both].mean()),
    }


def _drawn(covariance: FloatArray) -> FloatArray:
    """Lengths of errors drawn from the covariances: the reference for an exact prediction."""
    known = np.isfinite(covariance).all(axis=(-2, -1))
    factor = np.linalg.cholesky(np.where(known[..., None, None], covariance, np.eye(3)))
    normal = np.random.default_rng(0).standard_normal((*known.shape, 3, 1))
    return np.linalg.norm((factor @ normal)[..., 0], axis=-1)


def coverage_real(
    *,
    label_sigma_mm: float = LABEL_SIGMA_MM,
    detector: str = "openpose",
    poses: int = 300,
    seed: int = 0,
    fields: Fields | None = None,
) -> Table:
    """Measure which percentage of errors scatter and error bar cover, on MVOR and in a simulation.

    The labels' variance is added to every covariance. An offset is the mean error of a joint over all people;
    taking it out uses the labels, and shows what remains beyond a constant difference of definition.
    """
    here = scene(NOISES["good"], poses, seed, n_views=3)
    rows = {"simulated, 3 views": _both(default(here, fields=fields), here.judged, 0.0)}
    real = mvor(detector)
    result = default(real, fields=fields)
    hips = np.array([name.endswith("hip") for name in sk.layouts.COCO17.joints])[:, None]
    seen = real.detected.sum(axis=1)[..., None]
    parts = {
        "all": real.judged,
        "without hips": np.where(hips, np.nan, real.judged),
        "hips": np.where(hips, real.judged, np.nan),
        "three views": np.where(seen < 3, np.nan, real.judged),
        "one view": np.where(seen == 1, real.truth, np.nan),
    }
    for name, truth in parts.items():
        rows[f"MVOR, {name}"] = _both(result, truth, label_sigma_mm)
        moved = truth + _offsets(result.pose, truth)
        rows[f"MVOR, {name}, offsets out"] = _both(result, moved, label_sigma_mm)
    notes = [
        f"ideal 19.9, 73.9, 97.1; labels of MVOR: {label_sigma_mm:g} mm per axis, added to the covariances",
        "the simulated detector has no systematic error, so the error bar is too wide there",
        "offsets out: the mean error of each joint, which only the labels show, is subtracted",
        about(poses=poses, seed=seed, source=real.source),
    ]
    return Table.of("Coverage of scatter and error bar, %", "", rows, notes)


def _offsets(pose: FloatArray, truth: FloatArray) -> FloatArray:
    """Mean error of every joint, (N, 3); 0 for one that is never judged."""
    error = pose - truth
    known = np.isfinite(error).all(axis=-1, keepdims=True)
    total = np.where(known, error, 0.0).sum(axis=0)
    mean: FloatArray = total / np.maximum(known.sum(axis=0), 1)
    return mean


def _both(result: sk.Refinement, truth: FloatArray, label_sigma_mm: float) -> dict[str, float]:
    """Coverage by scatter and by error bar, with labels that err by so much per axis."""
    out: dict[str, float] = {}
    for name, covariance in (("scatter", result.uncertainty), ("error bar", result.error_bar)):
        share = covered(result.pose, covariance + label_sigma_mm**2 * np.eye(3), truth)
        out |= {f"{name} {k} σ": float(value) for k, value in zip((1, 2, 3), share, strict=True)}
    error = sk.metrics.mpjpe(result.pose, truth, reduce="none")
    return out | {"joints": int(np.isfinite(error).sum()), "MPJPE": float(np.nanmean(error))}


def gaussian(*, poses: int = 200, seed: int = 0, fields: Fields | None = None) -> Table:
    """MPJPE in mm of DLT with confidence and of the default, their ratio, and coverage of the error bars."""
    rows: dict[str, dict[str, float]] = {}
    for n_views in GAUSSIAN_VIEWS:
        for sigma in SIGMAS_PX:
            here = noisy_scene(sigma, poses, seed, n_views)
            result = default(here, fields=fields)
            plain, ours = mpjpe(dlt(here, weighted=True), here), mpjpe(result.pose, here)
            ok = result.joint_status == "ok"
            share = covered(result.pose, result.uncertainty, np.where(ok[..., None], here.judged, np.nan))
            rows[f"{n_views} views, {sigma:.0f} px"] = {
                "DLT conf.": plain,
                "default": ours,
                "ratio": round(ours / plain, 3),
                **{f"{k} σ": float(value) for k, value in zip((1, 2, 3), share, strict=True)},
                "beyond": 100 - float(share[2]),
                "ok, %": 100 * float(ok.mean()),
                "noise": float(np.median(result.noise)),
            }
    worst, least = max(row["ratio"] for row in rows.values()), min(row["3 σ"] for row in rows.values())
    notes = [
        f"largest ratio to DLT: {worst:.3f}; least coverage at 3 σ: {least:.1f} % (ideal 97.1)",
        "coverage over the joints that are ok; beyond: ok joints further off than 3 σ, %",
        about(poses=poses, seed=seed, source=here.source),
    ]
    return Table.of("Gaussian noise: MPJPE, mm, and coverage, %", "noise", rows, notes)


def noisy_scene(sigma_px: float, poses: int, seed: int, n_views: int) -> Scene:
    """Project poses and add independent normal noise on both axes; every confidence is 1."""
    cameras, truth = rig(n_views), cmu_poses(poses, seed)
    pixels = np.moveaxis(sk.project(truth, cameras), 0, 1)
    pixels += sigma_px * np.random.default_rng(seed).standard_normal(pixels.shape)
    detections = np.concatenate([pixels, np.ones((*pixels.shape[:-1], 1))], axis=-1)
    return Scene(truth, detections, cameras, "h36m17", f"{pose_source()}, room, Gaussian noise only")


def angles(
    *, takes: int = 24, frames: int = 200, seed: int = 0, fast: bool = False, fields: Fields | None = None
) -> Table:
    """Mean absolute errors in degrees, frame by frame and over time, and coverage at 1, 2, 3 σ in percent.

    At most `frames` of each of `takes` recordings at 30 Hz in four views, without confidences; with `fast`
    three takes of one condition.
    """
    rows: dict[str, dict[str, float]] = {}
    straight = []
    for condition in CONDITIONS[:1] if fast else CONDITIONS:
        found = recordings.takes(condition, count=3 if fast else takes, most_frames=frames, seed=seed)
        for name, over_time in (("single", False), ("over time", True)):
            solved = [_angles(recordings.unsure(take), over_time, fields) for take in found]
            names = solved[0][0].names
            true, error, sigma = (
                np.concatenate(parts)
                for parts in zip(*((t.degrees, e, s) for t, e, s in solved), strict=True)
            )
            row = {}
            for head, end in ANGLES.items():
                columns = [k for k, angle in enumerate(names) if angle.endswith(end)]
                row[head] = float(np.nanmean(np.abs(error[:, columns])))
            ratio = np.abs(error / sigma)[np.isfinite(error / sigma)]
            rows[f"{condition}, {name}"] = row | {
                f"{k} σ": float(100 * np.mean(ratio <= k)) for k in (1, 2, 3)
            }
            straight.append(f"{condition}, {name}: {_straight(names, true, error, sigma)}")
    notes = [
        f"ideal coverage {', '.join(map(str, IDEAL_ANGLES))}; the error bars are the scatter, since the "
        "simulated detector has no systematic error",
        "hip, shoulder: flexion, where the true abduction is below 60°; abd: abduction; trunk: inclination",
        f"knees and elbows truly bent by less than {STRAIGHT_DEG:g}°, mean error and coverage: "
        + "; ".join(straight),
        about(takes=len(found), frames=len(true), seed=seed),
    ]
    return Table.of(
        "Joint angles: mean absolute error in degrees, and coverage in %", "detections", rows, notes
    )


def _angles(
    take: Take, over_time: bool, fields: Fields | None
) -> tuple[sk.JointAngles, FloatArray, FloatArray]:
    """Return the true angles of a take, the errors and the standard deviations (T, A), in degrees."""
    scene, config = take.scene, sk.RefineConfig(**(fields or {}))
    given = {"layout": scene.layout, "config": config}
    if over_time:
        result = sk.refine_sequence(scene.detections, scene.rig, fps=take.fps, **given)
    else:
        result = sk.refine(None, scene.detections, scene.rig, **given)
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

"""Error bars of positions and angles, how often they hold; and how far a detector's joints are off."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import recordings
from lab import ONE_THREAD, Table
from recordings import CONDITIONS, Take
from scenarios import NOISES, POSES, FloatArray, covered, mvor, scene

import skelsplat as sk
from skelsplat import datasets
from skelsplat.datasets.hourglass import LIMBS
from skelsplat.datasets.human36m import SUBJECTS
from skelsplat.evaluation import protocols
from skelsplat.evaluation.scores import in_body, offsets

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
# Of real Human3.6M.
TRAINING = ("S1", "S5", "S6", "S7", "S8")
LAYOUT = sk.layouts.H36M17
CLASSES = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist", "pelvis", "neck")
# To which the defaults are rounded.
_STEP_MM = 5.0
_MOST_MM = 500.0


def coverage(*, poses: int = 300, seed: int = 0) -> Table:
    """Coverage in percent at 1, 2, 3 σ, and errors."""
    rows = {}
    for name, n_views, factor in product(("good", "occluded 2"), VIEWS, (1, 2)):
        noise = replace(NOISES[name], sigma_px=factor * NOISES[name].sigma_px)
        here = scene(noise, poses, seed, n_views=n_views)
        result = here.refined()
        inside = covered(result.pose, result.uncertainty, here.judged)
        rows[f"{name}, {n_views} views, {noise.sigma_px:.1f} px"] = inside | {
            "MPJPE": here.mpjpe(result.pose)
        }
    title = "Coverage, % (ideal 19.9, 73.9, 97.1), and errors, mm"
    return Table.of(title, "detections", rows, [here.source])


def coverage_real(*, poses: int = 300, seed: int = 0) -> Table:
    """Measure which percentage of errors scatter and error bar cover, on MVOR and in a simulation."""
    here = scene(NOISES["good"], poses, seed, n_views=3)
    rows = {"simulated, 3 views": _both(here.refined(), here.judged, 0.0)}
    real = mvor()
    result = real.refined()
    hips = np.array([name.endswith("hip") for name in sk.layouts.COCO17.joints])[:, None]
    seen = real.detected.sum(axis=1)[..., None]
    parts = {
        "all": real.judged,
        "without hips": np.where(hips, np.nan, real.judged),
        "three views": np.where(seen < 3, np.nan, real.judged),
    }
    for name, truth in parts.items():
        rows[f"MVOR, {name}"] = _both(result, truth, LABEL_SIGMA_MM)
    rows["MVOR, without hips, labels exact"] = _both(result, parts["without hips"], 0.0)
    notes = [
        f"ideal 19.9, 73.9, 97.1; labels of MVOR: {LABEL_SIGMA_MM:g} mm per axis, added to the covariances",
        _label_scatter(real.truth),
        real.source,
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


def gaussian(*, poses: int = 200, seed: int = 0) -> Table:
    """MPJPE in mm of DLT with confidence and of the default, and their ratio.

    Independent normal noise on both axes; every confidence is 1.
    """
    rows = {}
    for n_views, sigma in product((2, *VIEWS), SIGMAS_PX):
        here = scene(sk.synthetic.DetectionNoise(sigma_px=0.0), poses, seed, n_views=n_views)
        pixels = np.moveaxis(sk.project(here.truth, here.rig), 0, 1)
        pixels += sigma * np.random.default_rng(seed).standard_normal(pixels.shape)
        here = replace(here, detections=np.insert(pixels, 2, 1.0, axis=-1))
        plain = here.mpjpe(here.solved("dlt-confidence"))
        ours = here.mpjpe(here.refined().pose)
        row = {"DLT conf.": plain, "default": ours, "ratio": round(ours / plain, 3)}
        rows[f"{n_views} views, {sigma:.0f} px"] = row
    worst = max(row["ratio"] for row in rows.values())
    return Table.of("Gaussian noise: MPJPE, mm", "noise", rows, [f"largest ratio: {worst:.3f}", POSES])


def angles(*, takes: int = 24, frames: int = 200, seed: int = 0, fast: bool = False) -> Table:
    """Mean absolute errors in degrees, frame by frame and over time, and coverage at 1, 2, 3 σ in percent.

    At most `frames` of each of `takes` recordings at 30 Hz in four views, without confidences; with `fast`
    three takes of one condition.
    """
    rows: dict[str, dict[str, float]] = {}
    for condition in CONDITIONS[:1] if fast else CONDITIONS:
        given = {"count": 3 if fast else takes, "most_frames": frames, "seed": seed}
        found = recordings.takes(condition, confidence=False, **given)
        for name, over_time in (("single", False), ("over time", True)):
            solved = [_angles(take, over_time) for take in found]
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
        "hip, shoulder: flexion, where the true abduction is below 60°; abd: abduction; trunk: inclination",
        f"straight: mean error of knees and elbows truly bent by less than {STRAIGHT_DEG:g}°",
        f"{len(found)} takes, {len(true)} frames",
    ]
    title = "Joint angles: mean absolute error in degrees, and coverage in %"
    return Table.of(title, "detections", rows, notes)


def _angles(take: Take, over_time: bool) -> tuple[sk.JointAngles, FloatArray, FloatArray]:
    """Return the true angles of a take, the errors and the standard deviations (T, A), in degrees."""
    scene, result = take.scene, take.scene.refined()
    if over_time:
        result = sk.refine_sequence(scene.detections, scene.rig, fps=take.fps, layout=scene.layout)
    found = sk.joint_angles(result, layout=scene.layout, uncertainty=result.uncertainty)
    true = sk.joint_angles(scene.truth, layout=scene.layout)
    error = (found.degrees - true.degrees + 180.0) % 360.0 - 180.0
    for k, name in enumerate(found.names):
        if name.endswith(("hip_flexion", "shoulder_flexion")):
            aside = np.cos(np.radians(true[name.replace("flexion", "abduction")])) < SIDEWAYS
            error[aside, k] = np.nan
    return true, error, found.sigma


def coverage_human36m(*, folder: Path, every: int = 64) -> Table:
    """Measure which percentage of errors scatter and error bar cover, frame by frame and over time.

    Arms and legs of S9 and S11; `folder` is what ../shared/tools/h36m_hourglass.py wrote.
    """
    rows: dict[str, dict[str, float | None]] = {}
    data = datasets.read("human36m-hourglass", folder)
    cases = protocols.get(data.name).with_options(every=every).cases(data)
    for over_time in (False, True):
        how = "over time" if over_time else "frame by frame"
        solved = [_solved(case, over_time) for case in cases if case.absolute]
        subjects = np.concatenate([[case.take.subject] * len(case.take) for case in cases if case.absolute])
        pose, truth, scatter, bar = (np.concatenate(part) for part in zip(*solved, strict=True))
        limbs = np.isin(LAYOUT.joints, LIMBS)
        groups = {who: (subjects == who)[:, None] & limbs for who in SUBJECTS}
        groups["both"] = np.broadcast_to(limbs, pose.shape[:2])
        parts = {kind: np.char.endswith(LAYOUT.joints, kind) & limbs for kind in CLASSES[:6]}
        groups |= {kind: np.broadcast_to(chosen, pose.shape[:2]) for kind, chosen in parts.items()}
        for name, chosen in groups.items():
            judged = np.where(chosen[..., None], truth, np.nan)
            inside = covered(pose, scatter, judged, "scatter ") | covered(pose, bar, judged, "bar ")
            error = np.linalg.norm(pose - judged, axis=-1)
            rows[f"{how}, {name}"] = inside | {"mean mm": float(np.nanmean(error))}
    return Table.of("Human3.6M, real: coverage, % (ideal 19.9, 73.9, 97.1), arms and legs", "", rows)


def _solved(case: protocols.Case, over_time: bool) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return poses and truth (T, N, 3) of a case, its scatter and its error bars (T, N, 3, 3)."""
    take, given = case.given(over_time), {"layout": LAYOUT, "config": ONE_THREAD}
    if over_time:
        found = sk.refine_sequence(take.detections, take.rig, fps=take.fps, **given)
    else:
        found = sk.refine(None, take.detections, take.rig, **given)
    keep = case.rows if over_time else slice(None)
    return found.pose[keep], case.take.truth, found.uncertainty[keep], found.error_bar[keep]


def bias(*, folder: Path, every: int = 32) -> Table:
    """Measure how far the detector's joints are from those of the motion capture, on S1 and S5 to S8.

    distance: √3 times the standard deviation per axis that makes 2 σ cover 73.9 % of the errors; offset:
    length of the mean error of each person's joint in the frame of the body. MVOR: both
    there, with OpenPose and the labels' variance added to the scatter, the offset over all.
    """
    data = datasets.read("human36m-hourglass", folder, subjects=TRAINING)
    error, scatter, body = [], [], {}
    for take in data:
        some = take.select(slice(0, None, every))
        found = sk.refine(None, some.detections, some.rig, layout=LAYOUT, config=ONE_THREAD)
        error.append(found.pose - some.truth)
        scatter.append(found.uncertainty)
        own = body.setdefault(take.subject, [])
        own.append(in_body(error[-1], some.truth, LAYOUT))
    errors, covariances = np.concatenate(error), np.concatenate(scatter)
    means = np.stack([offsets(np.concatenate(own)) for own in body.values()])
    rows = {}
    for kind in CLASSES:
        chosen = np.flatnonzero(np.char.endswith(LAYOUT.joints, kind))
        distance = _distance(errors[:, chosen], covariances[:, chosen])
        rows[kind] = {
            "distance": distance,
            f"to {_STEP_MM:g} mm": _STEP_MM * round(distance / _STEP_MM),
            "offset": float(np.linalg.norm(means[:, chosen], axis=-1).mean()),
        }
    real = mvor()
    found = real.refined(config=ONE_THREAD)
    labels, joints = LABEL_SIGMA_MM**2 * np.eye(3), sk.layouts.COCO17.joints
    shoulders = real.judged[:, np.char.endswith(joints, "shoulder")]
    whole = np.concatenate([real.judged, shoulders.mean(axis=1, keepdims=True)], axis=1)
    turned = in_body(found.pose - real.judged, whole, sk.layouts.from_names("coco18", (*joints, "neck")))
    turned[..., 0] *= np.where(np.char.startswith(joints, "right"), -1.0, 1.0)
    for kind in CLASSES:
        chosen = np.char.endswith(joints, kind)
        missed = (found.pose - real.judged)[:, chosen]
        if np.isfinite(missed).any():
            rows[kind]["MVOR"] = _distance(missed, found.uncertainty[:, chosen] + labels)
            rows[kind]["MVOR offset"] = float(np.linalg.norm(offsets(turned[:, chosen].reshape(-1, 1, 3))))
    return Table.of("Human3.6M, real: joints of the detector against the motion capture, mm", "joint", rows)


def _distance(error: FloatArray, scatter: FloatArray) -> float:
    """Return √3 times the standard deviation per axis beyond the scatter with which 2 σ cover 73.9 %."""
    known = np.isfinite(error).all(axis=-1) & np.isfinite(scatter).all(axis=(-2, -1))
    values, axes = np.linalg.eigh(scatter[known])
    along = np.einsum("kij,ki->kj", axes, error[known])
    low, high = 0.0, _MOST_MM
    while high - low > 0.01:
        middle = (low + high) / 2
        inside = (along**2 / (values + middle**2)).sum(axis=-1) <= 4.0
        low, high = (low, middle) if 100 * inside.mean() >= IDEAL[1] else (middle, high)
    return float(np.sqrt(3.0) * high)

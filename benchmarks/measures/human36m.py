"""Error bars on real Human3.6M, hourglass detections: how often they hold, and how far joints are off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from lab import ONE_THREAD, Table
from scenarios import FloatArray, covered, mvor

import skelsplat as sk
from measures.bars import IDEAL, LABEL_SIGMA_MM
from skelsplat import datasets
from skelsplat.datasets.hourglass import LIMBS
from skelsplat.datasets.human36m import SUBJECTS
from skelsplat.evaluation import protocols
from skelsplat.evaluation.scores import in_body, offsets

TRAINING = ("S1", "S5", "S6", "S7", "S8")
LAYOUT = sk.layouts.H36M17
CLASSES = ("hip", "knee", "ankle", "shoulder", "elbow", "wrist", "pelvis", "neck")
# To which the defaults are rounded.
_STEP_MM = 5.0
_MOST_MM = 500.0


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
    take, rows = case.given(over_time), case.rows if over_time else None
    given = {"layout": LAYOUT, "config": ONE_THREAD}
    assert take.detections is not None
    if over_time:
        assert take.fps is not None
        found = sk.refine_sequence(take.detections, take.rig, fps=take.fps, **given)
    else:
        found = sk.refine(None, take.detections, take.rig, **given)
    keep = slice(None) if rows is None else rows
    return found.pose[keep], case.take.truth, found.uncertainty[keep], found.error_bar[keep]


def bias(*, folder: Path, every: int = 32) -> Table:
    """Measure how far the detector's joints are from those of the motion capture, on S1 and S5 to S8.

    distance: √3 times the standard deviation per axis that makes 2 σ cover 73.9 % of the errors; offset: of
    the mean error of each person's joint in the frame of the body: its length, and its parts. MVOR: the
    distance there, with OpenPose and the labels' variance added to the scatter, and the offset over all.
    """
    data = datasets.read("human36m-hourglass", folder, subjects=TRAINING)
    error, scatter, body, people = [], [], [], []
    for take in data:
        some = take.select(slice(0, None, every))
        assert some.detections is not None
        found = sk.refine(None, some.detections, some.rig, layout=LAYOUT, config=ONE_THREAD)
        error.append(found.pose - some.truth)
        scatter.append(found.uncertainty)
        body.append(in_body(error[-1], some.truth, LAYOUT))
        people += [take.subject] * len(some)
    whose = np.array(people)
    errors, covariances, turned = (np.concatenate(part) for part in (error, scatter, body))
    means = np.stack([offsets(turned[whose == who]) for who in TRAINING])
    means[..., 0] *= np.where(np.char.startswith(LAYOUT.joints, "right"), -1.0, 1.0)
    rows = {}
    for kind in CLASSES:
        chosen = np.flatnonzero(np.char.endswith(LAYOUT.joints, kind))
        each = np.linalg.norm(errors[:, chosen], axis=-1)
        distance = _distance(errors[:, chosen], covariances[:, chosen])
        left, ahead, up = means[:, chosen].mean(axis=(0, 1)).tolist()
        rows[kind] = {
            "distance": distance,
            f"to {_STEP_MM:g} mm": _STEP_MM * round(distance / _STEP_MM),
            "median error": float(np.nanmedian(each)),
            "offset": float(np.linalg.norm(means[:, chosen], axis=-1).mean()),
            "outwards": left,
            "ahead": ahead,
            "up": up,
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

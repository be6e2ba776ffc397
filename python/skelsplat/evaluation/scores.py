"""From poses to figures: errors of one method over all cases, by column, by joint, with intervals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from skelsplat import metrics
from skelsplat._arrays import Array, Mask, generator
from skelsplat._skelsplat import Layout
from skelsplat.datasets import Take
from skelsplat.evaluation.methods import Solution
from skelsplat.evaluation.protocols import Case, Protocol
from skelsplat.evaluation.report import Figures, lines
from skelsplat.evaluation.tables import interval

PCK_MM = (50, 100, 150)
ERRORS = ("absolute_mm", "relative_mm", "procrustes_mm")


def score(
    method: str, cases: Sequence[Case], solutions: Sequence[Solution], layout: Layout, protocol: Protocol
) -> list[Figures]:
    """Return lines of figures of one method, with one solution per case: of all, by column and by joint.

    ``absolute_mm``, ``relative_mm``, ``procrustes_mm`` are the MPJPE over all joints with a position; the
    share of others is ``missing``, and they are wrong in ``pck_…``. ``acceleration_m_s2`` is the error of
    the acceleration where frames are consecutive and their rate is known. A protocol with ``joints`` has
    also ``every_joint_mm``, and ``offsets_out_mm``, after the mean error of each joint of a subject, in
    the frame of the body, is subtracted.
    """
    every = [_errors(case, s.pose, layout, protocol) for case, s in zip(cases, solutions, strict=True)]
    counted = _counted(layout, protocol)
    errors = [{key: e[key] if key == "pcp" else e[key][:, counted] for key in e} for e in every]
    poses = sum(len(case.take) for case in cases)
    columns = {
        key: _means([e for e, case in zip(errors, cases, strict=True) if case.column == key])
        for key in protocol.headers(cases)
    }
    whole: Figures = {
        **_means(errors),
        "absolute_poses": sum(len(case.take) for case in cases if case.absolute),
        "median_mm": _mean([e["absolute_mm"] for e in errors], np.median),
        "ms_per_pose": 1e3 * sum(solution.seconds for solution in solutions) / poses,
    }
    for kind in ERRORS:
        sums = [float(np.nansum(e[kind])) for e in errors]
        low, high = mean_interval(sums, [np.count_nonzero(~np.isnan(e[kind])) for e in errors])
        whole |= {kind.replace("_mm", "_low_mm"): low, kind.replace("_mm", "_high_mm"): high}
    whole["interval"] = interval(whole["absolute_low_mm"], whole["absolute_high_mm"])
    for key in (*(f"pck_{mm}" for mm in PCK_MM), "missing", "acceleration_m_s2"):
        whole[key] = _mean([e[key] for e in errors])
    if protocol.mean_of_columns:
        whole["pcp"] = _mean([np.array([means["pcp"] for means in columns.values()])])
    if protocol.joints:
        whole["every_joint_mm"] = _mean([e["absolute_mm"] for e in every])
        whole["offsets_out_mm"] = _without_offsets(cases, solutions, layout, protocol)
    joints = {name: _means(every, joint=j) for j, name in enumerate(layout.joints)}
    return lines(method, {"all": {"": whole}, "action": columns, "joint": joints})


def _errors(case: Case, pose: Array, layout: Layout, protocol: Protocol) -> dict[str, Array]:
    """Errors (T, N) of a case, and correct parts (T, L) as ``pcp``; NaN where something does not count."""
    take = case.take
    truth, found = take.truth * take.rig.mm_per_unit, pose * take.rig.mm_per_unit
    root = layout.root if protocol.root is None else protocol.root
    counted = _counted(layout, protocol)[:, None]
    absolute = {
        "absolute_mm": metrics.mpjpe(found, truth, reduce="none"),
        "acceleration_m_s2": _acceleration(take, found - truth),
        **{f"pck_{mm}": metrics.pck(found, truth, threshold_mm=mm, reduce="none") for mm in PCK_MM},
    }
    parts = np.full((len(take), 1), np.nan)
    if protocol.parts:
        parts = metrics.pcp(found, truth, protocol.parts, reduce="none")
    return {
        **{key: np.where(case.absolute, values, np.nan) for key, values in absolute.items()},
        "relative_mm": metrics.root_relative_mpjpe(found, truth, root=root, reduce="none"),
        "procrustes_mm": metrics.pa_mpjpe(found, np.where(counted, truth, np.nan), reduce="none"),
        "missing": np.asarray(metrics.missing_rate(found, truth, reduce="none")),
        "pcp": parts,
    }


def _counted(layout: Layout, protocol: Protocol) -> Mask:
    """Which joints (N,) averages are of."""
    return np.isin(layout.joints, protocol.joints or layout.joints)


def _without_offsets(
    cases: Sequence[Case], solutions: Sequence[Solution], layout: Layout, protocol: Protocol
) -> float:
    """Return the mean error, mm, after the `offsets` of each subject in the frame of the body are removed."""
    counted = _counted(layout, protocol)
    own: dict[str, list[Array]] = {}
    for case, solution in zip(cases, solutions, strict=True):
        if case.absolute:
            take = case.take
            error = in_body(solution.pose - take.truth, take.truth, layout) * take.rig.mm_per_unit
            own.setdefault(take.subject, []).append(error[:, counted])
    bodies = [np.concatenate(parts) for parts in own.values()]
    return _mean([np.linalg.norm(error - offsets(error), axis=-1) for error in bodies])


def in_body(vectors: Array, pose: Array, layout: Layout) -> Array:
    """Turn vectors (T, N, 3) of joints into the frame of a body (T, N, 3): to the left, ahead, and up."""
    left, right, neck = (pose[:, layout.joints.index(name)] for name in ("left_hip", "right_hip", "neck"))
    aside = left - right
    ahead = np.cross(aside, neck - right)
    axes = np.stack([aside, ahead, np.cross(ahead, aside)], axis=1)
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    return np.asarray(np.einsum("tij,tnj->tni", axes, vectors))


def offsets(error: Array) -> Array:
    """Return the mean error (N, 3) of every joint, from (T, N, 3); 0 for one that never has any."""
    known = np.isfinite(error).all(axis=-1, keepdims=True)
    mean: Array = np.where(known, error, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return mean


def _acceleration(take: Take, error: Array) -> Array:
    """Lengths (T, N), m/s², of the second differences of errors (T, N, 3) mm about their middle frames."""
    out = np.full(error.shape[:2], np.nan)
    if take.fps is not None and len(take) > 2:
        follows = take.frames[2:] - take.frames[:-2] == 2
        second = np.linalg.norm(np.diff(error, n=2, axis=0), axis=-1) * take.fps**2 / 1000.0
        out[1:-1] = np.where(follows[:, None], second, np.nan)
    return out


def _means(errors: Sequence[dict[str, Array]], joint: int | None = None) -> Figures:
    """Means over some cases, of all joints or of one."""
    pick = slice(None) if joint is None else slice(joint, joint + 1)
    return {
        "poses": sum(len(e["relative_mm"]) for e in errors),
        **{kind: _mean([e[kind][:, pick] for e in errors]) for kind in ERRORS},
        "pcp": _mean([e["pcp"] for e in errors]) if joint is None else float("nan"),
    }


def _mean(values: Sequence[Array], mean: Callable[[Array], np.floating[Any]] = np.mean) -> float:
    """Mean of what is not NaN; NaN if nothing is."""
    flat: Array = np.concatenate([np.zeros(0), *(np.ravel(v) for v in values)])
    finite = flat[~np.isnan(flat)]
    return float(mean(finite)) if finite.size else float("nan")


def mean_interval(
    sums: ArrayLike, counts: ArrayLike, *, level: float = 0.95, resamples: int = 2000
) -> tuple[float, float]:
    """Return the percentile interval of Σ sums / Σ counts when whole takes are drawn with replacement.

    This is the bootstrap over takes: frames of one take are alike, takes are not. `sums` and `counts` (S,)
    are of each take the sum of what is averaged and its count. NaN with fewer than two takes that count.
    """
    total, number = np.asarray(sums, dtype=np.float64), np.asarray(counts, dtype=np.float64)
    used = number > 0
    n = np.count_nonzero(used)
    if n < 2:
        return float("nan"), float("nan")
    times = generator(0).multinomial(n, np.full(n, 1.0 / n), size=resamples)
    means = (times @ total[used]) / (times @ number[used])
    low, high = np.quantile(means, [(1.0 - level) / 2.0, (1.0 + level) / 2.0])
    return float(low), float(high)

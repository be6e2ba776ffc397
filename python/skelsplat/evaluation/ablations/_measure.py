"""Errors of a setting on a sample, and differences between settings with their standard error."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import skelsplat as sk
from skelsplat.evaluation.ablations._sample import FloatArray, Sample


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Joint errors of one setting.

    Attributes
    ----------
    joints : (P, N) mm
        NaN where there is no truth or no prediction.
    take : (P,) int
        Which take each pose is from.
    steps : float
        Mean number of optimisation steps; NaN if nothing was optimised.
    missing : float
        Share of the joints with truth that have no prediction.
    """

    joints: FloatArray
    take: NDArray[np.int64]
    steps: float = float("nan")
    missing: float = 0.0

    @property
    def mpjpe(self) -> float:
        """Mean over joints and poses, mm."""
        return float(np.nanmean(self.joints))

    @property
    def poses(self) -> FloatArray:
        """Mean error (P,) of each pose, mm."""
        known = np.isfinite(self.joints)
        count = known.sum(axis=1)
        total = np.where(known, self.joints, 0.0).sum(axis=1)
        mean: FloatArray = np.divide(total, count, out=np.full(len(total), np.nan), where=count > 0)
        return mean


@dataclass(frozen=True, slots=True)
class Difference:
    """Mean of a paired difference and its standard error, mm."""

    mean: float
    error: float

    @property
    def is_less(self) -> bool:
        """Below zero by more than twice the standard error."""
        return self.mean < -2.0 * self.error

    def __str__(self) -> str:
        return f"{self.mean:+.2f} ± {self.error:.2f} mm"


def difference(a: Errors, b: Errors) -> Difference:
    """Return `a` − `b` over the same poses; the poses of a take count as dependent of one another."""
    each = a.poses - b.poses
    known = np.isfinite(each)
    each, take = each[known], a.take[known]
    mean = float(each.mean())
    _, index = np.unique(take, return_inverse=True)
    sums = np.bincount(index, weights=each - mean)
    clusters = len(sums)
    if clusters < 2:
        return Difference(mean, float("inf"))
    variance = clusters / (clusters - 1) * float((sums**2).sum()) / len(each) ** 2
    return Difference(mean, float(np.sqrt(variance)))


def errors_of(sample: Sample, poses: Sequence[FloatArray], steps: float = float("nan")) -> Errors:
    """Return the errors of predicted `poses`, one array (P, N, 3) per group of the sample."""
    joints, judged, found = [], 0, 0
    for group, pose in zip(sample.groups, poses, strict=True):
        joints.append(group.rig.mm_per_unit * np.linalg.norm(pose - group.truth, axis=-1))
        known = np.isfinite(group.truth).all(axis=-1)
        judged += int(known.sum())
        found += int((known & np.isfinite(pose).all(axis=-1)).sum())
    take = np.concatenate([group.take for group in sample.groups])
    return Errors(np.concatenate(joints), take, steps, 1.0 - found / max(judged, 1))


def refined(
    sample: Sample,
    starts: Sequence[FloatArray] | None,
    config: sk.RefineConfig,
    *,
    init_sigma_mm: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[sk.Refinement]:
    """Refine every group from its start (None: robust triangulation); `progress` counts poses."""
    out, done, total = [], 0, sample.n_poses
    for k, group in enumerate(sample.groups):

        def count(now: int, _: int, before: int = done) -> None:
            if progress is not None:
                progress(before + now, total)

        prior = None if init_sigma_mm is None else init_sigma_mm / group.rig.mm_per_unit
        out.append(
            sk.refine(
                None if starts is None else starts[k],
                group.detections,
                group.rig,
                layout=sample.layout,
                init_sigma=prior,
                config=config,
                progress=count,
            )
        )
        done += len(group.truth)
    return out


def errors(sample: Sample, results: Sequence[sk.Refinement]) -> Errors:
    """Return the errors of refined poses."""
    steps = float(np.mean(np.concatenate([result.n_iter for result in results])))
    return errors_of(sample, [result.pose for result in results], steps)

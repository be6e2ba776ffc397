"""Poses on which settings are compared, always with the same detections and starts, and their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import skelsplat as sk
from skelsplat._arrays import Array
from skelsplat.datasets import Dataset, Take
from skelsplat.evaluation.methods import starting_poses, without_lens
from skelsplat.evaluation.protocols import Protocol
from skelsplat.exceptions import InvalidInputError

Start = Literal["dlt", "fusion"]


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """P poses that the same cameras see."""

    poses: Take  # frames of several takes, one after the other
    take: NDArray[np.int64]  # (P,) int: Which take each pose is from

    def __len__(self) -> int:
        return len(self.take)


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Poses of one data set with the detections of one detector."""

    name: str  # short, for rows of a table: ``"H36M, metrabs"``
    dataset: str  # ``"human36m"``, ``"human36m-occ-2"``, …; tells which rows of the paper it belongs to
    layout: sk.Layout
    groups: tuple[Group, ...]
    n_available: int  # poses that the data set has
    # What the paper changes in its settings on this data set.
    paper_fields: Mapping[str, Any] = field(default_factory=dict)

    @property
    def n_poses(self) -> int:
        """Number of poses."""
        return sum(map(len, self.groups))

    @property
    def n_views(self) -> int:
        """The least number of cameras of any rig."""
        return min(len(group.poses.rig) for group in self.groups)

    @property
    def has_monocular(self) -> bool:
        """Whether all poses come with monocular estimates."""
        return all(group.poses.monocular is not None for group in self.groups)

    def starts(self, kind: Start) -> list[Array]:
        """Return the initial poses of every group."""
        return [starting_poses(group.poses, kind) for group in self.groups]

    def first_views(self, count: int) -> Sample:
        """Return the sample with the first `count` cameras of every rig, the only ones to estimate poses."""
        some = tuple(replace(g, poses=g.poses.with_views(range(count))) for g in self.groups)
        return replace(self, groups=some)

    def head(self, poses: int) -> Sample:
        """Return about `poses` poses, evenly from all takes."""
        share = poses / max(self.n_poses, 1)
        thinned = []
        for group in self.groups:
            keep = _evenly(len(group), min(max(1, round(share * len(group))), len(group)))
            thinned.append(Group(group.poses.select(keep), group.take[keep]))
        return replace(self, groups=tuple(thinned))


def sample(
    dataset: Dataset, protocol: Protocol, poses: int | None, *, name: str, key: str, undistort: bool
) -> Sample:
    """Take `poses` poses of a data set (None: all), evenly over the takes that its protocol counts.

    `name` and `key` are `Sample.name` and `Sample.dataset`. Without `undistort` cameras lose their lens, so
    that detections are used with K alone.
    """
    takes = [case.take for case in protocol.cases(dataset) if case.absolute]
    total = sum(len(take) for take in takes)
    if total == 0:
        raise InvalidInputError(f"{dataset.name}: expected poses whose absolute error counts, got none")
    chosen = np.arange(total) if poses is None or poses >= total else _evenly(total, poses)
    groups = _grouped(takes, chosen)
    if not undistort:
        groups = [replace(g, poses=replace(g.poses, rig=without_lens(g.poses.rig))) for g in groups]
    return Sample(name, key, dataset.layout, tuple(groups), total, protocol.paper_fields)


def _evenly(total: int, count: int) -> NDArray[np.int64]:
    return ((np.arange(count) + 0.5) * total / count).astype(np.int64)


def _grouped(takes: Sequence[Take], chosen: NDArray[np.int64]) -> list[Group]:
    """Join the chosen poses, numbered over all takes, of takes with the same cameras."""
    parts: list[list[tuple[int, Take]]] = []
    first = 0
    for number, take in enumerate(takes):
        here = chosen[(chosen >= first) & (chosen < first + len(take))] - first
        first += len(take)
        if len(here) == 0:
            continue
        if take.detections is None:
            raise InvalidInputError(f"{take.key}: expected detections, got a data set read without")
        same = next((part for part in parts if part[0][1].rig == take.rig), None)
        if same is None:
            parts.append(same := [])
        same.append((number, take.select(here)))
    return [_joined(part) for part in parts]


def _joined(part: Sequence[tuple[int, Take]]) -> Group:
    takes = [take for _, take in part]

    def joined(name: str) -> Any:
        values = [getattr(take, name) for take in takes]
        return None if any(value is None for value in values) else np.concatenate(values)

    poses = Take(
        takes[0].key,
        takes[0].subject,
        takes[0].action,
        takes[0].rig,
        *(joined(name) for name in ("frames", "truth", "detections", "monocular")),
    )
    return Group(poses, np.concatenate([np.full(len(take), number) for number, take in part]))


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Joint errors of one setting."""

    joints: Array  # (P, N) mm: NaN where there is no truth or no prediction
    take: NDArray[np.int64]  # (P,) int: Which take each pose is from
    steps: float = float("nan")  # mean number of optimisation steps; NaN if nothing was optimised

    @property
    def mpjpe(self) -> float:
        """Mean over joints and poses, mm."""
        return float(np.nanmean(self.joints))

    @property
    def poses(self) -> Array:
        """Mean error (P,) of each pose, mm."""
        known = np.isfinite(self.joints)
        total = np.where(known, self.joints, 0.0).sum(axis=1)
        with np.errstate(invalid="ignore"):
            return np.asarray(total / known.sum(axis=1))


def errors_of(sample: Sample, poses: Sequence[Array], steps: float = float("nan")) -> Errors:
    """Return the errors of predicted `poses`, one array (P, N, 3) per group of the sample."""
    joints = [
        group.poses.rig.mm_per_unit * np.linalg.norm(pose - group.poses.truth, axis=-1)
        for group, pose in zip(sample.groups, poses, strict=True)
    ]
    return Errors(np.concatenate(joints), np.concatenate([group.take for group in sample.groups]), steps)


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

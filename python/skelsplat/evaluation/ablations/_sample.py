"""Poses on which settings are compared: for every setting the same, with the same detections and starts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import skelsplat as sk
from skelsplat.datasets import Dataset, Take
from skelsplat.evaluation._views import without_lens
from skelsplat.evaluation.protocols import Protocol
from skelsplat.exceptions import InvalidInputError

FloatArray = NDArray[np.float64]
Start = Literal["dlt", "fusion"]


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Poses that the same cameras see; arrays as in `skelsplat.datasets.Take`, with P poses of several takes.

    Attributes
    ----------
    rig : CameraRig of M cameras
    truth : (P, N, 3)
    detections : (P, M, N, 3)
    monocular : (P, V, N, 3) or None
    take : (P,) int
        Which take each pose is from.
    """

    rig: sk.CameraRig
    truth: FloatArray
    detections: FloatArray
    monocular: FloatArray | None
    take: NDArray[np.int64]

    def start(self, kind: Start) -> FloatArray:
        """Return the initial poses (P, N, 3): unweighted triangulation, or fusion of the monocular poses."""
        if kind == "dlt":
            return sk.triangulate(self.detections[..., :2], self.rig, method="dlt")
        if self.monocular is None:
            raise InvalidInputError("start: expected monocular poses to fuse, got a data set without")
        return sk.fuse_monocular(self.monocular, self.detections, self.rig)

    def first_views(self, count: int) -> Group:
        """Return the group with its first `count` cameras, which are also the only ones to estimate poses."""
        monocular = None if self.monocular is None else self.monocular[:, :count]
        return replace(self, rig=self.rig[:count], detections=self.detections[:, :count], monocular=monocular)


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """Poses of one data set with the detections of one detector.

    Attributes
    ----------
    name : str
        Short, for rows of a table: ``"H36M, metrabs"``.
    dataset : str
        ``"human36m"``, ``"human36m-occ-2"``, …; tells which rows of the paper it belongs to.
    layout : Layout
    groups : tuple of Group
    source : str
        A line that goes under every table.
    n_available : int
        Poses that the data set has.
    paper_fields : mapping
        What the paper changes in its settings on this data set.
    """

    name: str
    dataset: str
    layout: sk.Layout
    groups: tuple[Group, ...]
    source: str
    n_available: int
    paper_fields: Mapping[str, Any] = field(default_factory=dict)

    @property
    def n_poses(self) -> int:
        """Number of poses."""
        return sum(len(group.truth) for group in self.groups)

    @property
    def n_views(self) -> int:
        """The least number of cameras of any rig."""
        return min(len(group.rig) for group in self.groups)

    @property
    def has_monocular(self) -> bool:
        """Whether all poses come with monocular estimates."""
        return all(group.monocular is not None for group in self.groups)

    def starts(self, kind: Start) -> list[FloatArray]:
        """Return the initial poses of every group."""
        return [group.start(kind) for group in self.groups]

    def first_views(self, count: int) -> Sample:
        """Return the sample with the first `count` cameras of every rig."""
        return replace(self, groups=tuple(group.first_views(count) for group in self.groups))

    def head(self, poses: int) -> Sample:
        """Return about `poses` poses, evenly from all takes."""
        share = poses / max(self.n_poses, 1)
        return replace(
            self, groups=tuple(_thinned(g, max(1, round(share * len(g.truth)))) for g in self.groups)
        )


def sample(
    dataset: Dataset, protocol: Protocol, poses: int | None, *, name: str, key: str, undistort: bool
) -> Sample:
    """Take `poses` poses of a data set (None: all), evenly over the takes that its protocol counts.

    Parameters
    ----------
    dataset : Dataset
    protocol : Protocol
        Its frames, views and exclusions.
    poses : int or None
    name, key : str
        `Sample.name` and `Sample.dataset`.
    undistort : bool
        False: cameras lose their lens, so that detections are used with K alone.

    Raises
    ------
    InvalidInputError
        If a take has no detections, or no pose is left.
    """
    takes = [case.take for case in protocol.cases(dataset) if case.absolute]
    total = sum(len(take) for take in takes)
    if total == 0:
        raise InvalidInputError(f"{dataset.name}: expected poses whose absolute error counts, got none")
    chosen = np.arange(total) if poses is None or poses >= total else _evenly(total, poses)
    groups = _grouped(takes, chosen)
    if not undistort:
        groups = [replace(group, rig=without_lens(group.rig)) for group in groups]
    return Sample(name, key, dataset.layout, tuple(groups), dataset.source, total, protocol.paper_fields)


def _grouped(takes: Sequence[Take], chosen: NDArray[np.int64]) -> list[Group]:
    """Join the chosen poses, numbered over all takes, of takes with the same cameras."""
    parts: list[tuple[sk.CameraRig, list[Group]]] = []
    first = 0
    for number, take in enumerate(takes):
        here = chosen[(chosen >= first) & (chosen < first + len(take))] - first
        first += len(take)
        if len(here) == 0:
            continue
        group = _group(take.select(here), number)
        known = next((members for rig, members in parts if rig is take.rig or rig == take.rig), None)
        if known is None:
            parts.append((take.rig, [group]))
        else:
            known.append(group)
    return [_joined(members) for _, members in parts]


def _evenly(total: int, count: int) -> NDArray[np.int64]:
    return ((np.arange(count) + 0.5) * total / count).astype(np.int64)


def _thinned(group: Group, count: int) -> Group:
    keep = _evenly(len(group.truth), min(count, len(group.truth)))
    monocular = None if group.monocular is None else group.monocular[keep]
    return Group(group.rig, group.truth[keep], group.detections[keep], monocular, group.take[keep])


def _group(take: Take, number: int) -> Group:
    if take.detections is None:
        raise InvalidInputError(f"{take.key}: expected detections, got a data set read without")
    return Group(take.rig, take.truth, take.detections, take.monocular, np.full(len(take), number))


def _joined(groups: list[Group]) -> Group:
    monocular = [group.monocular for group in groups if group.monocular is not None]
    return Group(
        groups[0].rig,
        np.concatenate([group.truth for group in groups]),
        np.concatenate([group.detections for group in groups]),
        np.concatenate(monocular) if len(monocular) == len(groups) else None,
        np.concatenate([group.take for group in groups]),
    )

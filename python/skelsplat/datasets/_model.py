"""What every reader gives: takes of one person each, and recordings of several, with cameras and truth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from skelsplat._arrays import FARTHEST, Array, Index, Mask, positive, take_people
from skelsplat._skelsplat import Layout
from skelsplat.cameras import CameraRig
from skelsplat.exceptions import DatasetError


@dataclass(frozen=True, slots=True, eq=False)
class Take:
    """One take of one person, T frames seen by M cameras that do not move; NaN where something is missing."""

    key: str  #: Unique within the data set, as ``"S9/Directions 1"``.
    subject: str
    action: str  #: Without a number behind it.
    rig: CameraRig  #: Its unit is that of `truth` and `monocular`.
    frames: Index  #: (T,), the numbers of the source, of which there are `fps` per second.
    truth: Array  #: (T, N, 3), world.
    detections: Array | None = None  #: (T, M, N, 3), pixels and confidence; NaN, NaN, 0 where missing.
    monocular: Array | None = None  #: (T, V, N, 3), world poses of V monocular estimates.
    boxes: Array | None = None  #: (T, M, 4), left, top, right, bottom in pixels.
    fps: float | None = None
    #: Where ``"truth"``, ``"detections"``, ``"cameras"``, … come from, for messages.
    files: Mapping[str, Path] = field(default_factory=dict)

    def __post_init__(self) -> None:
        t, m = len(self.frames), len(self.rig)
        n = self.truth.shape[1] if self.truth.ndim == 3 else None
        _check(self, truth=(t, n, 3), detections=(t, m, n, 3), monocular=(t, None, n, 3), boxes=(t, m, 4))

    def __len__(self) -> int:
        return len(self.frames)

    def select(self, keep: Mask | Index | slice) -> Take:
        """Return the take with only the frames `keep`."""
        return self._cut(("frames", "truth", "detections", "monocular", "boxes"), keep)

    def _cut(self, names: Sequence[str], *index: Any, **changes: Any) -> Take:
        values = {name: getattr(self, name) for name in names}
        changes |= {name: None if value is None else value[index] for name, value in values.items()}
        return replace(self, **changes)

    def with_detections(self, values: Array, path: Path) -> Take:
        """Return the take with detections (T, M, N, 3) from a file or folder."""
        return replace(self, detections=values, files={**self.files, "detections": path})

    def with_views(self, places: Sequence[int]) -> Take:
        """Return the take with only the cameras at these places, in this order.

        Monocular poses are cut with the views if there is one per camera.
        """
        chosen = list(places)
        if chosen == list(range(len(self.rig))):
            return self
        per_view = self.monocular is not None and self.monocular.shape[1] == len(self.rig)
        arrays = ("detections", "boxes", *(["monocular"] if per_view else []))
        return self._cut(arrays, slice(None), chosen, rig=_some(self.rig, chosen))

    @property
    def detected(self) -> float | None:
        """Share of joints in all views and frames that are detected; None without detections."""
        if self.detections is None or not self.detections.size:
            return None
        return float(np.isfinite(self.detections[..., 0]).mean())

    @property
    def labelled(self) -> float | None:
        """Share of joints in all frames that have a truth; None without frames."""
        return float(np.isfinite(self.truth[..., 0]).mean()) if self.truth.size else None


@dataclass(frozen=True, slots=True, eq=False)
class PeopleTake:
    """One recording of Q people, T frames seen by M cameras that do not move; else as `Take`."""

    key: str
    rig: CameraRig
    frames: Index
    #: (T, M, P, N, 3), up to P detections per view in an order that means nothing; NaN where nothing is.
    people: Array
    truth: Array  #: (Q, T, N, 3), world; NaN where not labelled.
    names: tuple[str, ...]
    slots: Index  #: (Q, T, M), oracle association: which of the P detections shows whom; −1 = none.
    fps: float
    waived: tuple[str, ...] = ()  #: Names of people who need not be found, and do not count.
    files: Mapping[str, Path] = field(default_factory=dict)

    def __post_init__(self) -> None:
        t, m, q = len(self.frames), len(self.rig), len(self.names)
        n = self.people.shape[3] if self.people.ndim == 5 else None
        _check(self, people=(t, m, None, n, 3), truth=(q, t, n, 3), slots=(q, t, m))

    def __len__(self) -> int:
        return len(self.frames)

    def select(self, keep: Mask | slice) -> PeopleTake:
        """Return the take with only the frames `keep`."""
        return replace(
            self,
            frames=self.frames[keep],
            people=self.people[keep],
            truth=self.truth[:, keep],
            slots=self.slots[:, keep],
        )

    def with_views(self, places: Sequence[int]) -> PeopleTake:
        """Return the take with only the cameras at these places, in this order."""
        chosen, rig = list(places), _some(self.rig, places)
        return replace(self, rig=rig, people=self.people[:, chosen], slots=self.slots[..., chosen])

    def detections(self) -> Array:
        """Return the detections of each person, (Q, T, M, N, 3), by oracle association."""
        return take_people(self.people, self.slots)

    def optional(self, least_views: int = 0) -> Mask:
        """Who need not be found, (Q, T): those waived, and whom fewer than `least_views` views detect."""
        waived = np.isin(self.names, self.waived)[:, None]
        return np.asarray(waived | ((self.slots >= 0).sum(axis=-1) < least_views))

    def apart(self, subject: str) -> tuple[Take, ...]:
        """Return a take per person who counts, in the frames with a truth, by oracle association."""
        takes = []
        for name, truth, found in zip(self.names, self.truth, self.detections(), strict=True):
            there = np.isfinite(truth).any(axis=(1, 2))
            if name in self.waived or not there.any():
                continue
            seen = found[there]
            seen[np.isnan(seen[..., 0])] = (np.nan, np.nan, 0.0)
            key, frames = f"{self.key}/{name}", self.frames[there]
            take = (key, subject, name, self.rig, frames, truth[there], seen)
            takes.append(Take(*take, fps=self.fps, files=self.files))
        return tuple(takes)


def _check(take: Take | PeopleTake, **shapes: tuple[int | None, ...]) -> None:
    """Raise `DatasetError` for arrays of another shape (None = any length) or with numbers out of range."""
    for name, shape in shapes.items():
        value = getattr(take, name)
        if value is None:
            continue
        file = next((take.files[one] for one in (name, "truth", "detections") if one in take.files), take.key)
        given = zip(value.shape, shape, strict=False)
        if value.ndim != len(shape) or any(want not in (got, None) for got, want in given):
            expected = f"shape ({', '.join('any' if n is None else str(n) for n in shape)})"
            raise DatasetError(file, name, expected, value.shape)
        if value.dtype.kind == "f" and (np.abs(value) > FARTHEST).any():
            expected = f"numbers within ±{FARTHEST:g}, NaN where missing"
            raise DatasetError(file, name, expected, f"{value[np.abs(value) > FARTHEST][0]:g}")


def _some(rig: CameraRig, places: Sequence[int]) -> CameraRig:
    return CameraRig([rig[i] for i in places], rig.unit)


@dataclass(frozen=True, slots=True, eq=False)
class Dataset:
    """Takes that share a layout.

    `detector` says where the detections come from, such as ``"metrabs"``; `source` goes under every table:
    what the data are, simulated or not, oracle or not; `notes` say what was left out or assumed on reading.
    `scenes` are recordings of several people in which nothing says who is who, if the source has them;
    `takes` then has their people one by one, by oracle association.
    """

    name: str
    layout: Layout
    takes: tuple[Take, ...]
    detector: str | None = None
    source: str = ""
    notes: tuple[str, ...] = field(default=())
    scenes: tuple[PeopleTake, ...] = field(default=())

    def __post_init__(self) -> None:
        keys = [take.key for take in self.takes]
        if len(set(keys)) != len(keys):
            raise DatasetError(self.name, "takes", "different keys", sorted(keys))
        for take in self.takes:
            if take.truth.shape[1] != self.layout.n_joints:
                expected = f"{self.layout.n_joints} joints of {self.layout.name}"
                raise DatasetError(take.key, "truth", expected, take.truth.shape[1])

    def with_fps(self, fps: float) -> Dataset:
        """Return the data set with this rate of the frame numbers of all takes."""
        positive("fps", fps)
        takes = tuple(replace(take, fps=fps) for take in self.takes)
        return replace(self, takes=takes, scenes=tuple(replace(scene, fps=fps) for scene in self.scenes))

    def __iter__(self) -> Iterator[Take]:
        return iter(self.takes)

    def __len__(self) -> int:
        return len(self.takes)

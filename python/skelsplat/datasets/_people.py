"""Recordings of several people, in which nothing says which detection shows whom."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from skelsplat._arrays import Array, Index, Mask, corners
from skelsplat._optional import require
from skelsplat._skelsplat import project
from skelsplat.cameras import CameraRig
from skelsplat.datasets._model import Take
from skelsplat.exceptions import DatasetError

# A detection may be somebody's if its joints are this near to the projected ones on average, as a share of
# the diagonal of the person's box in the view; and if they have so many joints in common.
_NEAR, _FEWEST_JOINTS = 0.2, 4
_FORBIDDEN_PX = 1e6  # more than any allowed pairs cost together


@dataclass(frozen=True, slots=True, eq=False)
class PeopleTake:
    """One recording of Q people, T frames seen by M cameras that do not move.

    Attributes
    ----------
    key : str
        Unique within the data set.
    rig : CameraRig
        M cameras; its unit is that of `truth`.
    frames : (T,) int64
        Frame numbers of the source.
    people : (T, M, P, N, 3)
        Up to P detections per view, in an order that means nothing: pixels and confidence, NaN where there
        is nothing.
    truth : (Q, T, N, 3)
        World joints; NaN where not labelled.
    names : tuple of str
        Of the Q people.
    slots : (Q, T, M) int64
        Oracle association: which of the P detections shows whom; −1 = none.
    waived : tuple of str
        Names of people who need not be found, and do not count.
    fps : float
        Frames per second that `frames` count.
    files : mapping of str to Path
        As in `Take`.
    """

    key: str
    rig: CameraRig
    frames: Index
    people: Array
    truth: Array
    names: tuple[str, ...]
    slots: Index
    fps: float
    waived: tuple[str, ...] = ()
    files: Mapping[str, Path] = field(default_factory=dict)

    def __post_init__(self) -> None:
        t, m, q = len(self.frames), len(self.rig), len(self.names)
        most, n = self.people.shape[2:4] if self.people.ndim == 5 else (-1, -1)
        expected = {"people": (t, m, most, n, 3), "truth": (q, t, n, 3), "slots": (q, t, m)}
        for name, shape in expected.items():
            if getattr(self, name).shape != shape:
                raise DatasetError(self.key, name, f"shape {shape}", getattr(self, name).shape)

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
        chosen = list(places)
        rig = CameraRig([self.rig[i] for i in chosen], self.rig.unit)
        return replace(self, rig=rig, people=self.people[:, chosen], slots=self.slots[..., chosen])

    def detections(self) -> Array:
        """Return the detections of each person, (Q, T, M, N, 3), by oracle association."""
        frame, view = np.arange(len(self))[:, None], np.arange(len(self.rig))
        return np.where((self.slots >= 0)[..., None, None], self.people[frame, view, self.slots], np.nan)

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


def nearest_slots(truth: Array, rig: CameraRig, people: Array) -> Index:
    """Return which of the detections (T, M, P, N, 3) is nearest to each person's truth (Q, T, N, 3).

    In each view the pairs of least total distance in pixels; a pair that is too far apart is none. Needs
    SciPy. (Q, T, M), −1 = none.
    """
    assign = require("scipy.optimize", "oracle association", "evaluation").linear_sum_assignment
    out = np.full((*truth.shape[:2], len(rig)), -1, dtype=np.int64)
    projected = np.stack([np.asarray(project(one, rig)) for one in truth])  # (Q, M, T, N, 2)
    low, high = corners(projected)
    size = np.linalg.norm(high - low, axis=-1)
    for view in range(len(rig)):
        for t, found in enumerate(people[:, view, ..., :2]):
            gap = np.linalg.norm(projected[:, view, t, None] - found, axis=-1)  # (Q, P, N)
            common = np.isfinite(gap)
            count = common.sum(axis=-1)
            mean = np.where(common, gap, 0.0).sum(axis=-1) / np.maximum(count, 1)
            allowed = (count >= _FEWEST_JOINTS) & (mean <= _NEAR * size[:, view, t, None])
            person, slot = assign(np.where(allowed, mean, _FORBIDDEN_PX))
            fits = allowed[person, slot]
            out[person[fits], t, view] = slot[fits]
    return out

"""What detectors do wrong when several people are in the picture, view by view.

A joint behind another person is missing, taken from that person, or guessed. Two people who overlap may be
detected as one, one person as two, somebody not at all, and something that is nobody as somebody. All of it
lasts for a while.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import permutations
from typing import ClassVar

import numpy as np

from skelsplat._arrays import Array, Index, Mask, corners
from skelsplat._skelsplat import Layout
from skelsplat.exceptions import InvalidInputError
from skelsplat.synthetic.noise import Memory, Range, check_range

Draw = np.random.Generator
Instances = list[tuple[Array, Index]]

# Half the thickness of a body, mm: of arms and legs, by what the names of their ends contain, and elsewhere.
_THIN_MM, _THICK_MM = 60.0, 120.0
_THIN = ("wri", "elb", "kne", "ank", "toe", "heel", "hand")
_LOWER = ("kne", "ank", "toe", "heel", "hip", "pelvis")
_IN_FRONT_MM = 120.0  # by so much nearer the camera is in front
_OVERLAP = 0.3  # people overlap if their joints are this near on average, as a share of their height
# Standard deviations of a hidden joint that is guessed or taken from another, as a share of the height.
_GUESS, _TAKEN = 0.06, 0.01
_FEWEST_JOINTS = 3  # of a detection
_GHOST_HEIGHT = (0.15, 0.5)  # of the image


@dataclass(frozen=True, kw_only=True)
class Crowding:
    """How often a detector errs because several people are there; durations are uniform, in seconds."""

    hidden_missing: float = 0.4  #: Share of the joints hidden by another person that are missing.
    hidden_taken: float = 0.3  #: … reported at the same joint of that person; the rest is guessed.
    miss_rate: float = 0.03  #: Share of the time in which a person is overlooked.
    merge_rate: float = 0.3  #: … in which two overlapping people are one detection with joints of both.
    split_rate: float = 0.01  #: … in which a person is two: upper and lower, or left and right half.
    ghosts: float = 0.3  #: Mean number per view of false detections that stay in one place, such as a poster.
    ghost_rate: float = 0.03  #: Share of the time in which a view has a brief one.

    miss_s: ClassVar[Range] = (0.1, 0.6)
    merge_s: ClassVar[Range] = (0.1, 0.6)
    split_s: ClassVar[Range] = (0.1, 0.5)
    ghost_s: ClassVar[Range] = (0.05, 0.4)  # of the brief ones

    def __post_init__(self) -> None:
        check_range(self, 0.0, np.inf, "ghosts")
        check_range(self, 0.0, 1.0, *(entry.name for entry in fields(self) if entry.name != "ghosts"))
        if self.hidden_missing + self.hidden_taken > 1.0:
            shares = f"{self.hidden_missing!r} + {self.hidden_taken!r}"
            raise InvalidInputError(f"hidden_missing + hidden_taken: expected at most 1, got {shares}")

    @classmethod
    def none(cls) -> Crowding:
        """Return a detector that is not confused: hidden joints are missing, everything else is detected."""
        return cls(
            hidden_missing=1, hidden_taken=0, miss_rate=0, merge_rate=0, split_rate=0, ghosts=0, ghost_rate=0
        )

    @classmethod
    def heavy(cls) -> Crowding:
        """Return a detector that is confused about twice as often."""
        return cls(hidden_missing=0.2, hidden_taken=0.5, miss_rate=0.08, merge_rate=0.6, split_rate=0.03,
                   ghosts=1.0, ghost_rate=0.08)  # fmt: skip


def behind(pixels: Array, depth: Array, focal_px: float, layout: Layout) -> Index:
    """Who hides each joint in one view, (Q, T, N): the person in front of it, −1 = nobody.

    Takes true projections (Q, T, N, 2) px, also outside the image, and depths (Q, T, N) mm. Bodies are
    capsules along the limbs of the layout.
    """
    ends = np.array(layout.limbs)
    names = [(layout.joints[a] + layout.joints[b]).lower() for a, b in ends]
    radius = np.array([_THIN_MM if any(part in name for part in _THIN) else _THICK_MM for name in names])
    hidden = np.full(depth.shape, -1, dtype=np.int64)
    nearest = np.full(depth.shape, np.inf)
    low, high = pixels.min(axis=2), pixels.max(axis=2)  # NaN where somebody is absent
    for p, q in permutations(range(len(pixels)), 2):
        margin = _THICK_MM * focal_px / np.maximum(depth[p].min(axis=1), 1.0)[:, None]
        meet = ((low[p] - margin <= high[q]) & (low[q] <= high[p] + margin)).all(axis=1)
        far = _covered(pixels[q][meet], pixels[p][meet], depth[p][meet], ends, radius * focal_px)
        far[far >= depth[q][meet] - _IN_FRONT_MM] = np.inf
        nearer = far < nearest[q][meet]
        hidden[q][meet] = np.where(nearer, p, hidden[q][meet])
        nearest[q][meet] = np.minimum(far, nearest[q][meet])
    return hidden


def _covered(joints: Array, body: Array, depth: Array, ends: Index, radii: Array) -> Array:
    """Depth (F, N) of the nearest limb that covers joints (F, N, 2) px; infinite = none does.

    A limb between `ends` (L, 2) of a body (F, N, 2) covers what is within its radius (L,) over its depth.
    """
    start, along = body[:, None, ends[:, 0]], (body[:, ends[:, 1]] - body[:, ends[:, 0]])[:, None]
    near, far = depth[:, None, ends[:, 0]], depth[:, None, ends[:, 1]]
    offset = joints[:, :, None] - start  # (F, N, L, 2)
    u, v, du, dv = offset[..., 0], offset[..., 1], along[..., 0], along[..., 1]
    share = np.clip((u * du + v * dv) / np.maximum(du**2 + dv**2, 1e-12), 0.0, 1.0)
    at = near + share * (far - near)
    inside = (u - share * du) ** 2 + (v - share * dv) ** 2 <= (radii / np.maximum(at, 1.0)) ** 2
    nearest: Array = np.where(inside & (at > 0), at, np.inf).min(axis=-1)
    return nearest


@dataclass(frozen=True)
class View:
    """One view of a scene: what is detected of each person alone, and what they hide of each other."""

    alone: Array  # (Q, T, N, 3)
    hidden: Index  # (Q, T, N), from `behind`
    depth: Array  # (Q, T) of the bodies, mm; NaN = absent
    size: tuple[int, int]
    layout: Layout
    crowding: Crowding
    memory: Memory
    rng: Draw

    def instances(self) -> Instances:
        """Return detections (T, N, 3), all NaN where they are not there, and who each joint is (T, N)."""
        seen, owner = self._behind_others()
        self._merge(seen, owner)
        extra = [self._split(seen[q], owner[q]) for q in range(len(seen))]
        for q in range(len(seen)):
            missed = self._episodes(1, self.crowding.miss_rate, self.crowding.miss_s)[:, 0] > 0
            seen[q][missed] = np.nan
        return [_tidy(*one) for one in (*zip(seen, owner, strict=True), *extra, *self._ghosts())]

    def _episodes(self, series: int, rate: float, seconds: Range) -> Index:
        return self.memory.episodes(self.alone.shape[1], series, rate, seconds, self.rng)

    def _behind_others(self) -> tuple[Array, Index]:
        """Return detections and owners of each person; what others hide is missing, taken or guessed."""
        n_people, n_frames, n_joints = self.hidden.shape
        seen = self.alone.copy()
        owner = np.repeat(np.arange(n_people), n_frames * n_joints).reshape(self.hidden.shape)
        for q in range(n_people):
            stay = self._episodes(n_joints, 1.0, self.memory.guess_s)
            count = int(stay.max(initial=0)) + 1
            draw, offset = self.rng.random(count)[stay], self.rng.standard_normal((count, 2))[stay]
            confidence = self.rng.beta(5.0, 5.0, size=stay.shape)
            covered = (self.hidden[q] >= 0) & np.isfinite(seen[q, ..., 0])
            front = self.alone[self.hidden[q], np.arange(n_frames)[:, None], np.arange(n_joints)]
            missing = draw < self.crowding.hidden_missing
            taken = ~missing & (draw < self.crowding.hidden_missing + self.crowding.hidden_taken)
            error = _height(self.alone[q])[:, None, None] * np.pad(offset, ((0, 0), (0, 0), (0, 1)))
            front, guess = front + _TAKEN * error, seen[q] + _GUESS * error
            for which, value in ((missing, np.nan), (taken, front), (~missing & ~taken, guess)):
                seen[q] = np.where((covered & which)[..., None], value, seen[q])
            seen[q, ..., 2] = np.where(covered, confidence, seen[q, ..., 2])
            owner[q] = np.where(covered & taken, self.hidden[q], owner[q])
        return seen, owner

    def _merge(self, seen: Array, owner: Index) -> None:
        """Detect overlapping pairs as one, in place: the one in front gets joints of the other."""
        for a in range(len(seen)):
            for b in range(a):
                when = self._episodes(1, self.crowding.merge_rate, self.crowding.merge_s)[:, 0]
                share = self.rng.uniform(0.2, 0.5, size=(when.max(initial=0) + 1, 1))
                others = (self.rng.random((len(share), seen.shape[2])) < share)[when]
                merged = (when > 0) & self._overlap(a, b)
                for front, back in ((a, b), (b, a)):
                    now = merged & (self.depth[front] <= self.depth[back])
                    mixed = now[:, None] & others & np.isfinite(seen[back, ..., 0])
                    seen[front] = np.where(mixed[..., None], seen[back], seen[front])
                    owner[front] = np.where(mixed, owner[back], owner[front])
                    seen[back][now] = np.nan

    def _overlap(self, a: int, b: int) -> Mask:
        """Frames (T,) in which two people are at nearly the same place in the image."""
        gap = np.linalg.norm(self.alone[a, ..., :2] - self.alone[b, ..., :2], axis=-1)
        common = np.isfinite(gap)
        mean = np.where(common, gap, 0.0).sum(axis=1) / np.maximum(common.sum(axis=1), 1)
        height = np.minimum(_height(self.alone[a]), _height(self.alone[b]))
        return np.asarray((common.sum(axis=1) >= _FEWEST_JOINTS) & (mean < _OVERLAP * height))

    def _split(self, seen: Array, owner: Index) -> tuple[Array, Index]:
        """Detect a person as two in episodes: take one half of the joints out, in place, and return it."""
        when = self._episodes(1, self.crowding.split_rate, self.crowding.split_s)[:, 0]
        names = [joint.lower() for joint in self.layout.joints]
        lower = np.array([any(part in name for part in _LOWER) for name in names])
        left = np.isin(np.arange(len(names)), [pair[0] for pair in self.layout.left_right])
        sideways = (self.rng.random(when.max(initial=0) + 1) < 0.5)[when]
        half = np.where(sideways[:, None], left, lower) & (when > 0)[:, None]
        other = np.where(half[..., None], seen, np.nan)
        seen[half] = np.nan
        return other, owner

    def _ghosts(self) -> Instances:
        """Draw detections of nobody: some that stay where they are, and some that are gone at once."""
        n_frames, n_joints = self.alone.shape[1:3]
        out = []
        series = [
            (self._episodes(1, 0.8, (2.0, 10.0))[:, 0] > 0, np.zeros(n_frames, dtype=np.int64))
            for _ in range(self.rng.poisson(self.crowding.ghosts))
        ]
        brief = self._episodes(1, self.crowding.ghost_rate, self.crowding.ghost_s)[:, 0]
        for there, number in [*series, (brief > 0, brief)]:
            shapes = np.stack([self._shape() for _ in range(number.max(initial=0) + 1)])[number]
            pixels = shapes + self.rng.normal(0.0, 1.0, size=shapes.shape)
            ghost = np.concatenate([pixels, self.rng.beta(5.0, 5.0, size=(n_frames, n_joints, 1))], axis=2)
            ghost[~there] = np.nan
            out.append((ghost, np.full((n_frames, n_joints), -1)))
        return out

    def _shape(self) -> Array:
        """Joints (N, 2) px of somebody's body, elsewhere and of another size."""
        whole = np.argwhere(np.isfinite(self.alone[..., 0]).all(axis=-1))
        size = np.array(self.size, dtype=np.float64)
        if len(whole) == 0:
            return self.rng.uniform(0.2, 0.8, size=(self.alone.shape[2], 2)) * size
        person, frame = whole[self.rng.integers(len(whole))]
        body = self.alone[person, frame, :, :2]
        low, high = body.min(axis=0), body.max(axis=0)
        scale = self.rng.uniform(*_GHOST_HEIGHT) * size[1] / max(high[1] - low[1], 1.0)
        room = np.maximum(size - scale * (high - low), 0.0)
        shape: Array = scale * (body - low) + self.rng.random(2) * room
        return shape


def _height(seen: Array) -> Array:
    """Extent (T,) px of detections (T, N, 3) along the longer side of the image; 0 where there are none."""
    low, high = corners(seen[..., :2])
    return np.where((low <= high).any(axis=1), (high - low).max(axis=1), 0.0)


def _tidy(seen: Array, owner: Index) -> tuple[Array, Index]:
    """Drop detections of too few joints; missing joints are NaN and belong to nobody."""
    there = np.isfinite(seen[..., 0])
    there &= there.sum(axis=1, keepdims=True) >= _FEWEST_JOINTS
    return np.where(there[..., None], seen, np.nan), np.where(there, owner, -1)

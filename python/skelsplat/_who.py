"""Who is who among several people, while cameras are unknown and once they are found.

A view's figures are linked from frame to frame as long as nobody else could be meant. Of two views, the
tracks of the same people are those that one epipolar geometry explains: relative poses from each of the
longest pairs of tracks are tried, and the one is kept that explains most of all. What pairs of views say of
each two tracks is added up, and tracks are joined, best first, never two of a view in the same frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from operator import itemgetter

import numpy as np

from skelsplat import _skelsplat
from skelsplat._arrays import Array, Index, Mask, extents, medians, take_people
from skelsplat._clocks import in_step
from skelsplat._skelsplat import Camera, Layout
from skelsplat._start import (
    COMPARED,
    LEAST_JOINTS,
    Views,
    from_line,
    lags_of,
    off_lines,
    rays_of,
    relative,
    speeds_of,
)
from skelsplat._world import movement

# Empty frames between people: more than clocks are compared by.
GAP = 40
# A figure is the same in the next frame if its joints, in the median, moved by at most this part of its
# extent, and any other figure is so many times farther, and farther than this part of the extent.
_STEP = 0.25
_RIVAL = 2.0
_NEAR = 0.06
# Shorter tracks say nothing, frames; and the most that are matched in a view, the longest.
_LEAST_TRACK = 5
# Nor does one whose joints move less, relative to the size of the body: a poster, or somebody who stands.
_STILL = 0.06
_MOST_TRACKS = 200
# Frames by which the tracks of two views are compared, pairs of tracks from which a pose is tried, and the
# best of these, which are refined.
_FRAMES = 200
_SEEDS = 12
_REFINED = 2
# Distance from an epipolar line, relative to a figure's extent, that speaks neither for nor against two
# figures; a distance e times smaller counts 1, up to e² times, and one that is larger −1 at the worst.
_NEUTRAL = 0.03
_FOR, _AGAINST = 2.0, 1.0
# Somebody whom fewer views see may be a chance meeting of rays, if there are more; and one seen in fewer
# frames tells nothing.
_VIEWS = 3
_LEAST_FRAMES = 12
# Rate at which people are followed if none is given: that of most video.
_FPS = 25.0

#: Places (T, M) in P of one person, −1 where not seen.
Places = Index


def one_after_another(everyone: Sequence[Array], gap: int = GAP) -> Array:
    """Return the detections of several people as those of one recording, with empty frames between."""
    none = np.full((gap, *everyone[0].shape[1:]), np.nan)
    return np.concatenate([part for one in everyone for part in (none, one)][1:])


def first_frames(everyone: Sequence[Places]) -> list[int]:
    """Return the frame in which each person is first seen; 0 of a single one who was not told apart."""
    return [int(np.argmax((places >= 0).any(axis=1))) for places in everyone] or [0]


def taken(people: Array, everyone: Sequence[Places]) -> list[Array]:
    """Return everybody's detections (T', M, N, D) among people (T, M, P, N, D), without empty ends."""
    parts = []
    for places in everyone:
        there = np.flatnonzero((places >= 0).any(axis=1))
        own = slice(there[0], there[-1] + 1)
        parts.append(take_people(people[own], places[own]))
    return parts


def told_by_rig(
    people: Array,
    cameras: Mapping[int, Camera],
    clocks: Mapping[int, float],
    layout: Layout,
    fps: float | None,
) -> list[Places]:
    """Return everybody on whom three views, or both of two, agree, by the cameras of some views."""
    views, steps = list(cameras), len(people)
    right = in_step(people, {i: round(clocks[i]) for i in views})
    refiner = _skelsplat.Refiner(list(cameras.values()), layout=layout)
    found, _ = _skelsplat.people_identities(refiner, layout, right, fps or _FPS)
    everyone = []
    for first, slots in found:
        sure = (slots >= 0).sum(axis=1) >= min(_VIEWS, len(views))
        places = np.full(people.shape[:2], -1)
        for i, own in zip(views, slots.T, strict=True):
            frames = first + np.flatnonzero(sure) + round(clocks[i])
            inside = (frames >= 0) & (frames < steps)
            places[frames[inside], i] = own[sure][inside]
        if sure.sum() >= _LEAST_FRAMES:
            everyone.append(places)
    return everyone


def told_by_lines(people: Array, cameras: Sequence[Camera], most_lag: int, pairs: Views) -> list[Places]:
    """Return everybody whom two views show, by what the epipolar geometry of these pairs of views explains.

    ``people`` are (T, M, P, N, 2|3), distorted pixels, NaN where missing.
    """
    rays = np.stack([rays_of(people[:, :, p], cameras) for p in range(people.shape[2])], axis=2)
    views = [_View.of(rays[:, i], camera) for i, camera in enumerate(cameras)]
    ends = np.cumsum([0, *(view.count for view in views)])
    own = [slice(*pair) for pair in pairwise(ends)]
    speak: Array = np.zeros((ends[-1], ends[-1]))
    apart: Mask = np.zeros(speak.shape, dtype=np.bool_)
    for view, part in zip(views, own, strict=True):
        apart[part, part] = view.together
    for a, b in pairs:
        speak[own[a], own[b]] = _compared(views[a], views[b], most_lag)
    group = _joined(speak + speak.T, apart)
    everyone = []
    for one in np.unique(group):
        members = [np.flatnonzero(group[part] == one) for part in own]
        shown = [np.isin(view.tracks, tracks) for view, tracks in zip(views, members, strict=True)]
        if sum(map(np.any, shown)) >= 2:
            places = [np.where(some.any(axis=1), some.argmax(axis=1), -1) for some in shown]
            everyone.append(np.stack(places, axis=1))
    return everyone


@dataclass(frozen=True)
class _View:
    """What a view shows: rays (T, P, N, 2), and the number of each figure's track, (T, P), −1 for none."""

    rays: Array
    tracks: Index
    extent: float  # of its figures, in the median
    camera: Camera

    @classmethod
    def of(cls, rays: Array, camera: Camera) -> _View:
        tracks = _tracks(rays)
        sizes = extents(rays)[tracks >= 0]
        return cls(rays, tracks, float(np.median(sizes)) if len(sizes) else 0.0, camera)

    @property
    def count(self) -> int:
        """Of tracks."""
        return int(self.tracks.max(initial=-1)) + 1

    @property
    def together(self) -> Mask:
        """Which tracks are there in the same frame, (K, K), and each with itself."""
        there = (self.tracks == np.arange(self.count)[:, None, None]).any(axis=2).astype(np.float32)
        return np.asarray(there @ there.T > 0)

    def speeds(self) -> Array:
        """Return how fast everybody's joints move, (T, N): the sum over tracks."""
        none = np.zeros((len(self.rays), self.rays.shape[2]))
        return sum((speeds_of(self.of_track(k)) for k in range(self.count)), start=none)

    def of_track(self, number: int) -> Array:
        """Return the rays of a track, (T, N, 2)."""
        out = np.full((len(self.rays), *self.rays.shape[2:]), np.nan)
        frames, slots = np.nonzero(self.tracks == number)
        out[frames] = self.rays[frames, slots]
        return out


def _tracks(rays: Array) -> Index:
    """Return the number of the track of each figure (T, P), −1 for those in no long one that moves."""
    number: Index = np.full(rays.shape[:2], -1)
    there: Mask = np.any(np.isfinite(rays).all(axis=3), axis=2)
    sizes = np.maximum(extents(rays), np.finfo(float).tiny)
    count = 0
    for t, some in enumerate(there):
        if t and some.any() and there[t - 1].any():
            step = np.linalg.norm(rays[t][None] - rays[t - 1][:, None], axis=3)
            for p, q in _same(np.nan_to_num(medians(step), nan=np.inf) / sizes[t - 1, :, None]):
                number[t, q] = number[t - 1, p]
        new = np.flatnonzero(some & (number[t] < 0))
        number[t, new] = count + np.arange(len(new))
        count += len(new)
    length = np.bincount(number[number >= 0], minlength=count)
    longest = np.argsort(-length, kind="stable")[:_MOST_TRACKS]
    place: Index = np.full(count + 1, -1)  # the last is of no figure
    kept = [k for k in longest if length[k] >= _LEAST_TRACK and movement(rays[number == k]) > _STILL]
    place[kept] = np.arange(len(kept))
    return place[number]


def _same(apart: Array) -> Iterator[tuple[int, int]]:
    """Yield who of the figures of a frame is who in the next, by their distances (P, Q)."""
    for p, row in enumerate(apart):
        q = int(row.argmin())
        nearest = row[q]
        others = np.concatenate([np.delete(row, q), np.delete(apart[:, q], p)])
        if nearest <= _STEP and others.min(initial=np.inf) > max(_NEAR, _RIVAL * nearest):
            yield p, q


def _compared(a: _View, b: _View, most_lag: int) -> Array:
    """Return how much speaks for each two tracks of two views to be of one person, (Ka, Kb)."""
    if not (a.count and b.count):
        return np.zeros((a.count, b.count))
    best = 0
    if most_lag:
        candidates = lags_of(a.speeds(), b.speeds(), most_lag)
        best = max(map(int, candidates), key=lambda lag: _Pair.of(a, b, lag).explained(0)[0])
    return _Pair.of(a, b, best).explained()[1]


@dataclass(frozen=True)
class _Pair:
    """Figures of two views at the same time, each with each: rays (K, N, 2), and numbers of tracks (K,)."""

    x: Array
    y: Array
    i: Index
    j: Index
    apart: Mask  # tracks of both views that are there in the same frame
    count: int  # of tracks of the first view
    neutral: float
    farthest: float

    @classmethod
    def of(cls, a: _View, b: _View, lag: int) -> _Pair:
        """Return some frames in which the second view's clock is ahead by a lag."""
        frames = np.arange(max(0, -lag), len(a.rays) - max(0, lag))
        seen = (a.tracks[frames] >= 0).any(axis=1) & (b.tracks[frames + lag] >= 0).any(axis=1)
        frames = frames[seen]
        some = frames[np.linspace(0, len(frames) - 1, min(len(frames), _FRAMES)).astype(int)]
        there = (a.tracks[some][:, :, None] >= 0) & (b.tracks[some + lag][:, None] >= 0)
        k, p, q = np.nonzero(there)
        t, own = some[k], a.count
        apart = np.zeros((own + b.count, own + b.count), dtype=np.bool_)
        apart[:own, :own], apart[own:, own:] = a.together, b.together
        neutral, farthest = _NEUTRAL * (a.extent + b.extent) / 2, from_line(a.camera, b.camera)
        x, y, i, j = a.rays[t, p], b.rays[t + lag, q], a.tracks[t, p], b.tracks[t + lag, q]
        return cls(x, y, i, j, apart, own, neutral, farthest)

    def explained(self, refined: int = _REFINED) -> tuple[float, Array]:
        """Return how much the best relative pose explains, and what speaks for each two tracks.

        So many of the best are found again from all tracks that they join.
        """
        shape = (self.count, len(self.apart) - self.count)
        both = (np.isfinite(self.x) & np.isfinite(self.y)).all(axis=2).sum(axis=1)
        common = self.summed(both)
        longest = np.argsort(-common, axis=None, kind="stable")[:_SEEDS]
        seeds = [divmod(int(one), shape[1]) for one in longest if common.flat[one] >= LEAST_JOINTS]
        tried = [self.posed((self.i == i) & (self.j == j)) for i, j in seeds]
        tried.sort(key=lambda one: -one[0])
        for one in tried[:refined]:
            better = self.posed(one[2][self.i, self.j])
            while better[0] > one[0]:
                tried.append(better)
                one, better = better, self.posed(better[2][self.i, self.j])
        nothing = (0.0, np.zeros(shape), np.zeros(shape, dtype=np.bool_))
        return max(tried, key=itemgetter(0), default=nothing)[:2]

    def posed(self, chosen: Mask) -> tuple[float, Array, Mask]:
        """Return how much the pose from some figures explains, what speaks for two tracks, and who is who."""
        shape = (self.count, len(self.apart) - self.count)
        found = relative(self.x[chosen], self.y[chosen], 0, self.farthest, COMPARED)
        if found is None:
            return 0.0, np.zeros(shape), np.zeros(shape, dtype=np.bool_)
        speak = self.spoken(*found[:2])
        every = np.zeros(self.apart.shape)
        every[: self.count, self.count :] = speak
        group = _joined(every + every.T, self.apart)
        same: Mask = group[: self.count, None] == group[self.count :]
        return float(speak[same].sum()), speak, same

    def summed(self, values: Array) -> Array:
        """Return sums of values (K,) over all times at which two tracks are there, (Ka, Kb)."""
        wide = len(self.apart) - self.count
        sums = np.bincount(self.i * wide + self.j, values.astype(float), self.count * wide)
        return np.asarray(sums, dtype=np.float64).reshape(self.count, wide)

    def spoken(self, R: Array, t: Array) -> Array:
        """Return what speaks for each two tracks if a point x of one view is R x + t in the other."""
        squares = off_lines(self.x, self.y, R, t) / self.neutral**2
        score = np.clip(-0.5 * np.log(np.maximum(squares, np.exp(-2 * _FOR))), -_AGAINST, None)
        return self.summed(np.nan_to_num(score).sum(axis=1))


def _joined(speak: Array, apart: Mask) -> Index:
    """Return the group of each of K things, by what speaks for each two (K, K): best first, none `apart`."""
    speak = np.where(apart, -np.inf, speak)
    np.fill_diagonal(speak, -np.inf)
    group: Index = np.arange(len(speak))
    while len(speak):
        i, j = divmod(int(speak.argmax()), len(speak))
        if not speak[i, j] > 0:
            break
        speak[i] += speak[j]
        speak[:, i] = speak[i]
        speak[i, i] = speak[j] = speak[:, j] = -np.inf
        group[group == j] = i
    return group

"""Several people as one writes it in an afternoon: affinity of rays, greedy groups, DLT, nearest neighbour.

In every frame by itself, two detections in different views are as far apart as their rays to the same
joints, on average. The nearest two are put together, then the next, as long as no view is in a group twice
and the mean distance of all pairs of a group stays below a gate. Each group is triangulated by the DLT. Over
time, the nearest pose of the next frame continues a track.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from skelsplat._arrays import Array, Index
from skelsplat.cameras import CameraRig
from skelsplat.evaluation.baselines._observations import dlt

MIN_CONFIDENCE = 0.3
FEWEST_JOINTS = 5  # that two detections must have in common
# The highest IDF1 of 40, 50, 75, 100, 150 and 200 on 12 scenes of 3 people in 4 views, mixed and level.
PAIR_GATE_MM = 150.0
TRACK_GATE_MM = 400.0  # mean joint distance from where the track was last seen
FORGOTTEN_S = 1.0  # a track that is not continued for so long ends
SHORTEST_FRAMES = 5  # of a track


@dataclass
class Track:
    """One person over time."""

    identity: int
    frames: list[int] = field(default_factory=list)
    poses: list[Array] = field(default_factory=list)


def track(
    people: Array, cameras: CameraRig, *, fps: float, gate_mm: float = PAIR_GATE_MM
) -> list[tuple[int, Index, Array]]:
    """Track everybody in detections (T, M, P, N, 3), with cameras in mm.

    Returns
    -------
    list of (identity, frames (F,), poses (F, N, 3) mm)
    """
    return linked(found(people, cameras, gate_mm), fps)


def found(people: Array, cameras: CameraRig, gate_mm: float = PAIR_GATE_MM) -> list[Array]:
    """Return the poses (G, N, 3) mm of everybody in each frame by itself, in no order."""
    usable = np.where(people[..., 2:] >= MIN_CONFIDENCE, people, np.nan)
    groups = [grouped(frame, gate_mm) for frame in rays(usable, cameras)]
    views = np.arange(len(cameras))
    chosen = [
        np.where((places >= 0)[:, None, None], frame[views, places], np.nan)
        for frame, places_of_all in zip(usable, groups, strict=True)
        for places in places_of_all
    ]
    poses = dlt(np.array(chosen), cameras) if chosen else np.empty((0, *people.shape[3:]))
    bounds = np.cumsum([len(one) for one in groups])[:-1]
    return np.split(poses, bounds)


def rays(people: Array, cameras: CameraRig) -> list[tuple[Array, Array]]:
    """Return per frame the centres (M, 3) of the views and the directions (M, P, N, 3) of the detections."""
    directions = np.empty(people.shape)
    centres = np.empty((len(cameras), 3))
    for m, camera in enumerate(cameras):
        pixels = camera.undistort(people[:, m, ..., :2])
        homogeneous = np.concatenate([pixels, np.ones((*pixels.shape[:-1], 1))], axis=-1)
        direction = homogeneous @ np.linalg.inv(camera.K).T @ camera.R
        directions[:, m] = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
        centres[m] = -camera.R.T @ camera.t
    return [(centres, frame) for frame in directions]


def grouped(frame: tuple[Array, Array], gate_mm: float) -> list[Index]:
    """Return the groups of a frame, each as the place in P per view (M,), −1 = none."""
    centres, directions = frame
    n_views = len(centres)
    view, place = np.nonzero(np.isfinite(directions[..., 0]).any(axis=-1))
    far = distances(centres[view], directions[view, place])
    far[view[:, None] == view] = np.inf
    group = {k: [k] for k in range(len(view))}
    of = list(range(len(view)))
    a, b = np.nonzero(np.triu(far < gate_mm))
    for k in np.argsort(far[a, b]):
        one, other = of[a[k]], of[b[k]]
        if one == other or far[np.ix_(group[one], group[other])].mean() >= gate_mm:
            continue  # infinite where a view would be in the group twice
        for member in group[other]:
            of[member] = one
        group[one] += group.pop(other)
    out = []
    for members in group.values():
        if len(members) >= 2:
            places = np.full(n_views, -1)
            places[view[members]] = place[members]
            out.append(places)
    return out


def distances(centres: Array, directions: Array) -> Array:
    """Return the mean distance (D, D) mm of the rays to common joints, from (D, 3) along (D, N, 3)."""
    across = np.cross(directions[:, None], directions[None])
    length = np.linalg.norm(across, axis=-1)
    apart = np.abs(((centres[None] - centres[:, None])[:, :, None] * across).sum(axis=-1))
    gap = apart / np.maximum(length, 1e-6)
    common = np.isfinite(gap)
    count = common.sum(axis=-1)
    mean = np.where(common, gap, 0.0).sum(axis=-1) / np.maximum(count, 1)
    return np.where(count >= FEWEST_JOINTS, mean, np.inf)


def linked(frames: Sequence[Array], fps: float) -> list[tuple[int, Index, Array]]:
    """Continue tracks by the nearest poses (G, N, 3) of each frame, nearest pairs first."""
    alive: list[Track] = []
    ended: list[Track] = []
    begun = 0
    for t, poses in enumerate(frames):
        ended += [one for one in alive if t - one.frames[-1] > FORGOTTEN_S * fps]
        alive = [one for one in alive if t - one.frames[-1] <= FORGOTTEN_S * fps]
        gap = np.array([[moved(one.poses[-1], pose) for pose in poses] for one in alive])
        free_tracks, free_poses = set(range(len(alive))), set(range(len(poses)))
        for k in np.argsort(gap, axis=None):
            a, b = divmod(int(k), len(poses))
            if gap[a, b] < TRACK_GATE_MM and a in free_tracks and b in free_poses:
                alive[a].frames.append(t)
                alive[a].poses.append(poses[b])
                free_tracks.discard(a)
                free_poses.discard(b)
        for b in sorted(free_poses):
            alive.append(Track(begun, [t], [poses[b]]))
            begun += 1
    long = [one for one in ended + alive if len(one.frames) >= SHORTEST_FRAMES]
    return [(one.identity, np.array(one.frames), np.array(one.poses)) for one in long]


def moved(before: Array, now: Array) -> float:
    """Return the mean distance of the joints that both poses have; infinite without any."""
    gap = np.linalg.norm(now - before, axis=-1)
    there = np.isfinite(gap)
    return float(gap[there].mean()) if there.any() else np.inf

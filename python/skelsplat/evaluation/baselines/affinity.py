"""Several people as one writes it in an afternoon: affinity of rays, greedy groups, DLT, nearest neighbour.

In every frame by itself, two detections in different views are as far apart as their rays to the same
joints, on average. The nearest two are put together, then the next, as long as no view is in a group twice
and the mean distance of all pairs of a group stays below a gate. Each group is triangulated by the DLT. Over
time, the nearest pose of the next frame continues a track.
"""

from __future__ import annotations

from collections.abc import Sequence

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


def track(people: Array, cameras: CameraRig, *, fps: float) -> list[tuple[int, Index, Array]]:
    """Track everybody in detections (T, M, P, N, 3), cameras in mm: identity, frames, poses (F, N, 3)."""
    return linked(found(people, cameras), fps)


def found(people: Array, cameras: CameraRig) -> list[Array]:
    """Return the poses (G, N, 3) mm of everybody in each frame by itself, in no order."""
    usable = np.where(people[..., 2:] >= MIN_CONFIDENCE, people, np.nan)
    centres = np.array([-camera.R.T @ camera.t for camera in cameras])
    groups = [grouped(centres, frame) for frame in rays(usable, cameras)]
    views = np.arange(len(cameras))
    chosen = [
        np.where((places >= 0)[:, None, None], frame[views, places], np.nan)
        for frame, places_of_all in zip(usable, groups, strict=True)
        for places in places_of_all
    ]
    poses = dlt(np.array(chosen), cameras) if chosen else np.empty((0, *people.shape[3:]))
    return np.split(poses, np.cumsum([len(one) for one in groups])[:-1])


def rays(people: Array, cameras: CameraRig) -> Array:
    """Return the directions (T, M, P, N, 3) of the detections."""
    directions = np.empty(people.shape)
    for m, camera in enumerate(cameras):
        pixels = camera.undistort(people[:, m, ..., :2])
        homogeneous = np.concatenate([pixels, np.ones((*pixels.shape[:-1], 1))], axis=-1)
        direction = homogeneous @ np.linalg.inv(camera.K).T @ camera.R
        directions[:, m] = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    return directions


def grouped(centres: Array, directions: Array) -> list[Index]:
    """Group rays from (M, 3) along (M, P, N, 3): of each group the place in P per view (M,), −1 = none."""
    view, place = np.nonzero(np.isfinite(directions[..., 0]).any(axis=-1))
    far = distances(centres[view], directions[view, place])
    far[view[:, None] == view] = np.inf
    group = {k: [k] for k in range(len(view))}
    of = list(range(len(view)))
    a, b = np.nonzero(np.triu(far < PAIR_GATE_MM))
    for k in np.argsort(far[a, b]):
        one, other = of[a[k]], of[b[k]]
        if one == other or far[np.ix_(group[one], group[other])].mean() >= PAIR_GATE_MM:
            continue  # infinite where a view would be in the group twice
        for member in group[other]:
            of[member] = one
        group[one] += group.pop(other)
    out = []
    for members in group.values():
        if len(members) >= 2:
            places = np.full(len(centres), -1)
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
    tracks: list[dict[int, Array]] = []  # of each its poses by frame
    for t, poses in enumerate(frames):
        alive = [k for k, one in enumerate(tracks) if t - next(reversed(one)) <= FORGOTTEN_S * fps]
        last = [next(reversed(tracks[one].values())) for one in alive]
        gap = np.array([[moved(before, pose) for pose in poses] for before in last])
        free_tracks, free_poses = set(alive), set(range(len(poses)))
        for k in np.argsort(gap, axis=None):
            place, b = divmod(int(k), len(poses))
            if gap[place, b] < TRACK_GATE_MM and alive[place] in free_tracks and b in free_poses:
                tracks[alive[place]][t] = poses[b]
                free_tracks.discard(alive[place])
                free_poses.discard(b)
        for b in sorted(free_poses):
            tracks.append({t: poses[b]})
    return [
        (name, np.array(list(one)), np.array(list(one.values())))
        for name, one in enumerate(tracks)
        if len(one) >= SHORTEST_FRAMES
    ]


def moved(before: Array, now: Array) -> float:
    """Return the mean distance of the joints that both poses have; infinite without any."""
    gap = np.linalg.norm(now - before, axis=-1)
    there = np.isfinite(gap)
    return float(gap[there].mean()) if there.any() else np.inf

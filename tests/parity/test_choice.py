"""Ways to choose one person in a frame, against all of them weighed in NumPy."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic
from skelsplat._arrays import medians
from skelsplat._people import padded
from skelsplat._skelsplat import people_choices
from skelsplat.association import extents
from skelsplat.layouts import mirror_images
from sweeps import swept

SIZE_COST = 1e-3


def choices(people, cameras, gates, *, min_confidence, min_joints, mirror, most, worse):
    """Return frame, slots, cost and pose of each frame's cheapest different ones, as `people_choices`."""
    usable = np.where(people[..., 2:] >= min_confidence, people, np.nan)
    shares = extents(usable) / np.array([np.hypot(*camera.size) for camera in cameras])[:, None]
    evidence = _Evidence(usable, shares, cameras, np.asarray(gates), min_joints, np.asarray(mirror))
    step, index, cost, pose = evidence.weighed()
    kept, seen, least = [], {}, np.full(len(people), np.inf)
    np.minimum.at(least, step, cost)
    for row in np.lexsort((cost, step)).tolist():
        known, choice = seen.setdefault(int(step[row]), set()), tuple(index[row].tolist())
        if len(known) < most and choice not in known and cost[row] <= least[step[row]] + worse:
            known.add(choice)
            kept.append(row)
    return step[kept], index[kept], cost[kept], pose[kept]


@dataclass(frozen=True)
class _Evidence:
    people: np.ndarray  # (T, M, P, K, 3) usable detections
    shares: np.ndarray  # (T, M, P) their extent as a part of the image's diagonal
    cameras: sk.CameraRig
    gates: np.ndarray  # (M,) largest median reprojection error, px
    min_joints: int  # that must be in common for a comparison
    mirrored: np.ndarray  # (K,) place of every joint's mirror image

    def weighed(self):
        """Weigh all hypotheses."""
        return self._weigh(self._pairs())

    def _pairs(self):
        """Hypotheses (H, 5): frame, view, person, other view, other person."""
        enough = np.isfinite(self.people[..., :2]).all(axis=-1).sum(axis=-1) >= self.min_joints
        found = [np.empty((0, 5), dtype=np.int64)]
        for i, j in combinations(range(self.people.shape[1]), 2):
            t, a, b = np.nonzero(enough[:, i, :, None] & enough[:, j, None, :])
            found.append(np.stack([t, np.full_like(t, i), a, np.full_like(t, j), b], axis=1))
        rows = np.concatenate(found)
        return rows[np.argsort(rows[:, 0], kind="stable")]

    def _weigh(self, pairs):
        """Frame (C,), person per view (C, M), cost (C,) and pose (C, K, 3) of the hypotheses that hold."""
        if not len(pairs):
            views, joints = self.people.shape[1], self.people.shape[3]
            return pairs[:, 0], np.empty((0, views), dtype=np.int64), np.empty(0), np.empty((0, joints, 3))
        step, pose = pairs[:, 0], self._triangulate(pairs)
        error = self._errors(step, pose)
        index = error.argmin(axis=2)
        error = error.min(axis=2)
        explained = error < 1.0
        index[~explained] = -1
        count = explained.sum(axis=1)
        cost = (
            explained.shape[1]
            - count
            + medians(np.where(explained, error, np.nan))
            + SIZE_COST * (1.0 - self._size(step, index))
        )
        holds = np.flatnonzero(count >= 2)
        return step[holds], index[holds], cost[holds], pose[holds]

    def _triangulate(self, pairs):
        """Poses (H, K, 3) of the pairs, each from its two views alone."""
        step, i, a, j, b = pairs.T
        rows = np.arange(len(pairs))
        seen = np.full((len(pairs), self.people.shape[1], *self.people.shape[3:]), np.nan)
        seen[rows, i] = self.people[step, i, a]
        seen[rows, j] = self.people[step, j, b]
        return np.asarray(sk.triangulate(seen, self.cameras, method="dlt"))

    def _errors(self, step, pose):
        """Median reprojection error as a part of the gate, (H, M, P); infinite without common joints."""
        pixels = np.moveaxis(np.asarray(sk.project(pose, self.cameras)), 0, 1)
        people = self.people[step][..., :2]

        def median(seen):
            offset = seen - pixels[:, :, None]
            distance = np.hypot(offset[..., 0], offset[..., 1])
            error = medians(distance, self.min_joints) / self.gates[:, None]
            return np.where(np.isnan(error), np.inf, error)

        if (self.mirrored == np.arange(len(self.mirrored))).all():
            return median(people)
        return np.minimum(median(people), median(people[:, :, :, self.mirrored]))

    def _size(self, step, index):
        """How large the people are in the images, (H,): mean extent as a part of the diagonal, below 1."""
        own = self.shares[step[:, None], np.arange(index.shape[1]), index]
        shown = np.where(index >= 0, own, 0.0)
        return shown.sum(axis=1) / np.maximum((index >= 0).sum(axis=1), 1)


@pytest.mark.parametrize(("people", "views", "layout"), [(2, 4, True), (3, 3, False), swept(5, 6, True)])
def test_choices_are_those_of_the_twin(people, views, layout):
    """The same slots, costs and bodies; the twin also weighs pairs whose rays never meet."""
    scene = synthetic.simulate_scene(people, synthetic.ring(views, radius_mm=4500.0), n_frames=12, seed=views)
    everyone = np.asarray(padded(scene.people))
    mirror = mirror_images(17, sk.layouts.H36M17.left_right if layout else ())
    gates = [0.03 * np.hypot(*camera.size) for camera in scene.cameras]
    rules = {"min_confidence": 0.2, "min_joints": 4, "mirror": mirror.tolist(), "most": 8, "worse": 2.0}
    step, slots, cost, pose = people_choices(scene.cameras, everyone, gates, **rules)
    twin = choices(everyone, scene.cameras, gates, **rules)
    assert len(step) > 12
    np.testing.assert_array_equal(step, twin[0])
    np.testing.assert_array_equal(slots, twin[1])
    np.testing.assert_allclose(cost, twin[2], atol=1e-9)
    np.testing.assert_allclose(pose, twin[3], atol=1e-3)

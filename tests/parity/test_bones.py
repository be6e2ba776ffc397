"""The search for the places of doubtful joints against its twin, and against every combination.

Both sides are float64: 1e-9 of a few metres.
"""

import numpy as np
import pytest

import scenes
import skelsplat as sk
from parity.bridge import rig
from reference import bones
from reference.arrays import Array
from reference.rays import make_rays
from skelsplat import _skelsplat

PLACE_MM = 1e-6
FRAMES = 40


def frame(seed: int, limbs: Array, truth: Array) -> tuple[bones.Search, Array]:
    """Positions that are off or missing, bones, detections (M,N,3): noise, many gross errors, misses."""
    rng, n = np.random.default_rng(seed), len(truth)
    views = scenes.small_rig(distance=4000.0)
    detections = np.ones((len(views), n, 3))
    detections[..., :2] = scenes.pixels(truth, views) + rng.normal(scale=1.0, size=(len(views), n, 2))
    detections[..., 2] = rng.uniform(0.4, 1.0, (len(views), n))
    wrong = rng.random((len(views), n)) < 0.4
    detections[wrong, :2] += rng.normal(scale=20.0, size=(np.count_nonzero(wrong), 2))
    detections[rng.random((len(views), n)) < 0.3] = np.nan
    points = truth + rng.normal(scale=60.0, size=truth.shape) * (rng.random((n, 1)) < 0.5)
    points[rng.random(n) < 0.15] = np.nan
    doubtful = rng.random(n) < 0.5
    ends = truth[limbs[:, 0]] - truth[limbs[:, 1]]
    lengths = np.linalg.norm(ends, axis=-1) * rng.uniform(0.85, 1.15, len(limbs))
    spreads = rng.uniform(20.0, 50.0, len(limbs))
    return bones.Search(
        points=points,
        bones=[
            (int(a), int(b), float(mean), float(sigma))
            for (a, b), mean, sigma in zip(limbs, lengths, spreads, strict=True)
        ],
        doubtful=doubtful,
        placed=np.isfinite(points[:, 0]) & (~doubtful | (rng.random(n) < 0.3)),
        sigma=rng.uniform(25.0, 40.0, n),
        variance=float(rng.uniform(50.0, 300.0)),
    ), detections


def core(search: bones.Search, detections: Array) -> Array:
    """Search with the package."""
    return np.asarray(
        _skelsplat.most_likely_places(
            search.points,
            detections,
            rig(scenes.small_rig(distance=4000.0)),
            bones=search.bones,
            doubtful=search.doubtful.tolist(),
            placed=search.placed.tolist(),
            sigma=search.sigma.tolist(),
            variance=search.variance,
        )
    )


# The limbs of Human3.6M-17 are a tree; one more between the hips and one between the shoulders close circles.
@pytest.mark.parametrize("more", [[], [(1, 4), (11, 14)]])
def test_the_most_likely_places_are_those_of_the_twin(more: list[tuple[int, int]]) -> None:
    limbs, moved = np.array([*sk.layouts.get("h36m17").limbs, *more]), 0
    for seed in range(FRAMES):
        search, detections = frame(seed, limbs, scenes.H36M_POSE)
        expected = bones.most_likely(make_rays(detections, scenes.small_rig(distance=4000.0)), search)
        found = core(search, detections)
        assert found == pytest.approx(expected, abs=PLACE_MM, nan_ok=True)
        assert np.array_equal(found[~search.doubtful], search.points[~search.doubtful], equal_nan=True)
        moved += np.count_nonzero(np.linalg.norm(found - search.points, axis=-1)[search.doubtful] > 1.0)
    assert moved > FRAMES

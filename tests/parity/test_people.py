"""Scores of several people against their NumPy twin.

Both sides are float64 sums of at most 17 terms of one sign: 1e-12.
"""

import numpy as np
import pytest

import scenes
import skelsplat as sk
from parity.bridge import rig
from reference import people as twin
from reference.arrays import Array
from skelsplat import _skelsplat

H36M = sk.layouts.get("h36m17")
SIGMA = 3.0 * sk.RefineConfig().sigma_mm
MIRROR = np.arange(17)
for left, right in H36M.left_right:
    MIRROR[[left, right]] = right, left


def crowd(seed: int, apart: float) -> tuple[Array, Array]:
    """Two people at a distance in random slots (M,3,17,3), a ghost, misses; and the pose of the first."""
    rng, views = np.random.default_rng(seed), scenes.small_rig(distance=4000.0)
    bodies = [scenes.H36M_POSE, scenes.H36M_POSE + np.array([apart, 0.3 * apart, 0.0])]
    out = np.ones((len(views), 3, 17, 3))
    for q, body in enumerate(bodies):
        out[:, q, :, :2] = scenes.pixels(body, views)
    out[:, 2, :, :2] = out[:, 0, :, :2] + rng.normal(scale=60.0, size=(len(views), 1, 2))
    out[..., :2] += rng.normal(scale=2.0, size=out[..., :2].shape)
    out[..., 2] = rng.uniform(0.3, 1.0, out.shape[:-1])
    out[rng.random(out.shape[:-1]) < 0.1] = np.nan
    out[0, 1] = np.nan
    out[1, 0] = out[1, 0, MIRROR]
    for view in out:
        rng.shuffle(view)
    pose = bodies[0] + rng.normal(scale=20.0, size=(17, 3))
    pose[rng.random(17) < 0.1] = np.nan
    return out, pose


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("apart", [250.0, 900.0])
def test_scores_are_those_of_the_twin(seed: int, apart: float) -> None:
    people, pose = crowd(seed, apart)
    views = scenes.small_rig(distance=4000.0)
    refiner = _skelsplat.Refiner(rig(views), layout="h36m17")
    at_body, pairs, support = _skelsplat.people_scores(refiner, "h36m17", people[None], pose[None])
    slots = twin.figures(people, views)
    expected = np.stack([twin.at_body(figure, pose, SIGMA, MIRROR) for figure in slots], axis=1)
    np.testing.assert_allclose(at_body, expected, rtol=1e-12, atol=1e-15)
    assert (expected > 0.6).any()
    assert ((expected > 0.0) & (expected < 0.3)).any()
    for i, p, k, q in np.ndindex(pairs.shape):
        score = twin.of_pair(slots[p], i, slots[q], k, SIGMA) if i != k else 0.0
        assert pairs[i, p, k, q] == pytest.approx(score, rel=1e-12, abs=1e-15)
    bones = twin.bones(H36M.joints, H36M.limbs)
    assert len(bones) == len(H36M.limbs)
    assert support == pytest.approx(twin.support(slots, pose, views, SIGMA, MIRROR, bones), rel=1e-12)
    assert support != 0.0

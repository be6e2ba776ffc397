"""`project` and `project_gaussians` against the twin, both in float64."""

import numpy as np
import pytest

import scenes
import skelsplat as sk
from parity.bridge import random_covariances, rig
from reference import projection
from reference.arrays import Array, Projected, View


def twin(means: Array, covariances: Array, views: list[View]) -> list[Projected]:
    return [projection.project_gaussians(means, covariances, view) for view in views]


def test_project_gaussians_equals_the_twin() -> None:
    views = scenes.small_rig()
    rng = np.random.default_rng(0)
    # A cube of 1.6 m: a good part of the points lies beyond the widened field of view of some camera.
    means = rng.uniform(-800, 800, (60, 3))
    covariances = random_covariances(60, 25.0, seed=1)
    means2d, covariances2d = sk.project_gaussians(means, covariances, rig(views))
    expected = twin(means, covariances, views)
    free = [projection.clamped_ratios(view.R @ mean + view.t, view) for view in views for mean in means]
    assert {ratio.free for pair in free for ratio in pair} == {True, False}
    assert means2d == pytest.approx(np.array([p.means2d for p in expected]), rel=0, abs=1e-9)
    assert covariances2d == pytest.approx(np.array([p.covariances2d for p in expected]), rel=1e-12, abs=1e-9)


def test_project_keeps_the_shape_and_is_nan_behind_the_camera() -> None:
    views = scenes.small_rig()
    points = np.random.default_rng(2).uniform(-300, 300, (5, 3, 3))
    points[2, 1] = views[1].R.T @ (np.array([10.0, 20.0, -50.0]) - views[1].t)
    found = sk.project(points, rig(views))
    assert found.shape == (4, 5, 3, 2)
    assert np.isnan(found[1, 2, 1]).all()
    ahead = np.ones((5, 3), dtype=bool)
    ahead[2, 1] = False
    expected = scenes.pixels(points[ahead], views)
    assert found[:, ahead] == pytest.approx(expected, rel=0, abs=1e-9)

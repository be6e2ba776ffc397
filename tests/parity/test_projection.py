"""`project` and `project_gaussians` against the twin, both in float64, and `render` against its images."""

from collections.abc import Callable

import numpy as np
import pytest

import scenes
import skelsplat as sk
from parity.bridge import camera, random_covariances, rig
from reference import projection, raster
from reference.arrays import Array, Projected, View
from reference.gaussian import covariances
from reference.projection import project_gaussians


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


IMAGE = 3e-5
"""Largest difference of a drawn pixel from the twin's.

The images are float32, drawn along rows by recurrences that start anew every 128 px. Each pixel adds about
two roundings of 6e-8, relative to values up to 1: 1.5e-5 at the end of a run, and twice that for safety.
"""


def assert_drawn(found: Array, expected: Array, centres: Array, shapes: Array) -> None:
    """Compare where rounding cannot move a joint's bell over the 1/255 cut: elsewhere both may be right."""
    assert (found.dtype, found.shape) == (np.float32, expected.shape)
    size = expected.shape[2], expected.shape[1]
    bells = np.array([raster.bell(m, s, size) for m, s in zip(centres, shapes, strict=True)])
    decided = ~np.any(np.abs(bells * 255 - 1) <= IMAGE, axis=0)
    assert np.abs(found - expected)[:, decided].max() < IMAGE


BUILDS = pytest.mark.parametrize("build", [scenes.three_joints, scenes.beyond_the_image, scenes.person])


@pytest.mark.parametrize("encoding", raster.ENCODINGS)
@BUILDS
def test_render_equals_the_twin(build: Callable[[], scenes.Scene], encoding: str) -> None:
    scene = build()
    sigma = covariances(scene.gaussians)
    drawn = 0
    for view in scene.views:
        projected = project_gaussians(scene.gaussians.means, sigma, view)
        expected = raster.render(projected, view.size, encoding)
        found = sk.render(scene.gaussians.means, sigma, camera(view), encoding=encoding)
        assert_drawn(found, expected, projected.means2d, projected.covariances2d)
        drawn += int(np.count_nonzero(expected))
    assert drawn > 1000


@pytest.mark.parametrize("encoding", raster.ENCODINGS)
@BUILDS
def test_pseudo_ground_truth_equals_the_twin(build: Callable[[], scenes.Scene], encoding: str) -> None:
    scene = build()
    sigma = scene.initial_covariances
    for view, points, expected in zip(scene.views, scene.detections, scene.targets(encoding), strict=True):
        found = sk.pseudo_ground_truth(points, scene.initial.means, sigma, camera(view), encoding=encoding)
        projected = project_gaussians(scene.initial.means, sigma, view)
        assert_drawn(found, expected, points[:, :2], projected.covariances2d)


def test_splat_wider_than_a_recurrence_equals_the_twin() -> None:
    view = scenes.small_rig(size=(420, 60), focal=900.0)[0]
    mean, sigma = np.array([[12.0, -30.0, 8.0]]), random_covariances(1, 400.0, seed=3)
    projected = project_gaussians(mean, sigma, view)
    expected = raster.render(projected, view.size)
    assert (expected > 0).all(axis=(0, 1)).sum() > 256
    found = sk.render(mean, sigma, camera(view))
    assert_drawn(found, expected, projected.means2d, projected.covariances2d)

"""`render` against the twin, and the moments of what it draws against the projected Gaussian."""

from collections.abc import Callable

import numpy as np
import pytest

import scenes
import skelsplat as sk
from parity.bridge import camera, random_covariances
from parity.tolerances import IMAGE, decided
from reference import raster
from reference.gaussian import covariances
from reference.projection import project_gaussians


@pytest.mark.parametrize("encoding", raster.ENCODINGS)
@pytest.mark.parametrize("build", [scenes.three_joints, scenes.beyond_the_image, scenes.person])
def test_render_equals_the_twin(build: Callable[[], scenes.Scene], encoding: str) -> None:
    scene = build()
    sigma = covariances(scene.gaussians)
    drawn = 0
    for view in scene.views:
        projected = project_gaussians(scene.gaussians.means, sigma, view)
        expected = raster.render(projected, view.size, encoding)
        found = sk.render(scene.gaussians.means, sigma, camera(view), encoding=encoding)
        assert found.dtype == np.float32
        assert found.shape == expected.shape
        shapes = zip(projected.means2d, projected.covariances2d, strict=True)
        bells = np.array([raster.bell(m, s, view.size) for m, s in shapes])
        assert np.abs(found - expected)[:, decided(bells)].max() < IMAGE
        drawn += int(np.count_nonzero(expected))
    assert drawn > 1000


def test_splat_wider_than_a_recurrence_equals_the_twin() -> None:
    view = scenes.small_rig(size=(420, 60), focal=900.0)[0]
    mean, sigma = np.array([[12.0, -30.0, 8.0]]), random_covariances(1, 400.0, seed=3)
    projected = project_gaussians(mean, sigma, view)
    expected = raster.render(projected, view.size)
    bells = raster.bell(projected.means2d[0], projected.covariances2d[0], view.size)[None]
    assert (expected > 0).all(axis=(0, 1)).sum() > 256
    found = sk.render(mean, sigma, camera(view))
    assert np.abs(found - expected)[:, decided(bells)].max() < IMAGE


def test_rgb_is_three_times_single() -> None:
    scene = scenes.three_joints()
    arguments = (scene.gaussians.means, covariances(scene.gaussians), camera(scene.views[0]))
    rgb, single = (sk.render(*arguments, encoding=encoding) for encoding in ("rgb", "single"))
    assert np.array_equal(rgb, np.repeat(single, 3, axis=0))


def test_joint_behind_the_camera_draws_nothing() -> None:
    view = scenes.small_rig()[0]
    behind = view.R.T @ (np.array([0.0, 0.0, -500.0]) - view.t)
    image = sk.render(np.stack([behind, np.zeros(3)]), np.tile(400.0 * np.eye(3), (2, 1, 1)), camera(view))
    assert not image[0].any()
    assert image[1].any()

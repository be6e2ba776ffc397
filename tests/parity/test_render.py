"""`render` against the twin, and the moments of what it draws against the projected Gaussian."""

from collections.abc import Callable

import numpy as np
import pytest

import scenes
import skelsplat as sk
from parity.bridge import camera, random_covariances, rig
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


def moment_factors() -> tuple[float, float]:
    """Tell what the cut and the clamp leave of the mass 2π√|Σ²| and of the covariance Σ², as factors.

    In whitened polar coordinates with w = ρ²/2 the mass is 2π√|Σ²| ∫ a dw and the second moment per axis
    2π√|Σ²| ∫ w a dw. The splat is a = 0.99 for w < c = −ln 0.99, e^−w up to L = ln 255 and zero beyond:

        ∫ a dw   = 0.99 c + (0.99 − 1/255)
        ∫ w a dw = 0.99 c²/2 + (1 + c)·0.99 − (1 + L)/255

    The measured covariance is Σ² times their ratio, 0.97824: the cut takes 2.2 %, the clamp adds 5e-5. Both
    regions are centrally symmetric, so the first moment is untouched.
    """
    peak, c, tail, L = 0.99, -np.log(0.99), 1 / 255, np.log(255)
    mass = peak * c + (peak - tail)
    second = peak * c**2 / 2 + (1 + c) * peak - (1 + L) * tail
    return float(mass), float(second / mass)


def test_moment_factors_equal_a_numerical_integral() -> None:
    w = (np.arange(2_000_000) + 0.5) * (np.log(255) / 2_000_000)
    a = np.minimum(0.99, np.exp(-w))
    width = w[1] - w[0]
    mass, ratio = moment_factors()
    assert mass == pytest.approx(a.sum() * width, rel=1e-9)
    assert ratio == pytest.approx((w * a).sum() / a.sum(), rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_moments_of_the_image_are_the_projected_gaussian(seed: int) -> None:
    """Draw a rotated anisotropic Gaussian and measure it.

    Sums over pixels stand for the integrals. The smooth part converges beyond all powers; the step of
    1/255 at the rim, an ellipse of radius 3.33 σ, does not: counting the pixels inside errs by about its
    radius to the 2/3, 20 px here (radius up to 100 px), each worth 1/255. Relative to the mass 2πσ² ≥
    1000 that is 1e-4; for the mean times 3.33 σ ≤ 100 px: 1e-2 px; for the covariance times 3.33²/2 =
    5.5: 6e-4.
    """
    rng = np.random.default_rng(seed)
    view = scenes.small_rig(size=(420, 380), focal=900.0)[seed]
    mean = rng.uniform(-40, 40, 3)[None]
    sigma = covariances(scenes.make_scene(mean, 42.0, [view], seed).gaussians)
    image = sk.render(mean, sigma, camera(view))[0].astype(float)
    assert not image[[0, -1]].any()
    assert not image[:, [0, -1]].any()
    means2d, covariances2d = sk.project_gaussians(mean, sigma, rig([view]))
    mass_factor, covariance_factor = moment_factors()
    v, u = np.mgrid[: view.size[1], : view.size[0]]
    p = np.stack([u, v], axis=-1).reshape(-1, 2)
    weights = image.ravel() / image.sum()
    measured_mean = weights @ p
    measured = (p - measured_mean).T @ (weights[:, None] * (p - measured_mean)) / covariance_factor
    root = np.sqrt(np.linalg.det(covariances2d[0, 0]))
    assert root > 160
    assert image.sum() == pytest.approx(2 * np.pi * root * mass_factor, rel=1e-4)
    assert measured_mean == pytest.approx(means2d[0, 0], abs=1e-2)
    scale = np.abs(covariances2d[0, 0]).max()
    assert measured == pytest.approx(covariances2d[0, 0], rel=0, abs=6e-4 * scale)


def test_joint_behind_the_camera_draws_nothing() -> None:
    view = scenes.small_rig()[0]
    behind = view.R.T @ (np.array([0.0, 0.0, -500.0]) - view.t)
    image = sk.render(np.stack([behind, np.zeros(3)]), np.tile(400.0 * np.eye(3), (2, 1, 1)), camera(view))
    assert not image[0].any()
    assert image[1].any()

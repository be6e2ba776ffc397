"""The default method against its twin: where the gradient vanishes, noise, weights, error bars, evidence.

Both sides are float64 and the systems have conditions below 1e4. The solver stops when a step is below
1e-9 of the noise, so that what remains of a gradient is 1e-9 of what it is a noise away.
"""

from typing import Any

import numpy as np
import pytest

import scenes
import skelsplat as sk
from parity.bridge import rig
from parity.test_triangulation import ring, with_outliers
from reference import annealed, evidence
from reference.arrays import Array, View
from reference.rays import make_rays, pixel_mm, weights
from skelsplat import _skelsplat

RELATIVE = 1e-6
EXACT = {"step_tolerance": 1e-9, "max_steps": 500}


def assert_same(
    found: sk.Refinement,
    problem: annealed.Problem,
    noise: float | None = None,
    widest: float = 320.0,
    end: float = 30.0,
) -> None:
    """Everything that follows from the positions and kernels, for a rig in mm."""
    rays, x = problem.rays, np.asarray(found.pose)
    sigma = np.sqrt(np.asarray(found.covariance)[:, 0, 0])
    pixel = pixel_mm(x, rays)
    variance = rays.mean_weight * float(found.noise) ** 2
    if noise is None:
        assert variance == pytest.approx(annealed.noise_variance(rays, x, sigma, pixel), rel=RELATIVE)
    there = rays.weight > 0
    k = np.divide(weights(x, rays, sigma), rays.weight, out=np.full(there.shape, np.nan), where=there)
    assert found.view_weights == pytest.approx(k, abs=RELATIVE, nan_ok=True)
    # A noise away from the solution the gradient is 1/noise for each view.
    slope = annealed.gradient(x, problem, sigma, variance) * float(found.noise)
    assert np.abs(slope).max() < 1e-4
    solution = annealed.Solution(x, sigma, variance, pixel)
    body = evidence.fixed_depth(solution, rays)
    share = annealed.RESIDUAL_SHARE
    if sigma.max() > 1.001 * end:  # the kernels follow the noise
        share = 1.0 - evidence.evidence(x, rays, variance, widest).wrong
        share *= len(x) / (len(x) - 2) if len(there) == 2 else 1.0  # Student's t
    posterior = annealed.posterior(problem, solution, body, share)
    all_agree = (k >= evidence.REJECTED).sum(axis=0) == there.sum(axis=0)
    assert np.count_nonzero(all_agree) > 3
    usual = all_agree & ~annealed.is_loud(rays, solution)
    assert found.uncertainty[usual] == pytest.approx(posterior[usual], rel=1e-5, abs=1e-5)
    louder = np.trace(found.uncertainty - posterior, axis1=1, axis2=2)
    assert (louder[all_agree & ~usual] > 0).all()
    assert (found.joint_status[all_agree & body & (there.sum(axis=0) > 1)] == "ok").all()


def seen(views: list[View]) -> Array:
    """Simulate detections (M,N,3) of which none is missing or wrong, in views that are equally sure."""
    detections = with_outliers(views, 0.0)
    detections[..., 2] /= detections[..., 2].mean(axis=1, keepdims=True) / 0.4
    exact = np.dstack([scenes.pixels(scenes.H36M_POSE, views), np.full((len(views), 17, 1), 0.8)])
    return np.asarray(np.where(np.isfinite(detections), detections, exact))


def refine(detections: Array, views: list[View], start: Array | None, **settings: Any) -> sk.Refinement:
    """Refine to the end, without the search for exchanged sides."""
    arguments = {name: settings.pop(name) for name in ("layout", "init_sigma") if name in settings}
    config = sk.RefineConfig(find_swaps=False, bones="free", **EXACT, **settings)
    return sk.refine(start, detections, rig(views), config=config, **arguments)


@pytest.fixture(params=[2, 4, 8])
def views(request: pytest.FixtureRequest) -> list[View]:
    return ring(request.param)


@pytest.mark.parametrize("tier", [0, 1, 3])
def test_without_a_start(views: list[View], tier: int) -> None:
    detections = seen(views)
    found = refine(detections, views, None, layout="h36m17", symmetry_tier=tier)
    pairs = scenes.symmetric_pairs(tier) if tier else ()
    assert_same(found, annealed.Problem(make_rays(detections, views), pairs))


def test_with_a_prior(views: list[View]) -> None:
    detections = seen(views)
    start = scenes.H36M_POSE + np.random.default_rng(3).normal(scale=30.0, size=(17, 3))
    axes = np.random.default_rng(4).normal(size=(17, 3, 3))
    covariance = 300.0 * axes @ axes.swapaxes(1, 2) + 100.0 * np.eye(3)
    found = refine(detections, views, start, init_sigma=covariance, layout="h36m17")
    prior = (start, np.linalg.inv(covariance))
    problem = annealed.Problem(make_rays(detections, views), scenes.symmetric_pairs(1), prior)
    assert_same(found, problem, noise=float(found.noise))


def test_with_other_settings(views: list[View]) -> None:
    detections = seen(views)
    view_weights = np.linspace(0.8, 1.0, len(views))
    theirs = {"sigma_mm": 20.0, "sigma_start_mm": 150.0, "sigma_decay": 0.7, "sigma_per_noise": 1.5}
    settings = {**theirs, "symmetry_sigma_mm": 8.0, "view_weights": view_weights}
    found = refine(detections, views, None, layout="h36m17", **settings)
    rays = make_rays(detections, views, view_weights)
    assert_same(found, annealed.Problem(rays, scenes.symmetric_pairs(1), None, 8.0), widest=150.0, end=20.0)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.6])
def test_the_evidence_of_a_pose(views: list[View], share: float) -> None:
    detections = with_outliers(views, share)
    detections[0, 3] = np.nan
    pose = scenes.H36M_POSE + np.random.default_rng(5).normal(scale=8.0, size=(17, 3))
    rays = make_rays(detections, views)
    expected = evidence.evidence(pose, rays, rays.mean_weight * 144.0, 320.0)
    bones = [(1, 2, 450.0, 20.0), (2, 3, 430.0, 5.0), (0, 7, 900.0, 30.0)]
    given = {"noise": 12.0, "widest": 320.0, "bones": bones}
    log, wrong, _ = _skelsplat.frame_evidence(pose, detections, rig(views), **given)
    against = evidence.against_bones(pose, rays, 12.0, 320.0, bones)
    assert log == pytest.approx(expected.log - against, rel=1e-9)
    assert wrong == pytest.approx(expected.wrong, rel=1e-9)


@pytest.mark.parametrize("best", [0.9, 0.2])
def test_how_far_views_compare(views: list[View], best: float) -> None:
    detections = seen(views)
    detections[:, :, 2] *= np.linspace(0.2, best, len(views))[:, None]
    pose, rays = scenes.H36M_POSE, make_rays(detections, views)
    given = {"noise": 12.0, "widest": 320.0, "bones": []}
    *_, factors = _skelsplat.frame_evidence(pose, detections, rig(views), **given)
    if best < 0.3 or len(views) < 3:
        assert factors is None
    else:
        expected = evidence.view_factors(pose, rays, 12.0, pixel_mm(pose, rays))
        assert factors == pytest.approx(expected, rel=1e-8)

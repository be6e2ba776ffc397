"""The default method against its twin: pose, number of steps, noise, weights and error bars.

Both sides are float64 and solve the same few dozen equations of condition below 1e4, one by Woodbury's
identity, the other densely: 1e-12 of a step. Weighted least squares forgets the differences of earlier steps.
"""

from typing import Any

import numpy as np
import pytest

import scenes
import skelsplat as sk
from parity.bridge import rig
from parity.test_triangulation import ring, with_outliers
from reference import annealed, consensus
from reference.arrays import Array, Mask, View
from reference.rays import Rays, make_rays, offsets, weights

POSE_MM = 1e-6
RELATIVE = 1e-9
TIE = 0.5
MARGIN = (0.75, 0.5)
"""Detections by which a pair of rays has to be better than what annealing found."""

Start = tuple[Array, Array]


def run_twin(
    detections: Array, views: list[View], start: Array | None, prior: Start | None = None, **settings: Any
) -> tuple[annealed.Problem, annealed.Solution]:
    """Solve from `start` (N,3), from triangulation if it is None, or with a prior (its pose, Π (N,3,3))."""
    view_weights, pairs = settings.pop("view_weights", None), settings.pop("pairs", ())
    rays = make_rays(detections, views, view_weights)
    chosen = annealed.Settings(**settings)
    located = consensus.locate(rays, chosen, MARGIN)
    if prior is not None:
        return with_prior(annealed.Problem(rays, pairs, prior, chosen), start, located)
    problem = annealed.Problem(rays, pairs, prior, chosen, located.widening)
    points, sigma = located.solution.points, located.solution.sigma
    if start is not None:
        lost = np.isnan(points).any(axis=1) & np.isfinite(start).all(axis=1)
        points, sigma = np.where(lost[:, None], start, points), np.where(lost, np.inf, sigma)
    return problem, annealed.solve(problem, points, sigma)


def with_prior(
    problem: annealed.Problem, start: Array, located: consensus.Located
) -> tuple[annealed.Problem, annealed.Solution]:
    """Solve under the noise that was estimated without the prior, narrow or wide as is likelier."""
    rays, settings = problem.rays, problem.settings
    filled = np.where(np.isfinite(start), start, consensus.starts(rays))
    noise = float(np.sqrt(located.solution.variance / rays.mean_weight))
    candidates = [(noise, located.widening)]
    if located.widening.follows_noise:
        candidates.append((located.narrow_noise, annealed.Widening()))
    found = []
    for noise_mm, widening in candidates:
        chosen = problem._replace(settings=settings._replace(noise_mm=noise_mm), widening=widening)
        found.append((chosen, annealed.solve(chosen, filled, np.full(len(filled), settings.widest))))
    scale = consensus.anywhere(rays, settings)
    return max(found, key=lambda f: consensus.evidence(f[1], rays, scale, problem.prior).log)


def assert_same(found: sk.Refinement, problem: annealed.Problem, expected: annealed.Solution) -> None:
    """Everything that follows from the solution, for a rig in mm."""
    assert int(found.n_iter) == expected.n_iter
    assert (str(found.stop_reason) == "converged") == expected.converged
    assert found.pose == pytest.approx(expected.points, abs=POSE_MM, nan_ok=True)
    noise = np.sqrt(expected.variance / problem.rays.mean_weight)
    assert float(found.noise) == pytest.approx(noise, rel=RELATIVE)
    known = np.isfinite(expected.points).all(axis=1)
    splat = expected.sigma[known, None, None] ** 2 * np.eye(3)
    assert found.covariance[known] == pytest.approx(splat, rel=RELATIVE)

    k = np.divide(
        weights(expected.points, problem.rays, expected.sigma),
        problem.rays.weight,
        out=np.full(problem.rays.weight.shape, np.nan),
        where=problem.rays.weight > 0,
    )
    k[:, ~known] = np.nan
    assert found.view_weights[:, known] == pytest.approx(k[:, known], abs=RELATIVE, nan_ok=True)

    body = consensus.fixed_depth(expected, problem.rays)
    posterior = annealed.posterior(problem, expected, body)
    status = statuses(problem.rays, expected, body)
    for j in np.flatnonzero(known):
        x, sigma = expected.points[j], float(expected.sigma[j])
        for at, share in consensus.rivals(problem.rays, j, x, sigma, TIE):
            posterior[j] += share * np.outer(at - x, at - x)
            status[j] = "weak" if status[j] == "ok" else status[j]
    assert list(found.joint_status) == list(status)
    assert np.array_equal(np.isnan(found.uncertainty), np.isnan(posterior))
    scale = np.nanmax(np.abs(posterior), axis=(1, 2), initial=1e-300)
    error = np.nanmax(np.abs(found.uncertainty - posterior), axis=(1, 2), initial=0.0)
    assert (error <= RELATIVE * scale).all()


def statuses(rays: Rays, solution: annealed.Solution, body: Mask) -> Array:
    """Status of each joint (N,) before ties are looked for."""
    k = np.divide(
        weights(np.nan_to_num(solution.points), rays, solution.sigma),
        rays.weight,
        out=np.zeros_like(rays.weight),
        where=rays.weight > 0,
    )
    known = np.isfinite(solution.points).all(axis=1)
    believed = np.count_nonzero((k >= consensus.REJECTED) & known, axis=0)
    seen = (rays.weight > 0).any(axis=0)
    return np.where(seen, np.where((believed > 1) & body, "ok", "weak"), "unobserved").astype(object)


def refine(detections: Array, views: list[View], start: Array | None, **settings: Any) -> sk.Refinement:
    """Refine without the search for exchanged sides."""
    arguments = {name: settings.pop(name) for name in ("layout", "init_sigma") if name in settings}
    config = sk.RefineConfig(find_swaps=False, bones="free", **settings)
    return sk.refine(start, detections, rig(views), config=config, **arguments)


@pytest.fixture(params=[2, 4, 8])
def views(request: pytest.FixtureRequest) -> list[View]:
    return ring(request.param)


def far_start(seed: int) -> Array:
    return np.asarray(scenes.H36M_POSE + np.random.default_rng(seed).normal(scale=80.0, size=(17, 3)))


def test_from_triangulation(views: list[View]) -> None:
    detections = with_outliers(views, 0.2)
    found = refine(detections, views, None)
    assert_same(found, *run_twin(detections, views, None))


def test_from_a_start(views: list[View]) -> None:
    detections = with_outliers(views, 0.2)
    start = far_start(1)
    start[5] = np.nan
    found = refine(detections, views, start)
    assert_same(found, *run_twin(detections, views, start))


def test_with_equal_limbs(views: list[View]) -> None:
    detections = with_outliers(views, 0.2)
    for tier in (1, 2, 3):
        found = refine(detections, views, far_start(2), layout="h36m17", symmetry_tier=tier)
        pairs = scenes.symmetric_pairs(tier)
        assert_same(found, *run_twin(detections, views, far_start(2), pairs=pairs))
    alone = refine(detections, views, far_start(2))
    assert np.nanmax(np.abs(found.pose - alone.pose)) > 1.0


def test_with_a_prior(views: list[View]) -> None:
    detections = with_outliers(views, 0.2)
    start = scenes.H36M_POSE + np.random.default_rng(3).normal(scale=30.0, size=(17, 3))
    pairs = scenes.symmetric_pairs(1)
    found = refine(detections, views, start, layout="h36m17", init_sigma=30.0)
    prior = (start, np.tile(np.eye(3) / 900.0, (17, 1, 1)))
    assert_same(found, *run_twin(detections, views, start, prior, pairs=pairs))

    axes = np.random.default_rng(4).normal(size=(17, 3, 3))
    covariance = 300.0 * axes @ axes.swapaxes(1, 2) + 100.0 * np.eye(3)
    found = refine(detections, views, start, init_sigma=covariance)
    # Inverses of matrices of condition up to 100 on either side.
    assert_same(found, *run_twin(detections, views, start, (start, np.linalg.inv(covariance))))


def test_with_other_settings(views: list[View]) -> None:
    detections = with_outliers(views, 0.2)
    theirs = {
        "sigma_mm": 20.0,
        "sigma_start_mm": 150.0,
        "sigma_decay": 0.7,
        "sigma_per_noise": 1.5,
        "symmetry_sigma_mm": 8.0,
        "max_steps": 9,
        "step_tolerance": 0.1,
        "view_weights": np.linspace(0.3, 1.0, len(views)),
    }
    ours = {
        "end": 20.0,
        "widest": 150.0,
        "factor": 0.7,
        "per_noise": 1.5,
        "symmetry_sigma": 8.0,
        "max_steps": 9,
        "tolerance": 0.1,
        "view_weights": theirs["view_weights"],
        "pairs": scenes.symmetric_pairs(1),
    }
    found = refine(detections, views, far_start(5), layout="h36m17", **theirs)
    assert_same(found, *run_twin(detections, views, far_start(5), **ours))


def test_joints_that_one_view_or_none_sees(views: list[View]) -> None:
    detections = with_outliers(views, 0.2)
    detections[1:, 3] = np.nan
    detections[0, 3] = [300.0, 200.0, 0.7]
    detections[:, 6] = np.nan
    pairs = scenes.symmetric_pairs(1)
    for start in (far_start(6), None):
        found = refine(detections, views, start, layout="h36m17")
        assert_same(found, *run_twin(detections, views, start, pairs=pairs))


@pytest.mark.parametrize("n_views", [4, 8])
def test_triangulation_where_most_are_wrong(n_views: int) -> None:
    views = ring(n_views)
    detections = with_outliers(views, 0.6)
    rays = make_rays(detections, views)
    expected = consensus.locate(rays, annealed.Settings(), MARGIN).solution
    pose, rejected = sk.triangulate(detections, rig(views), return_rejected=True)
    assert pose == pytest.approx(expected.points, abs=POSE_MM, nan_ok=True)
    e, _ = offsets(np.nan_to_num(expected.points), rays)
    far = np.sum(e**2, axis=-1) > 4 * np.log(4) * expected.sigma**2
    far &= np.isfinite(expected.points).all(axis=1)
    assert np.array_equal(rejected, far & (rays.weight > 0))
    assert rejected.any()


@pytest.mark.parametrize(("n_views", "sigma_px"), [(3, 10.0), (4, 10.0), (8, 10.0), (8, 25.0)])
def test_noise_beyond_the_configured_kernels(n_views: int, sigma_px: float) -> None:
    views = ring(n_views)
    detections = with_outliers(views, 0.0)
    detections[..., :2] += np.random.default_rng(9).normal(scale=sigma_px, size=(*detections.shape[:2], 2))
    pairs = scenes.symmetric_pairs(1)
    found = refine(detections, views, None, layout="h36m17")
    assert_same(found, *run_twin(detections, views, None, pairs=pairs))
    assert found.covariance[0, 0, 0] > 1.5 * 30.0**2
    start = scenes.H36M_POSE + np.random.default_rng(3).normal(scale=120.0, size=(17, 3))
    prior = (start, np.tile(np.eye(3) / 14400.0, (17, 1, 1)))
    found = refine(detections, views, start, init_sigma=120.0)
    assert_same(found, *run_twin(detections, views, start, prior))


def test_two_views_against_two() -> None:
    views = ring(4)
    detections = with_outliers(views, 0.0)
    elsewhere = scenes.H36M_POSE + np.array([1500.0, 0.0, 0.0])
    for i in (2, 3):
        seen = elsewhere @ views[i].R.T + views[i].t
        detections[i, :, :2] = (seen @ views[i].K.T)[:, :2] / seen[:, 2:]
    found = refine(detections, views, None)
    assert_same(found, *run_twin(detections, views, None))
    assert np.count_nonzero(found.joint_status == "weak") > 8


def test_cameras_in_nearly_one_place() -> None:
    views = ring(4)
    views.append(views[0]._replace(t=views[0].t + np.array([1.0, 0.0, 0.0])))
    detections = with_outliers(views, 0.0)
    detections[1:4, 3] = np.nan
    found = refine(detections, views, far_start(10))
    assert_same(found, *run_twin(detections, views, far_start(10)))
    assert found.joint_status[3] == "weak"

"""The equations of `adjust_cameras` against their dense twin, with lenses, late clocks and misses."""

import numpy as np
import pytest

import scenes
import skelsplat as sk
from reference import rig
from skelsplat import _skelsplat, _world

LENS = np.array([-0.12, 0.04, 1e-3, -5e-4, 0.01])


def test_the_equations_are_those_of_the_twin() -> None:
    rng, views = np.random.default_rng(3), scenes.small_rig(distance=4000.0)
    swing = np.linspace(-200.0, 300.0, 9)[:, None, None] * np.array([1.0, 0.3, -0.2])
    poses = scenes.H36M_POSE[:5] + swing
    clocks = [0.0, 1.3, 0.0, -0.6]
    twins = [rig.Camera(v.K, v.R, v.t, LENS, clock) for v, clock in zip(views, clocks, strict=True)]
    detections = np.ones((9, 4, 5, 3))
    for t, i, j in np.ndindex(9, 4, 5):
        detections[t, i, j, :2] = twins[i].pixel(poses[t, j], np.zeros(7)) + rng.normal(scale=4.0, size=2)
    detections[..., 2] = rng.uniform(0.4, 1.0, (9, 4, 5))
    detections[rng.random((9, 4, 5)) < 0.1] = np.nan
    points = poses + rng.normal(scale=15.0, size=poses.shape)
    cameras = sk.CameraRig([sk.Camera(v.K, v.R, v.t, distortion=LENS, size=v.size) for v in views])
    matrix, gradient, cost = _skelsplat.rig_equations(points, detections, cameras, clocks=clocks, sigma=40.0)
    expected = rig.equations(points, detections, twins, 40.0)
    assert cost == pytest.approx(expected[2], rel=1e-12)
    # The differences of the twin are exact to 1e-9 of a derivative.
    scale = np.sqrt(np.outer(np.diag(expected[0]), np.diag(expected[0])))
    assert np.abs((matrix - expected[0]) / scale).max() < 1e-6
    assert np.abs((gradient - expected[1]) / np.sqrt(np.diag(expected[0]))).max() < 1e-4
    assert np.abs(matrix - matrix.T).max() <= 1e-9 * np.abs(matrix).max()


STATURE, TILT = 1700.0, 0.06


def ankles(seed: int) -> np.ndarray:
    """Ankles on a plane that is not level, some of them in the air, mm."""
    rng = np.random.default_rng(seed)
    out = np.column_stack([rng.uniform(-1500, 1500, (200, 2)), rng.normal(0, 15, 200)])
    out[:, 2] += 0.04 * out[:, 0] - 0.02 * out[:, 1] + 900.0
    out[:20, 2] += rng.uniform(50, 300, 20)
    return out


@pytest.mark.parametrize("seed", [1, 2])
def test_the_plane_is_the_least_of_its_twin(seed: int) -> None:
    standing, sigma = ankles(seed), 0.02 * STATURE
    slope, height, error = _world._plane(standing, STATURE, TILT)
    plane, steps = np.array([*slope, height]), np.diag([1e-5, 1e-5, 1e-2])
    middle = standing - np.median(standing, axis=0)  # slopes and height are then independent
    plane[2] += np.median(standing, axis=0)[:2] @ slope - np.median(standing, axis=0)[2]

    def slopes(at: np.ndarray) -> np.ndarray:
        given = (middle, sigma, TILT)
        return np.array(
            [(rig.floor_cost(at + e, *given) - rig.floor_cost(at - e, *given)) / (2 * e.sum()) for e in steps]
        )

    # Steepness where the plane is, relative to that one standard error beside it.
    beside = plane + np.sqrt(np.diag(rig.floor_covariance(plane, middle, sigma, TILT)))
    assert np.abs(slopes(plane)).max() < 1e-3 * np.abs(slopes(beside)).max()
    assert (np.abs(slopes(plane)) < 1e-2 * np.abs(slopes(beside))).all()
    variance = np.trace(rig.floor_covariance(plane, middle, sigma, TILT)[:2, :2])
    assert error == pytest.approx(np.sqrt(variance), rel=1e-3)


def test_a_floor_that_is_not_level_is_found_within_its_error_bar() -> None:
    found, *_, error = _world._plane(ankles(3), STATURE, TILT)
    assert np.linalg.norm(found - [0.04, -0.02]) < 2 * error

"""The floor of `calibrate_cameras` against its twin."""

import numpy as np
import pytest

from reference import floor
from skelsplat import _world

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
            [(floor.cost(at + e, *given) - floor.cost(at - e, *given)) / (2 * e.sum()) for e in steps]
        )

    # Steepness where the plane is, relative to that one standard error beside it.
    beside = plane + np.sqrt(np.diag(floor.covariance(plane, middle, sigma, TILT)))
    assert np.abs(slopes(plane)).max() < 1e-3 * np.abs(slopes(beside)).max()
    assert (np.abs(slopes(plane)) < 1e-2 * np.abs(slopes(beside))).all()
    variance = np.trace(floor.covariance(plane, middle, sigma, TILT)[:2, :2])
    assert error == pytest.approx(np.sqrt(variance), rel=1e-3)


def test_a_floor_that_is_not_level_is_found_within_its_error_bar() -> None:
    found, *_, error = _world._plane(ankles(3), STATURE, TILT)
    assert np.linalg.norm(found - [0.04, -0.02]) < 2 * error

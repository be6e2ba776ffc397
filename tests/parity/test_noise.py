"""Hierarchical scales of the noise against their twin: Newton steps end at the same, only minimum."""

import numpy as np
import pytest

from reference import noise
from skelsplat import _skelsplat

RELATIVE = 1e-7


@pytest.mark.parametrize("seed", range(4))
def test_scales_are_those_of_the_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    views, joints = 4, 9
    cell = np.arange(views * joints)
    freedom = rng.uniform(0.0, 3.0, cell.size) * (rng.random(cell.size) < 0.8)
    squares = freedom * rng.chisquare(3, cell.size) * np.where(cell % joints == 2, 30.0, 3.0)
    levels = [
        noise.Level(np.zeros(cell.size, dtype=int), 4.0),
        noise.Level(cell // joints, 6.0),
        noise.Level(cell % joints, 3.0),
        noise.Level(cell, 8.0),
    ]
    found = _skelsplat.noise_scales(
        squares, freedom, expected=9.0, levels=[(level.group.tolist(), level.certainty) for level in levels]
    )
    assert np.asarray(found) == pytest.approx(noise.variances(squares, freedom, 9.0, levels), rel=RELATIVE)

"""The equations of `adjust_cameras` against their dense twin, with lenses, late clocks and misses."""

import numpy as np
import pytest

import scenes
import skelsplat as sk
from reference import rig
from skelsplat import _skelsplat

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

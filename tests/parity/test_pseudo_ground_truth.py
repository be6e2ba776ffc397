"""`pseudo_ground_truth` against the twin."""

from collections.abc import Callable

import numpy as np
import pytest

import scenes
import skelsplat as sk
from parity.bridge import camera
from parity.tolerances import IMAGE, decided
from reference import raster
from reference.projection import project_gaussians


@pytest.mark.parametrize("encoding", raster.ENCODINGS)
@pytest.mark.parametrize("build", [scenes.three_joints, scenes.beyond_the_image, scenes.person])
def test_pseudo_ground_truth_equals_the_twin(build: Callable[[], scenes.Scene], encoding: str) -> None:
    scene = build()
    sigma = scene.initial_covariances
    for view, points, expected in zip(scene.views, scene.detections, scene.targets(encoding), strict=True):
        found = sk.pseudo_ground_truth(points, scene.initial.means, sigma, camera(view), encoding=encoding)
        assert found.dtype == np.float32
        assert found.shape == expected.shape
        projected = project_gaussians(scene.initial.means, sigma, view)
        shapes = zip(points[:, :2], projected.covariances2d, strict=True)
        bells = np.array([raster.bell(d, s, view.size) for d, s in shapes])
        assert np.abs(found - expected)[:, decided(bells)].max() < IMAGE


def test_missing_detections_leave_their_channel_empty() -> None:
    scene = scenes.three_joints()
    for i, j in ((1, 2), (3, 0)):
        image = sk.pseudo_ground_truth(
            scene.detections[i], scene.initial.means, scene.initial_covariances, camera(scene.views[i])
        )
        assert not image[j].any()
        assert all(image[k].any() for k in range(3) if k != j)

"""`pseudo_ground_truth` against the twin."""

import numpy as np
import pytest

import scenes
import skelsplat as sk
from parity.bridge import camera
from reference import raster
from reference.projection import project_gaussians

ABSOLUTE = 1e-6
"""Images are float32 with values up to 1: rounding is 6e-8, and the composites add and scale a few times."""


@pytest.mark.parametrize("encoding", raster.ENCODINGS)
@pytest.mark.parametrize("build", [scenes.three_joints, scenes.beyond_the_image, scenes.person])
def test_pseudo_ground_truth_equals_the_twin(build: type[scenes.Scene], encoding: str) -> None:
    scene = build()
    sigma = scene.initial_covariances
    for view, points, expected in zip(scene.views, scene.detections, scene.targets(encoding), strict=True):
        found = sk.pseudo_ground_truth(points, scene.initial.means, sigma, camera(view), encoding=encoding)
        assert found.dtype == np.float32
        assert found.shape == expected.shape
        projected = project_gaussians(scene.initial.means, sigma, view)
        shapes = zip(points[:, :2], projected.covariances2d, strict=True)
        bells = np.array([raster.bell(d, s, view.size) for d, s in shapes])
        # Within 1e-5 of the cut float32 may decide otherwise whether a pixel belongs to the heat map.
        decided = ~np.any(np.abs(bells * 255 - 1) < 1e-5, axis=0)
        assert np.abs(found - expected)[:, decided].max() < ABSOLUTE


def test_missing_detections_leave_their_channel_empty() -> None:
    scene = scenes.three_joints()
    for i, j in ((1, 2), (3, 0)):
        image = sk.pseudo_ground_truth(
            scene.detections[i], scene.initial.means, scene.initial_covariances, camera(scene.views[i])
        )
        assert not image[j].any()
        assert all(image[k].any() for k in range(3) if k != j)


def test_peak_stands_at_the_sub_pixel_detection() -> None:
    scene = scenes.three_joints()
    points = np.array([[50.0, 40.0], [61.25, 47.5], [30.5, 60.75]])
    images = sk.pseudo_ground_truth(
        points, scene.initial.means, scene.initial_covariances, camera(scene.views[0])
    )
    assert images[0, 40, 50] == 1.0
    assert images[1, 47, 61] == pytest.approx(images[1].max())
    assert images[1].max() < 1.0

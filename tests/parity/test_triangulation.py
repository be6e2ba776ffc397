"""`triangulate` (DLT, RANSAC) and `fuse_monocular` against the twin."""

import numpy as np
import pytest

import scenes
import skelsplat as sk
from parity.bridge import rig
from reference import triangulation
from reference.arrays import Array, View

EXACT_MM = 1e-8
"""Smallest singular vectors are good to machine epsilon × condition (1e3 here) × 4 m, 1e-9 mm."""


@pytest.fixture
def views() -> list[View]:
    return scenes.small_rig(focal=170.0, distance=3500.0)


@pytest.fixture
def noisy(views: list[View]) -> Array:
    found = scenes.pixels(scenes.H36M_POSE, views)
    found += np.random.default_rng(11).normal(scale=1.0, size=found.shape)
    return found


@pytest.mark.parametrize("source", ["none", "argument", "third channel"])
def test_noisy_detections_equal_the_twin(views: list[View], noisy: Array, source: str) -> None:
    confidence = np.random.default_rng(12).uniform(0.2, 1.0, noisy.shape[:2])
    if source == "none":
        found, expected = (
            sk.triangulate(noisy, rig(views), method="dlt"),
            triangulation.triangulate(noisy, views),
        )
    elif source == "argument":
        found = sk.triangulate(noisy, rig(views), method="dlt", confidence=confidence)
        expected = triangulation.triangulate(noisy, views, confidence)
    else:
        with_confidence = np.concatenate([noisy, confidence[..., None]], axis=-1)
        found = sk.triangulate(with_confidence, rig(views), method="dlt")
        expected = triangulation.triangulate(with_confidence, views)
    assert found == pytest.approx(expected, abs=EXACT_MM)
    assert np.linalg.norm(found - scenes.H36M_POSE, axis=1).max() > 1.0


def test_missing_detections_and_batches(views: list[View], noisy: Array) -> None:
    batch = np.stack([noisy, noisy])
    batch[1, 0, 3] = np.nan
    batch[1, :3, 4] = np.nan
    pose = sk.triangulate(batch, rig(views), method="dlt")
    assert pose.shape == (2, 17, 3)
    expected = [triangulation.triangulate(frame, views) for frame in batch]
    assert np.isnan(pose[1, 4]).all()
    assert np.isnan(pose).sum() == 3
    assert pose == pytest.approx(np.array(expected), abs=EXACT_MM, nan_ok=True)


def ring(n: int) -> list[View]:
    """Make n cameras around the scenes' person, at different heights, 640 × 480 px."""
    angles = 2 * np.pi * (np.arange(n) + 0.3) / n
    centres = [(4e3 * np.cos(a), 4e3 * np.sin(a), 300.0 + 200.0 * (k % 3)) for k, a in enumerate(angles)]
    return [scenes.look_at(np.array(c), np.zeros(3), (600.0, 610.0), (640, 480)) for c in centres]


def with_outliers(views: list[View], share: float) -> Array:
    """Make detections (M,17,3) with 1 px of noise, a share of them up to 200 px off, a tenth missing."""
    rng = np.random.default_rng(14)
    found = scenes.pixels(scenes.H36M_POSE, views) + rng.normal(scale=1.0, size=(len(views), 17, 2))
    far = rng.uniform(size=found.shape[:2]) < share
    found[far] += rng.uniform(-200.0, 200.0, found.shape)[far]
    found[rng.uniform(size=far.shape) < 0.1] = np.nan
    return np.concatenate([found, rng.uniform(0.2, 1.0, (*far.shape, 1))], axis=-1)


@pytest.mark.parametrize(("n_views", "share"), [(2, 0.3), (4, 0.3), (5, 0.4), (9, 0.5), (30, 0.6)])
def test_ransac_equals_the_twin(n_views: int, share: float) -> None:
    views = ring(n_views)
    detections = with_outliers(views, share)
    pose, rejected = sk.triangulate(detections, rig(views), method="ransac", return_rejected=True)
    expected_pose, expected_rejected = triangulation.ransac(detections, views)
    assert np.array_equal(rejected, expected_rejected)
    assert rejected.any() or n_views == 2
    assert pose == pytest.approx(expected_pose, abs=EXACT_MM, nan_ok=True)


def monocular_poses() -> Array:
    """Four views' guesses (4,17,3): the pose with errors of 10 to 80 mm."""
    rng = np.random.default_rng(13)
    spread = np.array([10.0, 20.0, 40.0, 80.0])[:, None, None]
    return np.asarray(scenes.H36M_POSE + spread * rng.normal(size=(4, 17, 3)))


def test_fusion_equals_the_twin(views: list[View], noisy: Array) -> None:
    poses = monocular_poses()
    found = sk.fuse_monocular(poses, noisy, rig(views))
    # A weighted mean of numbers near 1000 mm, in float64 on both sides.
    assert found == pytest.approx(triangulation.fuse_monocular(poses, noisy, views), abs=1e-9)
    errors = np.linalg.norm(found - scenes.H36M_POSE, axis=1).mean()
    assert errors < np.linalg.norm(poses.mean(axis=0) - scenes.H36M_POSE, axis=1).mean()


def test_fusion_of_a_batch_with_missing_detections(views: list[View], noisy: Array) -> None:
    poses = monocular_poses()
    batch = np.stack([noisy, noisy])
    batch[1, 2, 8] = np.nan
    found = sk.fuse_monocular(np.stack([poses, poses]), batch, rig(views))
    expected = [triangulation.fuse_monocular(poses, frame, views) for frame in batch]
    assert found == pytest.approx(np.array(expected), abs=1e-9)
    assert not np.array_equal(found[0, 8], found[1, 8])

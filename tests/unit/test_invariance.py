"""What must not change an answer: the order of cameras, joints and frames, the world's axes, the unit."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

import skelsplat as sk
from skelsplat.synthetic import DetectionNoise
from sweeps import swept
from troubled import Array, Scene, room, troubled

# Another order of sums, another frame or unit rounds coordinates of 1e4 mm differently, by 2e-12 mm. A joint
# that only the length of its limb holds multiplies that by its condition, (error bar / noise)² up to 1e4, and
# a pose takes up to 50 steps: 1e-6 mm. Every decision (which detections agree, whether sides are exchanged,
# when the steps are small) is the same: none of these scenes has one that hangs on the last digits.
ROUNDING_MM = 1e-6

PAPER = sk.RefineConfig.paper(max_steps=10, stop_tolerance=0.0)

METHODS = ["robust", "dlt", "ransac"]
HARD = DetectionNoise.occluded(3, hard=True)
VIEWS = [4, 8, swept(6)]


def assert_same(found: sk.Refinement, expected: sk.Refinement) -> None:
    """Assert the same poses, error bars, weights and decisions, to rounding."""
    within = {"rtol": 0, "equal_nan": True}
    np.testing.assert_allclose(found.pose, expected.pose, atol=ROUNDING_MM, **within)
    np.testing.assert_array_equal(found.joint_status, expected.joint_status)
    np.testing.assert_array_equal(found.swapped, expected.swapped)
    np.testing.assert_array_equal(found.stop_reason, expected.stop_reason)
    # k and pixels change by less than 1 per mm, and so does the logarithm of a covariance.
    np.testing.assert_allclose(found.view_weights, expected.view_weights, atol=ROUNDING_MM, **within)
    np.testing.assert_allclose(
        found.reprojection_error, expected.reprojection_error, atol=ROUNDING_MM, **within
    )
    np.testing.assert_allclose(found.noise, expected.noise, atol=ROUNDING_MM, **within)
    size = np.linalg.norm(expected.uncertainty, axis=(-2, -1), keepdims=True)
    np.testing.assert_allclose(
        found.uncertainty / size, expected.uncertainty / size, atol=ROUNDING_MM, **within
    )


def assert_bits(found: sk.Refinement, expected: sk.Refinement) -> None:
    for field in fields(sk.Refinement):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(expected, field.name), field.name)


def in_views(result: sk.Refinement, order: Array) -> sk.Refinement:
    """Return what `result` is in another order of views."""
    per_view = ("view_weights", "swapped", "reprojection_error")
    return replace(result, **{name: getattr(result, name)[..., order, :] for name in per_view})


def in_joints(result: sk.Refinement, order: Array) -> sk.Refinement:
    per_view = ("view_weights", "swapped", "reprojection_error", "joint_status")
    moved = {name: getattr(result, name)[..., order] for name in per_view}
    moved |= {name: getattr(result, name)[:, order] for name in ("pose", "uncertainty")}
    return replace(result, **moved)


def scenes(n_views: int) -> list[Scene]:
    return [
        troubled(n_views),
        troubled(n_views, noise=HARD),
        troubled(n_views, noise=DetectionNoise(sigma_px=15.0)),
    ]


@pytest.mark.parametrize("n_views", VIEWS)
def test_the_order_of_the_cameras(n_views: int) -> None:
    for scene in scenes(n_views):
        expected = scene.refine()
        order = np.random.default_rng(n_views).permutation(n_views)
        assert_same(scene.of_views(order).refine(), in_views(expected, order))


@pytest.mark.parametrize(("method", "n_views"), [("robust", 8), ("dlt", 8), ("ransac", 4), ("ransac", 5)])
def test_the_order_of_the_cameras_in_triangulate(method: str, n_views: int) -> None:
    """RANSAC draws pairs of more than five views by their numbers; of five it tries all."""
    for scene in scenes(n_views):
        expected = scene.triangulate(method)
        for seed in range(3):
            order = np.random.default_rng(seed).permutation(n_views)
            found = scene.of_views(order).triangulate(method)
            np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING_MM, equal_nan=True)


def relabelled(order: Array) -> sk.Layout:
    """Human3.6M-17 whose joint k is joint `order[k]` of the original."""
    own = sk.layouts.H36M17
    names = own.joints
    tiers = [own.symmetric_pairs(tier) for tier in range(4)]
    symmetric = [
        (tier, [names[j] for j in left], [names[j] for j in right])
        for tier in (1, 2, 3)
        for left, right in tiers[tier]
        if (left, right) not in tiers[tier - 1]
    ]
    return sk.Layout(
        "relabelled",
        [names[k] for k in order],
        limbs=[[names[j] for j in limb] for limb in own.limbs],
        left_right=[[names[j] for j in pair] for pair in own.left_right],
        symmetric=symmetric,
    )


@pytest.mark.parametrize("n_views", VIEWS)
def test_the_order_of_the_joints(n_views: int) -> None:
    order = np.random.default_rng(n_views).permutation(17)
    for scene in scenes(n_views):
        other = replace(scene, detections=scene.detections[:, :, order])
        assert_same(other.refine(layout=None), in_joints(scene.refine(layout=None), order))
        # The population's bones are those of the built-in layouts.
        free = sk.RefineConfig(bones="free")
        expected = in_joints(scene.refine(config=free), order)
        assert_same(other.refine(layout=relabelled(order), config=free), expected)
        for method in METHODS if n_views == 4 else METHODS[:2]:
            found, before = other.triangulate(method), scene.triangulate(method)
            np.testing.assert_allclose(found, before[:, order], rtol=0, atol=ROUNDING_MM)


def rotation(seed: int) -> Array:
    q = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))[0]
    return q * np.linalg.det(q)


@pytest.mark.parametrize("n_views", [2, 8, swept(4), swept(6)])
def test_where_the_world_has_its_origin_and_axes(n_views: int) -> None:
    R, t = rotation(3), np.array([3000.0, -7000.0, 2000.0])

    def moved(camera: sk.Camera) -> sk.Camera:
        turned = camera.R @ R.T
        return sk.Camera(camera.K, turned, camera.t - turned @ t, size=camera.size)

    for scene in scenes(n_views) if n_views > 2 else [troubled(2)]:
        other = replace(scene, cameras=sk.CameraRig([moved(c) for c in scene.cameras]))
        found, expected = other.refine(), scene.refine()
        back = replace(found, pose=(found.pose - t) @ R, uncertainty=R.T @ found.uncertainty @ R)
        assert_same(back, expected)
        for method in METHODS:
            there = (other.triangulate(method) - t) @ R
            np.testing.assert_allclose(there, scene.triangulate(method), rtol=0, atol=ROUNDING_MM)


def in_unit(scene: Scene, unit: str, mm: float) -> Scene:
    cameras = [sk.Camera(c.K, c.R, c.t / mm, size=c.size) for c in scene.cameras]
    return replace(scene, cameras=sk.CameraRig(cameras, unit=unit))


@pytest.mark.parametrize(("unit", "mm"), [("cm", 10.0), ("m", 1000.0)])
def test_the_unit(unit: str, mm: float) -> None:
    for scene in scenes(4):
        other = in_unit(scene, unit, mm)
        found = other.refine()
        in_mm = replace(
            found, pose=found.pose * mm, uncertainty=found.uncertainty * mm**2, noise=found.noise * mm
        )
        assert_same(in_mm, scene.refine())
        for method in METHODS:
            there = other.triangulate(method) * mm
            np.testing.assert_allclose(there, scene.triangulate(method), rtol=0, atol=ROUNDING_MM)


def with_empty(scene: Scene) -> tuple[Scene, list[int]]:
    """Return a scene with a camera among the others that detects nothing, and the numbers of these."""
    n = len(scene.cameras)
    more = scene.with_view(room(n + 1)[n], np.full_like(scene.detections[:, 0], np.nan))
    order = [0, n, *range(1, n)]
    return more.of_views(order), [0, *range(2, n + 1)]


@pytest.mark.parametrize("n_views", [2, 3, 8, swept(4), swept(6)])
def test_a_camera_that_detects_nothing_changes_no_bit(n_views: int) -> None:
    for scene in scenes(n_views) if n_views > 2 else [troubled(2)]:
        more, others = with_empty(scene)
        found = in_views(more.refine(), np.array(others))
        assert_bits(found, scene.refine())
        for method in METHODS if n_views < 6 else METHODS[:2]:
            np.testing.assert_array_equal(more.triangulate(method), scene.triangulate(method))

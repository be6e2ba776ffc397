"""The twin checked against itself: central differences, closed forms, values known by hand."""

import numpy as np
import pytest

import scenes
from reference import adam, gaussian, paper_loop, projection, raster, symmetry, total, triangulation
from reference.arrays import Array, Gaussians
from sweeps import swept

GROUPS = ("means", "log_scales", "quaternions")


@pytest.mark.parametrize("encoding", ["one_hot", swept("rgb"), "single"])
def test_gradient_equals_central_differences(scene: scenes.Scene, encoding: str) -> None:
    images = scene.targets(encoding)

    def value(gaussians: Gaussians) -> float:
        result = total.loss_and_gradient(gaussians, scene.detections, scene.views, images, encoding=encoding)
        return result.loss

    result = total.loss_and_gradient(
        scene.gaussians, scene.detections, scene.views, images, encoding=encoding
    )
    numeric = scenes.central_differences(value, scene.gaussians)
    for group in GROUPS:
        error = scenes.worst_relative_error(getattr(result.gradient, group), getattr(numeric, group))
        assert error < 1e-6, group


def test_scenes_exercise_both_clamps(scene: scenes.Scene) -> None:
    classes = total.membership(scene.gaussians, scene.detections, scene.views)
    pixel_classes, ratio_classes = classes[::2], classes[1::2]
    assert any(np.any(image == 2) for image in pixel_classes)
    assert any(np.any(free == 0) for free in ratio_classes) == (len(scene.gaussians.means) == 2)
    assert any(np.all(free == 1) for free in ratio_classes)


@pytest.mark.parametrize("tier", [1, 2, 3])
def test_symmetry_gradient_equals_central_differences(tier: int) -> None:
    pairs, means = scenes.symmetric_pairs(tier), scenes.H36M_POSE
    value, gradient = symmetry.symmetry(means, pairs)
    assert value > 1.0
    numeric = np.zeros_like(means)
    # Lengths are 130 mm and more: truncation is (step/length)² < 1e-8 at a step of 0.01 mm.
    for index in np.ndindex(means.shape):
        step = np.zeros_like(means)
        step[index] = 0.01
        numeric[index] = (
            symmetry.symmetry(means + step, pairs)[0] - symmetry.symmetry(means - step, pairs)[0]
        ) / 0.02
    assert scenes.worst_relative_error(gradient, numeric) < 1e-6


def test_symmetry_of_known_lengths() -> None:
    means = np.array([[0.0, 0, 0], [3, 4, 0], [0, 0, 0], [0, 0, 7]])
    value, gradient = symmetry.symmetry(means, (((0, 1), (2, 3)),))
    assert value == pytest.approx(4.0)  # (5 − 7)²
    assert gradient[3] == pytest.approx([0, 0, 4.0])  # the longer one shrinks under descent


def test_pair_with_an_undetected_end_is_left_out() -> None:
    pairs = scenes.symmetric_pairs(1)
    observed = np.ones(17, dtype=bool)
    observed[13] = False
    assert symmetry.observed_pairs(pairs, observed) == (((5, 6), (2, 3)),)


@pytest.mark.parametrize("seed", range(3))
def test_rotation_matrix_rotates_as_the_quaternion_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    angle = rng.uniform(0, np.pi)
    quaternion = 1.7 * np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis])
    v = rng.normal(size=3)
    rodrigues = (
        v * np.cos(angle) + np.cross(axis, v) * np.sin(angle) + axis * (axis @ v) * (1 - np.cos(angle))
    )
    assert gaussian.rotation_matrix(quaternion) @ v == pytest.approx(rodrigues, abs=1e-14)


def test_jacobian_is_the_derivative_of_the_projection_inside_the_image() -> None:
    view, point = scenes.small_rig()[0], np.array([90.0, -60.0, 1900.0])
    numeric = np.zeros((2, 3))
    for k in range(3):
        step = np.zeros(3)
        step[k] = 1e-2
        ahead, back = ((view.K @ p)[:2] / p[2] for p in (point + step, point - step))
        numeric[:, k] = (ahead - back) / 2e-2
    assert projection.jacobian(point, view) == pytest.approx(numeric, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize(("u", "clamped"), [(137.4, 137.4), (138.0, 137.5), (-40.0, -18.5)])
def test_clamp_stands_15_percent_of_the_width_beyond_the_image(u: float, clamped: float) -> None:
    # 120 px wide: the image ends at -0.5 and 119.5, and is widened by 0.15 · 120 = 18 px on each side.
    view = scenes.small_rig()[0]
    point: Array = np.array(1000.0 * np.linalg.solve(view.K, [u, 50.0, 1.0]), dtype=np.float64)
    ratio = projection.clamped_ratios(point, view)[0]
    assert view.K[0, 0] * ratio.value + view.K[0, 2] == pytest.approx(clamped, abs=1e-9)
    assert ratio.free == (clamped == u)


def test_composite_of_white_joints_is_what_no_joint_lets_through() -> None:
    scene = scenes.three_joints()
    projected = projection.project_gaussians(
        scene.gaussians.means, gaussian.covariances(scene.gaussians), scene.views[0]
    )
    images = raster.splats(projected, scene.views[0].size)
    assert np.any((images[0] > 0.2) & (images[1] > 0.2))
    composite = raster.render(projected, scene.views[0].size, "single")[0]
    assert composite == pytest.approx(1 - np.prod(1 - images, axis=0), abs=1e-14)


def test_pseudo_ground_truth_of_composites_has_peak_one_and_three_equal_channels() -> None:
    scene = scenes.three_joints()
    rgb, single = (scene.targets(encoding)[0] for encoding in ("rgb", "single"))
    assert single.max() == 1.0
    assert np.array_equal(rgb, np.repeat(single, 3, axis=0))


def test_masked_l2_is_the_mean_over_the_union_of_all_channels() -> None:
    rendered = np.array([[[0.5, 0.0, 0.0]], [[0.2, 0.0, 0.0]]])
    target = np.array([[[0.1, 0.3, 0.0]], [[0.2, 0.0, 0.0]]])
    result = raster.masked_l2(rendered, target)
    assert result is not None
    assert result[0] == pytest.approx((0.4**2 + 0.3**2) / 3)
    assert raster.masked_l2(0 * rendered, 0 * target) is None


def test_missing_detections_leave_the_channel_out() -> None:
    scene = scenes.three_joints()
    images = scene.targets("one_hot")
    assert not images[1][2].any()
    assert not images[3][0].any()
    result = total.loss_and_gradient(scene.gaussians, scene.detections, scene.views, images)
    blind = scene.detections.copy()
    blind[:, 1] = np.nan
    without = total.loss_and_gradient(
        scene.gaussians, blind, scene.views, total.targets(scene.initial, blind, scene.views)
    )
    assert np.all(without.gradient.means[1] == 0)
    assert np.all(result.gradient.means[1] != 0)


def test_adam_follows_its_closed_form_for_a_constant_gradient() -> None:
    # With a constant gradient both bias-corrected moments are exact: every step is −α·sign(g).
    state, x = adam.Adam((2,)), np.zeros(2)
    for _ in range(5):
        x = state.step(x, np.array([2.0, -1e-6]), 0.1)
    assert x == pytest.approx([-0.5, 0.5], rel=1e-8)


@pytest.mark.parametrize(("count", "expected"), [(None, [0, 1, 2, 3]), (1, [2]), (2, [0, 1]), (3, [2, 3, 0])])
def test_views_are_taken_cyclically(count: int | None, expected: list[int]) -> None:
    assert paper_loop.step_views(2, 4, count) == expected


def test_early_stopping_compares_the_minima_of_whole_windows() -> None:
    assert paper_loop.window_difference([3, 1, 2], 2) is None
    assert paper_loop.window_difference([3, 1], 2) is None
    assert paper_loop.window_difference([3, 1, 2, 0.25], 2) == 0.75


@pytest.mark.sweep  # the package recovers them, and is compared with the twin
def test_paper_loop_recovers_exact_detections() -> None:
    views = scenes.small_rig()
    truth = np.array([[-60.0, 40.0, 30.0], [60.0, 70.0, 75.0], [110.0, -90.0, -110.0]])
    start = truth + np.array([[12.0, -8, 5], [-6, 14, 9], [10, 3, -13]])
    config = paper_loop.PaperConfig(stop_tolerance=0.0)
    result = paper_loop.refine(
        paper_loop.initial_gaussians(start, config.sigma_mm),
        scenes.pixels(truth, views),
        views,
        config=config,
    )
    # Adam ends within a fraction of its last steps (3 mm · 0.01^0.125 = 1.7 mm at most) around the optimum;
    # perspective puts that some tenths of a mm from the truth, since the target keeps the start's shape.
    assert np.linalg.norm(result.gaussians.means - truth, axis=1).max() < 1.0
    assert result.losses[-1] < 0.02 * result.losses[0]


@pytest.mark.parametrize("weights", [None, [1.0, 0.3, 0.0, 0.8]])
def test_triangulation_of_exact_detections_is_exact(weights: list[float] | None) -> None:
    views = scenes.small_rig()
    confidence = None if weights is None else np.tile(np.array(weights)[:, None], (1, 17))
    pose = triangulation.triangulate(scenes.pixels(scenes.H36M_POSE, views), views, confidence)
    # Smallest singular vectors are good to about machine epsilon × condition (1e6 here) × 1 m.
    assert pose == pytest.approx(scenes.H36M_POSE, abs=1e-6)


@pytest.mark.parametrize(("scale", "shift"), [(1e-3, 0.0), (1.0, 2000.0)])
def test_triangulation_depends_on_neither_unit_nor_origin(scale: float, shift: float) -> None:
    views = scenes.small_rig()
    noise = np.random.default_rng(1).normal(size=(4, 17, 2))
    found = scenes.pixels(scenes.H36M_POSE, views) + noise
    offset = np.full(3, shift)
    other = [view._replace(t=scale * view.t - view.R @ offset) for view in views]
    pose = triangulation.triangulate(found, views)
    assert triangulation.triangulate(found, other) == pytest.approx(scale * pose + offset, abs=1e-6)
    assert np.linalg.norm(pose - scenes.H36M_POSE, axis=1).max() > 1.0


def test_fusion_weighs_by_the_inverse_mean_reprojection_error() -> None:
    views = scenes.small_rig()
    truth = scenes.H36M_POSE[:2]
    poses = truth + np.array([10.0, 20.0, 40.0, 80.0])[:, None, None] * np.array([1.0, 0, 0])
    fused = triangulation.fuse_monocular(poses, scenes.pixels(truth, views), views)
    # Errors in px are nearly proportional to the displacement d: w ∝ 1/d makes Σ w d = 4 / Σ (1/d) = 21.3 mm.
    assert fused - truth == pytest.approx(np.tile([21.3, 0, 0], (2, 1)), abs=0.6)


def test_project_gaussians_leaves_joints_behind_the_camera_out() -> None:
    view = scenes.small_rig()[0]
    behind = view.R.T @ (np.array([0.0, 0.0, -100.0]) - view.t)
    projected = projection.project_gaussians(behind[None], np.eye(3)[None], view)
    assert not projected.seen[0]
    assert np.isnan(projected.means2d).all()

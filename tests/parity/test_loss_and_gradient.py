"""Every analytic gradient of the package against central differences of its loss, and against the twin."""

import numpy as np
import pytest

import scenes
import skelsplat as sk
from parity import bridge
from reference import overlap, raster, total
from reference.arrays import Gaussians
from reference.symmetry import observed_pairs
from skelsplat import synthetic

GROUPS = ("means", "log_scales", "quaternions")
LOSS_RELATIVE = 1e-11
"""Both sides are float64. A row recurrence of 128 px gathers at most 128²/2 roundings of 1.1e-16: 1e-12."""
GRADIENT_RELATIVE = 1e-9
"""The same times the cancellation of positive and negative pixels in a gradient's sum: some hundreds here."""


@pytest.mark.parametrize("encoding", raster.ENCODINGS)
def test_gradient_equals_central_differences(scene: scenes.Scene, encoding: str) -> None:
    def value(gaussians: Gaussians) -> float:
        return float(bridge.loss_and_gradient(scene, gaussians, encoding=encoding).loss)

    found = bridge.gradient(bridge.loss_and_gradient(scene, encoding=encoding))
    numeric = scenes.central_differences(value, scene.gaussians)
    for group in GROUPS:
        error = scenes.worst_relative_error(getattr(found, group), getattr(numeric, group))
        assert error < 1e-5, group


def assert_equals_twin(found: sk.LossAndGradient, expected: total.LossAndGradient) -> None:
    assert found.loss == pytest.approx(expected.loss, rel=LOSS_RELATIVE)
    assert found.render == pytest.approx(expected.render, rel=LOSS_RELATIVE)
    assert found.symmetry == pytest.approx(expected.symmetry, rel=LOSS_RELATIVE)
    for group in GROUPS:
        ours, theirs = getattr(bridge.gradient(found), group), getattr(expected.gradient, group)
        assert scenes.worst_relative_error(ours, theirs) < GRADIENT_RELATIVE, group


@pytest.mark.parametrize("encoding", raster.ENCODINGS)
def test_equals_the_twin(scene: scenes.Scene, encoding: str) -> None:
    expected = total.loss_and_gradient(
        scene.gaussians, scene.detections, scene.views, scene.targets(encoding), encoding=encoding
    )
    assert_equals_twin(bridge.loss_and_gradient(scene, encoding=encoding), expected)


# The symmetry term does not know the encoding: every tier with one of them, every encoding with one tier.
@pytest.mark.parametrize(
    ("encoding", "tier"), [*(("one_hot", tier) for tier in range(4)), ("rgb", 1), ("single", 1)]
)
def test_person_with_symmetry_equals_the_twin(encoding: str, tier: int) -> None:
    scene = scenes.person()
    scene.detections[:, 5] = np.nan  # both left leg limbs have an end that no view detects
    observed = np.any(total.detected(scene.detections), axis=0)
    pairs = observed_pairs(scenes.symmetric_pairs(tier), observed)
    assert len(pairs) == (0, 1, 2, 4)[tier]
    expected = total.loss_and_gradient(
        scene.gaussians,
        scene.detections,
        scene.views,
        scene.targets(encoding),
        encoding=encoding,
        pairs=pairs,
        symmetry_weight=1e-4,
    )
    found = bridge.loss_and_gradient(
        scene, encoding=encoding, symmetry_tier=tier, symmetry_weight=1e-4, layout="h36m17"
    )
    assert_equals_twin(found, expected)


@pytest.mark.parametrize("tier", [1, 2, 3])
def test_total_gradient_with_symmetry_equals_central_differences(tier: int) -> None:
    scene = scenes.person()
    settings = {"symmetry_tier": tier, "symmetry_weight": 1e-4, "layout": sk.layouts.H36M17}
    found = bridge.loss_and_gradient(scene, **settings)
    assert found.loss == pytest.approx(found.render + 1e-4 * found.symmetry, rel=1e-14)
    assert 1e-4 * found.symmetry > 0.1 * found.render
    rng = np.random.default_rng(tier)
    # Random directions test all 51 coordinates at once; no pixel of any joint may change class on the way.
    for _ in range(6):
        direction = rng.normal(size=scene.gaussians.means.shape)
        start = scene.gaussians
        ends = [start._replace(means=start.means + step * direction) for step in (2e-5, -2e-5)]
        classes = [total.membership(end, scene.detections, scene.views) for end in ends]
        assert all(np.array_equal(a, b) for a, b in zip(*classes, strict=True))
        above, below = (bridge.loss_and_gradient(scene, end, **settings).loss for end in ends)
        scale = np.linalg.norm(found.d_means) * np.linalg.norm(direction) / np.sqrt(direction.size)
        assert np.sum(found.d_means * direction) == pytest.approx((above - below) / 4e-5, abs=1e-5 * scale)


@pytest.mark.parametrize(("unit", "mm"), [("cm", 10.0), ("m", 1000.0)])
def test_unit_changes_the_numbers_but_not_the_loss(unit: str, mm: float) -> None:
    scene = scenes.person()
    cameras = [sk.Camera(v.K, v.R, v.t / mm, size=v.size) for v in scene.views]
    means, log_scales, quaternions = scene.gaussians
    found = sk.loss_and_gradient(
        means / mm,
        log_scales - np.log(mm),
        quaternions,
        scene.detections,
        sk.CameraRig(cameras, unit=unit),
        layout="h36m17",
        config=sk.RefineConfig.paper(),
        target_means=scene.initial.means / mm,
        target_covariances=scene.initial_covariances / mm**2,
    )
    in_mm = bridge.loss_and_gradient(scene, layout="h36m17")
    assert found.loss == pytest.approx(in_mm.loss, rel=1e-10)
    assert found.symmetry == pytest.approx(in_mm.symmetry, rel=1e-10)
    assert scenes.worst_relative_error(found.d_means, in_mm.d_means * mm) < GRADIENT_RELATIVE
    assert scenes.worst_relative_error(found.d_log_scales, in_mm.d_log_scales) < GRADIENT_RELATIVE


def test_views_without_any_detection_do_not_count() -> None:
    scene = scenes.three_joints()
    blind = scene.detections.copy()
    blind[2] = np.nan
    kept = [0, 1, 3]
    without = scenes.Scene(scene.gaussians, scene.initial, blind, scene.views)
    fewer = scenes.Scene(
        scene.gaussians, scene.initial, scene.detections[kept], [scene.views[i] for i in kept]
    )
    found = bridge.loss_and_gradient(without)
    assert found.loss == pytest.approx(bridge.loss_and_gradient(fewer).loss, rel=LOSS_RELATIVE)
    images = without.targets("one_hot")
    assert_equals_twin(found, total.loss_and_gradient(scene.gaussians, blind, scene.views, images))


@pytest.mark.parametrize("build", [scenes.three_joints, scenes.person])
def test_the_closed_form_equals_the_twin(build) -> None:
    """A dozen operations in doubles on either side, with 2 × 2 inverses of condition below 100: 1e-11."""
    scene = build()
    scene.detections[0, 1] = np.nan
    loss, gradient = overlap.render_loss(scene.gaussians, scene.initial, scene.detections, scene.views)
    found = bridge.loss_and_gradient(scene, renderer="closed_form")
    assert found.loss == pytest.approx(loss, rel=LOSS_RELATIVE)
    for group in GROUPS:
        ours, theirs = getattr(bridge.gradient(found), group), getattr(gradient, group)
        assert scenes.worst_relative_error(ours, theirs) < GRADIENT_RELATIVE, group


def test_the_raster_is_the_closed_form_but_for_cut_and_clamp() -> None:
    """Value of one joint in one view, σ of several px, render 1 σ off its target.

    Outside the ellipse a = 1/255 a bell holds (1/255)² of its energy, and (R−P)² there is at most twice the
    sum of both; the clamp takes at most 0.01 from R inside 0.142 σ, an area of π·0.142²·|Σ|^½ = 0.0202 of the
    energy, times |2 (R−P)| ≤ 2: 4e-4 of the energy. The sum over pixels is the integral beyond doubles.
    """
    rig = synthetic.human36m_like()[:1]
    mean = np.array([[100.0, 50.0, 900.0]])
    arguments = (np.full((1, 3), np.log(25.0)), np.array([[1.0, 0, 0, 0]]))
    detections, sigma = sk.project(mean, rig) + np.array([6.0, -1.0]), 25.0**2 * np.eye(3)[None]
    in_pixels, in_plane = (
        sk.loss_and_gradient(
            mean, *arguments, detections, rig, config=sk.RefineConfig.paper(renderer=renderer)
        ).loss
        for renderer in ("raster", "closed_form")
    )
    energy = np.pi * np.sqrt(np.linalg.det(sk.project_gaussians(mean, sigma, rig)[1][0, 0]))
    render, target = (
        sk.render(mean, sigma, rig[0]),
        sk.pseudo_ground_truth(detections[0], mean, sigma, rig[0]),
    )
    in_pixels *= np.count_nonzero((render > 0) | (target > 0))
    in_plane *= overlap.ELLIPSE * energy
    assert abs(in_pixels - in_plane) < (4 / 255**2 + 4e-4) * energy
    assert in_plane > 0.3 * energy

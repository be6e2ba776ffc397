"""The loss and its gradient against the twin; the core's tests compare the gradient with differences."""

from collections.abc import Callable

import numpy as np
import pytest

import scenes
import skelsplat as sk
from parity import bridge
from reference import overlap, raster, total
from reference.symmetry import observed_pairs

GROUPS = ("means", "log_scales", "quaternions")
LOSS_RELATIVE = 1e-11
"""Both sides are float64. A row recurrence of 128 px gathers at most 128²/2 roundings of 1.1e-16: 1e-12."""
GRADIENT_RELATIVE = 1e-9
"""The same times the cancellation of positive and negative pixels in a gradient's sum: some hundreds here."""


def assert_equals_twin(found: sk.LossAndGradient, expected: total.LossAndGradient) -> None:
    assert found.loss == pytest.approx(expected.loss, rel=LOSS_RELATIVE)
    assert found.render == pytest.approx(expected.render, rel=LOSS_RELATIVE)
    assert found.symmetry == pytest.approx(expected.symmetry, rel=LOSS_RELATIVE)
    for group in GROUPS:
        ours, theirs = getattr(bridge.gradient(found), group), getattr(expected.gradient, group)
        assert scenes.worst_relative_error(ours, theirs) < GRADIENT_RELATIVE, group


@pytest.mark.parametrize("build", [scenes.three_joints, scenes.beyond_the_image])
@pytest.mark.parametrize("encoding", raster.ENCODINGS)
def test_equals_the_twin(build: Callable[[], scenes.Scene], encoding: str) -> None:
    scene = build()
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

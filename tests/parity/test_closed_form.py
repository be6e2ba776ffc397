"""The closed-form renderer against its twin, against the raster, and driving Adam."""

from __future__ import annotations

import numpy as np
import pytest

import scenes
import skelsplat as sk
from parity import bridge
from reference import overlap
from skelsplat import synthetic

GROUPS = ("means", "log_scales", "quaternions")


@pytest.mark.parametrize("build", [scenes.three_joints, scenes.person])
def test_equals_the_twin(build) -> None:
    """A dozen operations in doubles on either side, with 2 × 2 inverses of condition below 100: 1e-11."""
    scene = build()
    scene.detections[0, 1] = np.nan
    loss, gradient = overlap.render_loss(scene.gaussians, scene.initial, scene.detections, scene.views)
    found = bridge.loss_and_gradient(scene, renderer="closed_form")
    assert found.loss == pytest.approx(loss, rel=1e-11)
    for group in GROUPS:
        ours, theirs = getattr(bridge.gradient(found), group), getattr(gradient, group)
        assert scenes.worst_relative_error(ours, theirs) < 1e-9, group


def test_the_raster_is_the_closed_form_but_for_cut_and_clamp() -> None:
    """Value of one joint in one view, σ of several px, render 1 σ off its target.

    Outside the ellipse a = 1/255 a bell holds (1/255)² of its energy, and (R−P)² there is at most twice the
    sum of both; the clamp takes at most 0.01 from R inside 0.142 σ, an area of π·0.142²·|Σ|^½ = 0.0202 of the
    energy, times |2 (R−P)| ≤ 2: 4e-4 of the energy. The sum over pixels is the integral beyond doubles.
    """
    rig = synthetic.human36m_like()[:1]
    mean = np.array([[100.0, 50.0, 900.0]])
    arguments = (np.full((1, 3), np.log(25.0)), np.array([[1.0, 0, 0, 0]]))
    detections = sk.project(mean, rig) + np.array([6.0, -1.0])
    loss = {
        renderer: sk.loss_and_gradient(
            mean, *arguments, detections, rig, config=sk.RefineConfig.paper(renderer=renderer)
        ).loss
        for renderer in ("raster", "closed_form")
    }
    _, covariance2d = sk.project_gaussians(mean, 25.0**2 * np.eye(3)[None], rig)
    energy = np.pi * np.sqrt(np.linalg.det(covariance2d[0, 0]))
    render = sk.render(mean, 25.0**2 * np.eye(3)[None], rig[0])
    target = sk.pseudo_ground_truth(detections[0], mean, 25.0**2 * np.eye(3)[None], rig[0])
    mask = np.count_nonzero((render > 0) | (target > 0))
    in_pixels = loss["raster"] * mask
    in_plane = loss["closed_form"] * overlap.ELLIPSE * energy
    assert abs(in_pixels - in_plane) < (4 / 255**2 + 4e-4) * energy
    assert in_plane > 0.3 * energy

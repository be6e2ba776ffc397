"""The error bar: the scatter, and how far the detector's joints lie from anatomical ones."""

from __future__ import annotations

import json

import numpy as np
import pytest

import skelsplat as sk
from skelsplat.io import read_json, read_npz, write_json, write_npz
from skelsplat.layouts import H36M17
from skelsplat.run import Run
from troubled import Array, Scene, normal, poses, room

SOLVE = ("refine", "sequence", "step", "step at a rate", "paper")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return normal(poses(4, 0), room(4), 2.0)


def solved(scene: Scene, how: str = "refine", *, layout: str | sk.Layout | None = "h36m17", **settings):
    if how == "paper":
        config = sk.RefineConfig.paper(max_steps=2, **settings)
        return sk.refine(None, scene.detections[:1], scene.cameras, layout=layout, config=config)
    config = sk.RefineConfig(**settings)
    if how == "refine":
        return sk.refine(None, scene.detections, scene.cameras, layout=layout, config=config)
    if how == "sequence":
        return sk.refine_sequence(scene.detections, scene.cameras, fps=30, layout=layout, config=config)
    fps = 30.0 if how == "step at a rate" else None
    refiner = sk.Refiner(scene.cameras, layout=layout, fps=fps, config=config)
    return [refiner.step(frame) for frame in scene.detections][-1]


def added(result: sk.Refinement) -> Array:
    """Return what the error bars have beyond the scatter, the same on all axes, as deviations (…, N)."""
    beyond = result.error_bar - result.uncertainty
    size = np.trace(beyond, axis1=-2, axis2=-1) / 3
    np.testing.assert_allclose(beyond, size[..., None, None] * np.eye(3), atol=1e-6 * size.max())
    return np.sqrt(np.maximum(size, 0.0))


@pytest.mark.parametrize("how", SOLVE)
def test_every_way_to_refine_adds_it_and_changes_nothing_else(scene: Scene, how: str) -> None:
    without, found = (solved(scene, how, joint_bias_mm=bias) for bias in (0.0, 20.0))
    np.testing.assert_allclose(added(found), 20.0)
    assert found.joint_bias.shape == found.pose.shape[:-1]
    np.testing.assert_array_equal(without.error_bar, without.uncertainty)
    for name in ("pose", "uncertainty", "covariance", "joint_status", "view_weights", "loss"):
        np.testing.assert_array_equal(getattr(found, name), getattr(without, name))


def test_built_in_layouts_have_figures(scene: Scene) -> None:
    """Distances of 25 to 65 mm in space, per axis."""
    bias = dict(zip(H36M17.joints, solved(scene).joint_bias[0], strict=True))
    expected = {"left_wrist": 25, "neck": 65, "right_elbow": 30, "head": 30, "left_hip": 55, "right_knee": 50}
    for joint, distance in expected.items():
        assert bias[joint] == pytest.approx(distance / np.sqrt(3))


def test_own_layouts_and_none_have_no_error_that_nobody_measured(scene: Scene) -> None:
    own = sk.Layout("mouse", H36M17.joints, limbs=H36M17.limbs)
    for layout in (own, None):
        found = solved(scene, layout=layout)
        assert not found.joint_bias.any()
        np.testing.assert_array_equal(found.error_bar, found.uncertainty)
        np.testing.assert_allclose(added(solved(scene, layout=layout, joint_bias_mm=[3.0] * 17)), 3.0)


def reported(scene: Scene, detections: Array, bias: object) -> Run:
    config = sk.RefineConfig(joint_bias_mm=bias)
    result = sk.refine(None, detections, scene.cameras, layout="h36m17", config=config)
    return Run.from_arrays(result, scene.cameras, detections, "h36m17", config=config)


def test_a_run_reports_and_writes_both(tmp_path, scene: Scene) -> None:
    found = reported(scene, scene.detections, 40.0)
    report = json.loads(json.dumps(found.report))
    assert report["settings"]["joint_bias_mm"] == 40.0
    for joint in report["reprojection_error"]["joints"]:
        bar, scatter = joint["error_bar_median_mm"], joint["scatter_median_mm"]
        assert bar == pytest.approx(np.hypot(scatter, 40.0), rel=1e-3)
    for write, read, name in ((write_npz, read_npz, "a.npz"), (write_json, read_json, "a.json")):
        write(tmp_path / name, found.poses.in_unit("m"))
        back = read(tmp_path / name)
        np.testing.assert_allclose(back.joint_bias, 0.04)
        np.testing.assert_allclose(back.error_bar, found.poses.error_bar / 1e6)
    with np.load(tmp_path / "a.npz") as arrays:
        np.testing.assert_allclose(arrays["error_bar"], found.poses.error_bar / 1e6)
    frame = json.loads((tmp_path / "a.json").read_text())["frames"][0]
    np.testing.assert_allclose(frame["error_bar"], found.poses.error_bar[0] / 1e6)


def test_findings_compare_the_scatter(scene: Scene) -> None:
    """A wide systematic error of all joints hides none that stands out, and one of a joint is no finding."""
    detections = scene.detections.copy()
    detections[:, 2:, 16] = np.nan
    detections[:, 0, 16, 1] += 60.0
    each = [0.0] * 17
    for bias in (0.0, 500.0, [*each[:3], 900.0, *each[4:]]):
        found = reported(scene, detections, bias)
        (finding,) = (one for one in found.findings if one.kind == "joints_uncertain")
        assert finding.subject.joints == ("right_wrist",)

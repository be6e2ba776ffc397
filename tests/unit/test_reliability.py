"""Answers that would be wrong without saying so: what a user could not see in the result."""

from __future__ import annotations

import json

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.io import read_json, read_npz, write_json, write_npz
from skelsplat.run import Run
from troubled import Array, Scene, bars, lens, normal, poses, room

WRIST = 16
NOISE_PX = 2.0


def side_by_side(apart_mm: float, frames: int = 60) -> Scene:
    """Two parallel cameras, 3 m from the middle of the room at the height of the chest."""
    K = np.array([[1100.0, 0.0, 960.0], [0.0, 1100.0, 540.0], [0.0, 0.0, 1.0]])
    R = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    centres = [np.array([3000.0, k * apart_mm, 1000.0]) for k in range(2)]
    cameras = sk.CameraRig([sk.Camera(K, R, -R @ c, size=(1920, 1080)) for c in centres])
    return normal(poses(frames, 0), cameras, NOISE_PX)


def deviations(result: sk.Refinement, truth: Array) -> Array:
    """Distance from the truth in standard deviations (T, N)."""
    error = result.pose - truth
    return np.sqrt(np.einsum("tni,tnij,tnj->tn", error, np.linalg.inv(result.uncertainty), error))


# Cameras in nearly one place


def test_two_lenses_in_one_housing_do_not_fix_a_depth() -> None:
    cameras = room(4)
    cameras = sk.CameraRig([*cameras, lens(cameras[0], 0.5)])
    scene = normal(poses(100, 0), cameras, NOISE_PX)
    scene.detections[:, 1:4, WRIST] = np.nan
    status = scene.refine().joint_status
    assert (status[:, WRIST] == "weak").all()
    assert (np.delete(status, WRIST, axis=1) == "ok").mean() > 0.99


def test_a_depth_that_is_ok_is_within_its_error_bar() -> None:
    """3 mm at 3 m are half the noise: what calls itself ok must know how little it knows."""
    scene = side_by_side(3.0)
    result = scene.refine()
    error = np.linalg.norm(result.pose - scene.truth, axis=-1)
    assert not ((error > 10 * bars(result)) & (result.joint_status == "ok")).any()


def arc(n_views: int, step_rad: float) -> sk.CameraRig:
    """Cameras that many radians apart round the room."""
    K = np.array([[1145.0, 0.0, 500.0], [0.0, 1145.0, 500.0], [0.0, 0.0, 1.0]])
    eyes = [(5300.0 * np.sin(k * step_rad), -5300.0 * np.cos(k * step_rad), 1200.0) for k in range(n_views)]
    looks = [synthetic.look_at(eye, (0.0, 0.0, 900.0)) for eye in eyes]
    return sk.CameraRig([sk.Camera(K, R, t, size=(1000, 1000)) for R, t in looks])


@pytest.mark.parametrize("off_px", [300.0, 600.0])
def test_one_gross_error_leaves_no_joint_without_a_position(off_px: float) -> None:
    """In a narrow rig the point nearest to all rays then lies behind the cameras or has no depth."""
    scene = normal(poses(60, 0), arc(4, 0.1), 1.0)
    angle = np.random.default_rng(0).uniform(0.0, 2 * np.pi, size=scene.truth.shape[:2])
    scene.detections[:, 0] += off_px * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    result = scene.refine(layout=None)
    assert np.isfinite(result.pose).all()
    assert (result.joint_status == "ok").mean() > 0.99
    without = scene.of_views([1, 2, 3]).refine(layout=None)
    error = [np.linalg.norm(r.pose - scene.truth, axis=-1) for r in (result, without)]
    assert np.median(error[0]) < 1.1 * np.median(error[1])


# Noise of any size

IDEAL_COVERAGE = 97.1  # %, of a normal distribution in space within 3 σ


@pytest.mark.parametrize("n_views", [2, 4])
@pytest.mark.parametrize("sigma_px", [10.0, 20.0, 40.0])
def test_plain_noise_of_any_size_is_averaged(sigma_px: float, n_views: int) -> None:
    """Where nothing but the noise is wrong, every detection counts, and the error bars grow with it."""
    scene = normal(poses(200, 0), room(n_views), sigma_px)
    result = scene.refine()
    linear = np.nanmean(np.linalg.norm(scene.triangulate("dlt") - scene.truth, axis=-1))
    assert np.nanmean(np.linalg.norm(result.pose - scene.truth, axis=-1)) <= 1.03 * linear
    ok = result.joint_status == "ok"
    assert ok.mean() > 0.95
    covered = 100 * (deviations(result, scene.truth)[ok] < 3.0).mean()
    assert abs(covered - IDEAL_COVERAGE) < 5.0


# Views that contradict each other


def two_people(views: list[int]) -> Scene:
    """Somebody walking; from frame 10 on these two of four views show another person instead."""
    cameras = room(4)
    truth = synthetic.motion("walk", 30, seed=0)
    other = synthetic.motion("walk", 30, seed=5) + np.array([600.0, 300.0, 0.0])
    scene = normal(truth, cameras, NOISE_PX)
    scene.detections[10:, views] = normal(other, cameras, NOISE_PX, 1).detections[10:, views]
    return scene


def test_two_views_against_two_are_weak_and_the_error_bar_covers_both_places() -> None:
    chosen = []
    for views in ([0, 1], [2, 3]):
        scene = two_people(views)
        result = scene.refine()
        assert (result.joint_status[10:] == "weak").mean() > 0.97
        off = np.linalg.norm(result.pose - scene.truth, axis=-1)[10:] > 100.0
        # Two rays of one joint pass each other at more than three standard deviations once in a few hundred.
        assert (off & (result.joint_status[10:] == "ok")).mean() < 0.01
        assert 100 * (deviations(result, scene.truth)[10:] < 3.0).mean() > IDEAL_COVERAGE - 5.0
        chosen.append(off.mean())
    assert 0.2 < np.mean(chosen) < 0.8, chosen  # which of the two is chance


# Degenerate poses and priors


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

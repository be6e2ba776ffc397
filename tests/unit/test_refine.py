"""`refine` and its result as a caller sees them."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic


def quick(**fields):
    return sk.RefineConfig.paper(max_steps=5, **fields)


@pytest.mark.parametrize("config", [sk.RefineConfig(), sk.RefineConfig.paper(max_steps=5)])
def test_error_bars_weights_and_noise_have_the_documented_shapes(scene, config):
    one = sk.refine(None, scene.detections[0], scene.rig, layout="h36m17", config=config)
    many = sk.refine(None, scene.detections, scene.rig, layout="h36m17", config=config)
    for result, batch in ((one, ()), (many, (3,))):
        assert result.uncertainty.shape == (*batch, 17, 3, 3)
        assert result.view_weights.shape == result.swapped.shape == (*batch, 4, 17)
        assert result.noise.shape == batch
        assert result.swapped.dtype == np.bool_
        assert ((result.view_weights >= 0) & (result.view_weights <= 1)).all()
        assert (np.linalg.eigvalsh(result.uncertainty) > 0).all()
    assert many.loss_history.shape[0] == 3


def test_init_sigma_in_every_form_is_the_same_prior(scene):
    start = synthetic.perturb(scene.pose, 30.0, seed=1)
    covariance = np.tile(900.0 * np.eye(3), (17, 1, 1))
    forms = (30.0, np.full(17, 30.0), covariance, np.tile(covariance, (3, 1, 1, 1)))
    found = [sk.refine(start, scene.detections, scene.rig, init_sigma=form).pose for form in forms]
    assert all(np.array_equal(found[0], pose) for pose in found[1:])
    free = sk.refine(start, scene.detections, scene.rig).pose
    assert np.abs(found[0] - free).max() > 0.1
    mixed = np.where(np.arange(17) == 3, np.nan, 1e-3)
    with pytest.warns(UserWarning, match="init_pose"):
        nailed = sk.refine(start, scene.detections, scene.rig, init_sigma=mixed).pose
    assert np.allclose(np.delete(nailed, 3, axis=1), np.delete(start, 3, axis=1), atol=1e-3)
    # Exact detections: joint 3, without a prior, goes where they are.
    assert np.allclose(nailed[:, 3], scene.pose[:, 3], atol=0.1)


def test_exchanged_arms_are_put_back_and_the_pose_is_that_of_the_right_ones(scene):
    other = np.arange(17)
    other[[11, 12, 13, 14, 15, 16]] = [14, 15, 16, 11, 12, 13]
    exchanged = scene.detections[0].copy()
    exchanged[2] = exchanged[2, other]
    found = sk.refine(None, exchanged, scene.rig, layout="h36m17")
    assert (found.swapped == ((np.arange(4) == 2)[:, None] & (other != np.arange(17)))).all()
    expected = sk.refine(None, scene.detections[0], scene.rig, layout="h36m17").pose
    np.testing.assert_allclose(found.pose, expected, atol=0.1)


def test_the_loss_is_that_of_the_returned_pose(scene):
    noisy = synthetic.perturb(scene.pose[0], 10.0, seed=1)
    arguments = (noisy, scene.detections[0], scene.rig)
    result = sk.refine(*arguments, layout="h36m17", config=sk.RefineConfig.paper())
    assert np.isclose(result.loss, result.loss_render + 1e-5 * result.loss_symmetry, rtol=1e-12)
    # The splat's scales are not in the result's pose, but without them the loss of the returned pose follows.
    fixed = quick(log_scale_lr=0.0, rotation_lr=0.0)
    result = sk.refine(noisy, scene.detections[0], scene.rig, layout="h36m17", config=fixed)
    sigma, upright = np.full((17, 3), 3.0), np.tile([1.0, 0, 0, 0], (17, 1))
    again = sk.loss_and_gradient(
        result.pose,
        sigma,
        upright,
        scene.detections[0],
        scene.rig,
        layout="h36m17",
        config=fixed,
        target_means=result.init_pose,
        target_covariances=np.tile(np.exp(6.0) * np.eye(3), (17, 1, 1)),
    )
    # Single-precision pixels against double: 1e-5 of the loss.
    assert np.isclose(result.loss, again.loss, rtol=1e-5)


def test_lens_distortion_is_undone_unless_told_otherwise(scene):
    rig = synthetic.human36m_like(distortion=True)
    detections = sk.project(scene.pose[0], rig)
    undone = sk.refine(scene.pose[0], detections, rig, config=quick())
    left = sk.refine(scene.pose[0], detections, rig, config=quick(undistort=False))
    assert np.nanmedian(undone.reprojection_error) < 0.5
    assert np.nanmax(np.abs(left.init_pose - scene.pose[0])) == 0
    shift = np.linalg.norm(left.pose - scene.pose[0], axis=-1)
    assert shift.max() > 1.0  # mm: the lens moves joints by several px


def scaled_to(scene, size):
    """Return the rig and the pose of the scene, in mm, when the person measures `size` mm."""
    by = size / np.linalg.norm(np.ptp(scene.pose[0], axis=0))
    cameras = [sk.Camera(c.K, c.R, c.t * by, size=c.size, name=c.name) for c in scene.rig]
    return sk.CameraRig(cameras, unit="mm"), scene.pose[0] * by


@pytest.mark.parametrize("config", [sk.RefineConfig(), quick()])
@pytest.mark.parametrize(
    ("own", "size", "warned"),
    [(False, 170.0, True), (False, 500.0, False), (True, 0.06, False), (True, 3e4, True)],
)
def test_a_body_of_one_s_own_layout_need_not_have_a_person_s_size(scene, config, own, size, warned):
    rig, pose = scaled_to(scene, size)
    layout = sk.Layout("mouse", [f"part {j}" for j in range(17)]) if own else "h36m17"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        sk.refine(pose, scene.detections[0], rig, layout=layout, config=config)
        sk.Refiner(rig, layout=layout).step(scene.detections[0])
    assert [one.message.finding.kind for one in caught] == ["unit_wrong"] * (2 * warned)


def test_an_error_in_the_progress_callback_ends_the_batch(scene):
    def fail(_done: int, _total: int) -> None:
        raise RuntimeError("from the callback")

    with pytest.raises(RuntimeError, match="from the callback"):
        sk.refine(scene.pose, scene.detections, scene.rig, progress=fail)


def test_refiner_follows_and_finds_again(scene):
    refiner = sk.Refiner(scene.rig, layout="h36m17")
    first = refiner.step(scene.detections[0])
    second = refiner.step(scene.detections[1])
    assert np.allclose(second.init_pose, first.pose)
    assert np.linalg.norm(second.pose - scene.pose[1], axis=-1).mean() < 1.0
    jumped = scene.pose[2] + np.array([900.0, -700.0, 0.0])
    third = refiner.step(sk.project(jumped, scene.rig))
    assert np.linalg.norm(third.pose - jumped, axis=-1).mean() < 1.0
    refiner.reset()
    again = refiner.step(scene.detections[0])
    assert np.allclose(again.init_pose, sk.triangulate(scene.detections[0], scene.rig))

"""`refine_sequence`: what it accepts and refuses, gaps and cuts, few views, units, swaps that last."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic
from skelsplat.synthetic import DetectionNoise
from sweeps import swept

FPS = 30.0
RIG = synthetic.human36m_like()
NOISE = DetectionNoise.recording(FPS)
OCCLUDED = DetectionNoise.recording_occluded(2)
JOINTS = tuple(f"j{k}" for k in range(17))


def seen(pose: np.ndarray, noise: DetectionNoise = NOISE, seed: int = 0, rig: Any = RIG) -> np.ndarray:
    """Detect a motion (T, N, 3), with errors that last: (T, M, N, 3)."""
    return synthetic.simulate_detections(pose, rig, noise=noise, seed=seed)


def recorded(
    name: str = "walk", n_frames: int = 90, noise: DetectionNoise = NOISE, seed: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """Give a motion (T, 17, 3) and its detections."""
    pose = synthetic.motion(name, n_frames, fps=FPS, seed=seed)
    return pose, seen(pose, noise, seed)


def solve(detections: np.ndarray, rig: Any = RIG, **given: Any) -> sk.SequenceRefinement:
    """Refine over time, as Human3.6M's skeleton unless another layout is given."""
    return sk.refine_sequence(detections, rig, **{"fps": FPS, "layout": "h36m17", **given})


def errors(found: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Distances (T, N)."""
    return np.linalg.norm(found - truth, axis=-1)


# what is refused


REFUSED: dict[str, Callable[[np.ndarray], dict[str, Any]]] = {
    "fps": lambda _: {"fps": -25.0},
    "detections": lambda d: {"detections": d[0]},
    "init_pose": lambda d: {"init_pose": d[:2, 0]},
    "confidence": lambda d: {"detections": d[..., :2], "confidence": np.ones((4, 17, 2))},
    "config.method": lambda _: {"config": sk.RefineConfig.paper()},
}


@pytest.mark.parametrize("argument", REFUSED)
def test_what_does_not_match_is_named(argument):
    detections = recorded(n_frames=3)[1]
    with pytest.raises(sk.InvalidInputError) as caught:
        solve(**{"detections": detections, **REFUSED[argument](detections)})
    assert caught.value.argument == argument


# short recordings, gaps, joints that are not seen


@pytest.mark.parametrize("frames", [slice(40, 60), slice(None)])
def test_a_joint_that_one_view_sees_is_never_as_good_as_a_seen_one(frames):
    pose, detections = recorded(seed=2)
    detections[frames, 1:, 16] = np.nan
    found = solve(detections)
    assert set(found.joint_status[frames, 16]) <= {"inferred", "weak"}
    off = (found.pose - pose)[frames, 16]
    known = np.isfinite(off).all(axis=1)
    assert known.all() or frames == slice(None)
    bars = found.uncertainty[frames, 16]
    square = np.einsum("ti,tij,tj->t", off[known], np.linalg.inv(bars[known]), off[known])
    assert np.count_nonzero(square < 16.0) >= 0.9 * len(square)
    usual = np.trace(found.uncertainty[:, 13], axis1=1, axis2=2).mean()
    assert (np.trace(bars[known], axis1=1, axis2=2) > usual).all()
    widest = np.sqrt(np.linalg.eigvalsh(bars).max(axis=1))
    body = np.sqrt(pose.var(axis=1).sum(axis=-1)).mean()
    assert (found.joint_status[frames, 16][widest > 0.3 * body] == "weak").all()


# layouts and scales


def test_without_limbs_there_is_the_motion_alone():
    pose, detections = recorded()
    found = solve(detections, layout=None)
    bare = solve(detections, layout=sk.Layout("bare", JOINTS))
    assert found.bones.shape == bare.bones.shape == (0, 2)
    assert found.bone_lengths.shape == (0,)
    assert errors(found.pose, pose).mean() < errors(found.init_pose, pose).mean()
    np.testing.assert_array_equal(found.pose, bare.pose)


def test_the_unit_does_not_matter():
    detections = recorded(noise=OCCLUDED)[1]
    metres = sk.CameraRig([sk.Camera(c.K, c.R, c.t / 1000, size=c.size) for c in RIG], unit="m")
    mm, m = solve(detections), solve(detections, metres)
    lengths = ("pose", "velocity", "joint_bias", "bone_lengths", "bone_length_sigma", "view_noise")
    for name in (*lengths, "uncertainty", "error_bar", "velocity_uncertainty"):
        scale = 1000.0 if name in lengths else 1e6
        np.testing.assert_allclose(getattr(m, name) * scale, getattr(mm, name), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(m.joint_status, mm.joint_status)


def test_frames_further_apart_than_a_second_have_no_velocity():
    """Between them, anything may have happened: a difference of positions tells nothing."""
    pose = synthetic.motion("walk", 120, fps=0.1, seed=0)
    noise = DetectionNoise.good()
    found = solve(seen(pose, noise), fps=0.1)
    assert np.isnan(found.velocity).all()
    assert (found.joint_status == "ok").mean() > 0.99


# views and confidences


@pytest.mark.parametrize("noise", [NOISE, swept(OCCLUDED)])
@pytest.mark.parametrize("n_views", [2, 3])
def test_few_views_gain_as_well(n_views, noise):
    pose, detections = recorded(noise=noise, n_frames=150)
    found = solve(detections[:, :n_views], sk.CameraRig(RIG[:n_views]))
    both = np.isfinite(found.init_pose)
    assert np.isfinite(found.pose).mean() >= both.mean()
    error, alone = errors(found.pose, pose), errors(found.init_pose, pose)
    assert np.nanmean(error) < 0.85 * np.nanmean(alone)


def test_confidences_come_either_way_and_their_scale_is_free():
    detections = recorded(noise=OCCLUDED)[1]
    found = solve(detections)
    apart = solve(detections[..., :2], confidence=detections[..., 2])
    np.testing.assert_array_equal(found.pose, apart.pose)
    np.testing.assert_array_equal(found.uncertainty, apart.uncertainty)
    scaled = solve(detections * [1.0, 1.0, 0.1])
    np.testing.assert_allclose(scaled.pose, found.pose, atol=1e-6)
    np.testing.assert_allclose(scaled.uncertainty, found.uncertainty, rtol=1e-6, atol=1e-6)
    assert np.isfinite(solve(detections[..., :2]).pose).all()


# motions that are not smooth


@pytest.mark.parametrize(
    ("step_mm", "noise"), [(100.0, NOISE), (1000.0, NOISE), swept(300.0, OCCLUDED), (1000.0, OCCLUDED)]
)
def test_a_jump_is_followed_and_does_not_blur(step_mm, noise):
    """Around it the error is no larger than frame by frame; neither is the velocity measured across it."""
    before, in_time, alone = slice(20, 40), [], []
    for seed in range(3):
        pose = synthetic.motion("walk", 90, fps=FPS, seed=seed)
        pose -= pose.mean(axis=(0, 1)) * [1.0, 1.0, 0.0]
        speed = np.linalg.norm(np.diff(pose, axis=0), axis=-1).max() * FPS
        pose[45:, :, 0] += step_mm
        found = solve(seen(pose, noise, seed))
        in_time.append(errors(found.pose, pose))
        alone.append(errors(found.init_pose, pose))
        assert np.nanmax(np.linalg.norm(found.velocity[43:47], axis=-1)) < 1.5 * speed
    error, single = np.array(in_time), np.array(alone)
    assert np.nanmean(error[:, 44:46]) < 1.05 * np.nanmean(single[:, 44:46])
    assert np.nanmean(error[:, 42:48]) < np.nanmean(single[:, 42:48])
    assert np.nanmean(error[:, 44:46]) < 1.5 * np.nanmean(error[:, before])


# left and right


def swapped_in(detections: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Find the detections (T, M, N) that are nearer to the joint of the other side."""
    pixels = sk.project(pose, RIG).swapaxes(0, 1)
    out = np.zeros(detections.shape[:3], dtype=bool)
    for left, right in sk.layouts.get("h36m17").left_right:
        pair, crossed = detections[:, :, [left, right], :2], detections[:, :, [right, left], :2]
        true = pixels[:, :, [left, right]]
        own, other = (np.linalg.norm(d - true, axis=-1).sum(axis=-1) for d in (pair, crossed))
        out[:, :, left] = out[:, :, right] = other < own - 40.0
    return out


@pytest.mark.parametrize("rate", ["limb_swap_rate", "view_swap_rate"])
def test_swaps_that_last_are_found_where_frames_alone_cannot_tell(rate):
    """In two of four views at once it is impossible to tell for a single frame, which then errs in both."""
    found, alone, wrong, error, error_alone = [], [], [], [], []
    for seed, name in enumerate(("walk", "turn", "crouch", "wave")):
        pose, detections = recorded(name, 150, replace(NOISE, **{rate: 0.1}), seed)
        truth = swapped_in(detections, pose)
        in_time, single = solve(detections), sk.refine(None, detections, RIG, layout="h36m17")
        found.append(in_time.swapped[truth])
        alone.append(single.swapped[truth])
        wrong.append(np.count_nonzero(in_time.swapped & ~truth) < np.count_nonzero(single.swapped & ~truth))
        error.append(errors(in_time.pose, pose))
        error_alone.append(errors(single.pose, pose))
    share, share_alone = np.concatenate(found).mean(), np.concatenate(alone).mean()
    assert share > 0.97
    assert share > share_alone + 0.03
    assert np.mean(error) < 14.0 < 0.75 * np.mean(error_alone)
    assert any(wrong)

"""A step of `refine_sequence` against its dense twin: weights, gradient, H and noise of 20 frames.

Both sides are float64; the entries are sums of up to five terms of one sign each: 1e-12 of the largest.
"""

import numpy as np
import pytest

import scenes
import skelsplat as sk
from parity.bridge import rig
from reference import sequence
from reference.arrays import Array
from reference.rays import Rays, make_rays
from skelsplat import _skelsplat

FRAMES = 20
H36M = sk.layouts.get("h36m17")
CONFIG = sk.RefineConfig(find_swaps=False)


def recording(seed: int) -> tuple[Array, Array]:
    """Poses (T,17,3) near the solution and detections (T,M,17,3): noise, gross errors, misses."""
    rng, views = np.random.default_rng(seed), scenes.small_rig(distance=4000.0)
    phase = 0.3 * np.arange(FRAMES)[:, None, None]
    swing = 120.0 * np.sin(phase + np.arange(17)[:, None]) * np.array([1.0, -0.4, 0.3])
    truth = scenes.H36M_POSE + swing
    detections = np.ones((FRAMES, len(views), 17, 3))
    for t in range(FRAMES):
        error = rng.normal(scale=1.0 if t < FRAMES // 2 else 3.0, size=(4, 17, 2))
        detections[t, ..., :2] = scenes.pixels(truth[t], views) + error
    detections[..., 2] = rng.uniform(0.4, 1.0, detections.shape[:3])
    wrong = rng.random(detections.shape[:3]) < 0.05
    detections[wrong, :2] += rng.normal(scale=15.0, size=(np.count_nonzero(wrong), 2))
    detections[rng.random(detections.shape[:3]) < 0.05] = np.nan
    return truth + rng.normal(scale=12.0, size=truth.shape), detections


def model(fps: float, seed: int) -> sequence.Model:
    """Numbers as a recording shows them, other ones for every joint and bone."""
    rng = np.random.default_rng(seed)
    ends = np.array(H36M.limbs)
    length = np.linalg.norm(scenes.H36M_POSE[ends[:, 0]] - scenes.H36M_POSE[ends[:, 1]], axis=-1)
    return sequence.Model(
        bones=[(int(a), int(b)) for a, b in ends],
        lengths=np.stack([length * rng.uniform(0.9, 1.1, len(ends)), rng.uniform(6, 20, len(ends))], axis=-1),
        variance=rng.uniform(50.0, 300.0, 17),
        sigma=rng.uniform(25.0, 40.0, 17),
        fps=fps,
    )


def twin(detections: Array) -> list[Rays]:
    """Rays of every frame."""
    return [make_rays(frame, scenes.small_rig(distance=4000.0)) for frame in detections]


# The spans of the kernels are 1, 2 and 3 frames.
@pytest.mark.parametrize("fps", [10.0, 30.0, 60.0])
def test_the_equations_are_those_of_the_twin(fps: float) -> None:
    poses, detections = recording(1)
    given, cameras = model(fps, 2), rig(scenes.small_rig(distance=4000.0))
    joints = np.stack([given.variance, given.sigma], axis=-1)
    hessian, gradient, agility, scales, factors = _skelsplat.sequence_equations(
        poses,
        detections,
        cameras,
        fps=fps,
        lengths=given.lengths.tolist(),
        joints=joints.tolist(),
        layout=H36M,
        config=CONFIG,
    )
    rays = twin(detections)
    alone = sk.refine(None, detections, cameras, layout=H36M, config=CONFIG).pose
    assert agility == pytest.approx(sequence.agility(alone, rays, given).T, rel=1e-9)
    assert agility.max() > 2.0 * agility.min()
    weights = sequence.weights(poses, alone, rays, given)
    expected, slope = sequence.normal_equations(poses, rays, given, weights)
    assert np.abs(hessian - hessian.T).max() <= 1e-12 * np.abs(hessian).max()
    assert np.abs(hessian - expected).max() <= 1e-9 * np.abs(expected).max()
    assert np.abs(gradient - slope).max() <= 1e-9 * np.abs(slope).max()
    assert np.linalg.eigvalsh(expected)[0] > -1e-9

    squares, left = sequence.residuals(poses, rays, given, weights)
    mirrors = {b: a for a, b in H36M.left_right}
    classes = np.array([mirrors.get(j, j) for j in range(17)])
    variance, wrong = sequence.learnt(squares, left, given.variance, classes)
    assert scales == pytest.approx(variance.T, rel=1e-9)
    assert factors == pytest.approx(sequence.in_time(squares, left, variance, wrong, fps), rel=1e-9)
    assert np.ptp(factors) > 0.01

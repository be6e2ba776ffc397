"""What the paper finds, on simulated detections: recovery, starts and the noise ablation's shape."""

from __future__ import annotations

import numpy as np
import pytest

import skelsplat as sk
from skelsplat import synthetic

PAPER = sk.RefineConfig.paper()


@pytest.fixture(scope="module")
def poses() -> np.ndarray:
    """Three frames of every motion, far apart in time."""
    return np.concatenate(
        [synthetic.motion(name, 60, seed=k)[5::20] for k, name in enumerate(synthetic.motion_names)]
    )


@pytest.fixture(scope="module")
def rig() -> sk.CameraRig:
    return synthetic.human36m_like()


@pytest.fixture(scope="module")
def detections(poses: np.ndarray, rig: sk.CameraRig) -> np.ndarray:
    noise = synthetic.DetectionNoise.good()
    return synthetic.simulate_detections(poses, rig, noise=noise, layout="h36m17", seed=1)


def test_exact_detections_recover_the_pose_from_20_mm_of_noise(poses, rig):
    exact = sk.project(poses, rig).swapaxes(0, 1)
    start = synthetic.perturb(poses, 20.0, seed=2)
    result = sk.refine(start, exact, rig, layout="h36m17", config=PAPER)
    assert sk.metrics.mpjpe(start, poses) > 25.0  # 20 mm per axis are 32 mm in space
    assert sk.metrics.mpjpe(result.pose, poses) < 0.5
    assert (result.joint_status == "ok").all()


@pytest.mark.sweep
def test_the_noise_ablation_has_the_papers_shape(poses, rig, detections):
    """Paper, Tab. noise: 26.7, 27.8, 27.9, 30.6, 41.5, 63.4, 84.6 mm at 0, 10, 20, 40, 60, 80, 100 mm.

    Flat to 20 mm (the paper's +4.5 %, here with 10 % for few poses), rising at 40 (the paper's +15 to +25 %),
    lost by 80 (more than twice).
    """
    start = sk.triangulate(detections[..., :2], rig, method="dlt")

    def error(sigma_mm: float) -> float:
        noisy = synthetic.perturb(start, sigma_mm, seed=3)
        found = sk.refine(noisy, detections, rig, layout="h36m17", config=PAPER).pose
        return float(sk.metrics.mpjpe(found, poses))

    at = {sigma: error(sigma) for sigma in (0.0, 20.0, 40.0, 80.0)}
    assert at[0.0] < sk.metrics.mpjpe(start, poses)
    assert at[20.0] < 1.10 * at[0.0]
    assert at[40.0] > 1.10 * at[0.0]
    assert at[80.0] > 2.0 * at[40.0]


def test_monocular_fusion_is_a_start_as_good_as_triangulation(poses, rig, detections):
    """Paper, Tab. initialisation: 26.7 mm from either, though the guesses differ (29.0 and 40.2 mm).

    Within 10 % of one another.
    """
    mono = synthetic.monocular_poses(poses, rig, 60.0, seed=4)
    fused = sk.fuse_monocular(mono, detections, rig)
    triangulated = sk.triangulate(detections[..., :2], rig, method="dlt")
    assert sk.metrics.mpjpe(fused, poses) > sk.metrics.mpjpe(triangulated, poses)

    def error(start: np.ndarray) -> float:
        found = sk.refine(start, detections, rig, layout="h36m17", config=PAPER).pose
        return float(sk.metrics.mpjpe(found, poses))

    assert error(fused) < 1.10 * error(triangulated)

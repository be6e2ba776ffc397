"""CMU motion capture in a Human3.6M-like room; detections are simulated."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import skelsplat as sk
from skelsplat import synthetic

# Human3.6M-17 from the 19 joints; the nose, which the capture has not, is put close to the head.
JOINTS = [
    "pelvis", "r_hip", "r_knee", "r_ankle", "l_hip", "l_knee", "l_ankle", "abdomen", "neck", "head", "head",
    "l_shoulder", "l_elbow", "l_wrist", "r_shoulder", "r_elbow", "r_wrist",
]  # fmt: skip


def poses(data: Path, every: int) -> np.ndarray:
    """Return every so many poses of all takes, (T, 17, 3) mm, standing in the middle of the room."""
    with np.load(data / "cmu_mocap" / "cmu_s01_to_s12_10hz.npz") as archive:
        order = [list(archive["joint_names"]).index(name) for name in JOINTS]
        takes = [archive[name] for name in archive.files if name != "joint_names"]
    out = np.concatenate(takes)[::every][:, order].astype(float) * 1000.0
    out[..., :2] -= out[:, :1, :2]
    out[:, 9] += [60.0, 0.0, -20.0]
    return out


def test_refinement_improves_on_triangulation(data):
    truth = poses(data, every=80)
    rig = synthetic.human36m_like()
    for noise in (synthetic.DetectionNoise.good(), synthetic.DetectionNoise.occluded(2)):
        detections = synthetic.simulate_detections(truth, rig, noise=noise, layout="h36m17", seed=0)
        result = sk.refine(None, detections[..., :2], rig, layout="h36m17")
        before = sk.metrics.mpjpe(result.init_pose, truth, reduce="per_pose")
        after = sk.metrics.mpjpe(result.pose, truth, reduce="per_pose")
        gain = before - after
        # Three standard errors of the mean paired gain.
        assert gain.mean() > 3.0 * gain.std(ddof=1) / np.sqrt(len(gain))

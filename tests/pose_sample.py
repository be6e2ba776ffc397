"""A short sequence with everything that a pose file has to say: gaps, error bars, statuses."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from skelsplat.io import PoseData

T, N, M = 4, 3, 2
JOINTS = ("nose", "right_hip", "head")
MISSING = [(1, 1), (2, 2)]  # frame, joint; one of them the last joint of a row
FILLED = (3, 0)


def sample() -> PoseData:
    """Frames 10, 11, 13, 14 in mm at 59.94 Hz; standard deviations 10, 15, 20 mm with a correlation."""
    rng = np.random.default_rng(3)
    pose = rng.normal(scale=1000.0, size=(T, N, 3))
    uncertainty = np.broadcast_to(np.diag([100.0, 225.0, 400.0]), (T, N, 3, 3)).copy()
    uncertainty[..., 0, 1] = uncertainty[..., 1, 0] = 12.0
    status = np.full((T, N), "ok", dtype="<U10")
    weights = rng.uniform(0.5, 1.0, size=(T, M, N))
    weights[0, 1, 0] = np.nan
    for t, j in MISSING:
        pose[t, j] = uncertainty[t, j] = np.nan
        weights[t, :, j] = np.nan
        status[t, j] = "unobserved"
    uncertainty[FILLED] = np.nan
    status[FILLED] = "filled"
    swapped = np.zeros((T, M, N), dtype=bool)
    swapped[2, 1, 0] = True
    return PoseData(
        pose=pose,
        joint_names=JOINTS,
        frames=np.array([10, 11, 13, 14]),
        unit="mm",
        camera_names=("cam_01", "cam_02"),
        init_pose=pose + 1.0,
        covariance=np.broadcast_to(400.0 * np.eye(3), (T, N, 3, 3)).copy(),
        uncertainty=uncertainty,
        joint_bias=np.broadcast_to([15.0, 0.0, 20.0], (T, N)),
        view_weights=weights,
        swapped=swapped,
        noise=np.array([6.0, 7.0, np.nan, 5.0]),
        reprojection_error=np.where(np.isfinite(weights), 3.0, np.nan),
        joint_status=status,
        loss=np.array([0.1, 0.2, np.nan, 0.3]),
        n_iter=np.array([12, 40, 0, 9]),
        stop_reason=np.array(["max_steps", "converged", "no_observations", "converged"]),
        frame_rate=59.94,
        processing=("Gaps of at most 5 frames filled by straight lines.", "σ in mm."),
    )


def assert_equal(a: PoseData, b: PoseData) -> None:
    """Every attribute is the same, NaN equal to NaN."""
    for entry in fields(PoseData):
        np.testing.assert_array_equal(getattr(a, entry.name), getattr(b, entry.name), err_msg=entry.name)
